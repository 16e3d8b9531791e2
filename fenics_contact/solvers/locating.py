"""Where within an arc a value vanishes: the load's rate at a limit point, the distance from a target."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fenics_contact.solvers.arc_length import ArcReport, Increment
from fenics_contact.solvers.verdict import StepFailed

TRIALS = 40  # arcs tried for one point; a smooth path takes 2 to 4, a kink 3 to 6
STRAIGHT = 0.9  # cosine between the path's rates at both ends: where it turns more, arcs of one length may end at two places
JUMPS = 0.25  # of the load's rate at the end that an arc replaces: with more left of it that rate jumps


@dataclass
class Arrival:
    """A converged state not yet accepted: its arc length from the last one, increment, path's rate there, report; solves: of
    its arc, or of a longer one where it began beside its end."""

    length: float
    increment: Increment
    rate: Increment
    report: ArcReport
    solves: float
    fork: Increment | None = None  # where it is a bifurcation, along what the path is to go on


class Sought(NamedTuple):
    """What vanishes: value(arrival); close(value, arc left to its root by the chord over the bracket): whether that is it;
    width: of the bracket that may hold a jump, where the value is the load's rate, else zero; afresh: arcs begin at the
    start."""

    value: Callable[[Arrival], float]
    close: Callable[[float, float], bool]
    width: float = 0.0
    afresh: bool = False


class BracketEnd(NamedTuple):
    """Of a bracket: length of the arc to it, the value there, the increment, and the path's rate there."""

    length: float
    value: float
    increment: Increment
    rate: Increment


def located(
    arrive: Callable[[float, Increment | None], Arrival],
    arrival: Arrival,
    began: tuple[float, Increment],
    sought: Sought,
    dot: Callable[[Increment, Increment], float],
) -> Arrival:
    """The arrival where a value vanishes before that of a whole arc; StepFailed where none is found.

    arrive(length, near): the arrival of an arc of this length, whose end is near an increment, the one between both ends of
    the bracket, where that is known; began: the value where the arc starts, or of that sign, and the path's rate there; dot:
    inner product. By regula falsi over arc lengths, Illinois variant (Dowell & Jarratt 1971, doi:10.1007/BF01934364).

    Where the load's rate jumps, neither that nor bisection gains from what is known: the load itself has no jump, and the
    kink is where its lines from both sides meet. Where a path turns sharply there it may have two places of
    one length of arc, and only from the start the first one is found.
    """
    low = start = BracketEnd(0.0, first := began[0], arrival.increment.times(0.0), began[1])
    high = BracketEnd(arrival.length, here := sought.value(arrival), arrival.increment, arrival.rate)
    at_low, at_high, kept, jumps, solves = first, here, 0, False, 0
    for _ in range(TRIALS):
        width = high.length - low.length
        if sought.close(here, abs(here * width / (at_high - at_low))):
            arrival.report.iterations += solves
            return arrival
        solves += arrival.report.iterations
        place, onwards = high.length - at_high * width / (at_high - at_low), dot(low.rate, high.rate) > STRAIGHT
        if jumps and onwards:
            place = _kink(low, high, kept, sought.width)
        if low is not start and onwards and sought.close(low.value, width):
            place = low.length  # it has been found
        if onwards and not sought.afresh:
            near = low.increment.times((high.length - place) / width)
            near.add(high.increment, (place - low.length) / width)
            arrival = replace(arrive(place, near), solves=arrival.solves)
        else:
            arrival = arrive(place, None)
        now = BracketEnd(place, here := sought.value(arrival), arrival.increment, arrival.rate)
        replaced = high if here * high.value > 0.0 else low
        jumps = sought.width > 0.0 and abs(here) > JUMPS * abs(replaced.value)
        kept = min(kept, 0) - 1 if replaced is high else max(kept, 0) + 1
        halved = 0.5 if abs(kept) > 1 and not (jumps and onwards) else 1.0
        if replaced is high:
            low, at_low = (start, first) if place == low.length else (low, at_low)  # beyond it by round-off
            high, at_high, at_low = now, here, halved * at_low
        else:
            low, at_low, at_high = now, here, halved * at_high
    raise StepFailed(f"{TRIALS} arcs did not settle on one point")


def _kink(low: BracketEnd, high: BracketEnd, kept: int, width: float) -> float:
    """The length of arc at which the loads at both ends, of which the values are the rates, would be one.

    It is away from both ends by this width, and from the one that the last -kept (the high one) or kept arcs were at, where
    that was not enough since the path bends before the other end, by more of the bracket each time: half of what is left in
    orders of magnitude.
    """
    bracket = high.length - low.length
    met = high.value * high.length - low.value * low.length - (high.increment.dt - low.increment.dt)
    over = bracket * (width / bracket) ** (0.5 ** (abs(kept) - 1))
    width = min(width, 0.5 * bracket)
    below, above = (width, min(over, bracket - width)) if kept < 0 else (min(over, bracket - width), width)
    return float(np.clip(met / (high.value - low.value), low.length + below, high.length - above))

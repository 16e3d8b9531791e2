"""Continuation along an equilibrium path: length of the arcs, limit points located, legs that end on targets."""

import time
from dataclasses import dataclass

import numpy as np

from fenics_contact.assembly.finding import LIMIT_POINT, OUT_OF_STEPS
from fenics_contact.solvers.diagnosis import diagnose
from fenics_contact.solvers.verdict import StepFailed, Verdict

LIMIT_TOLERANCE = 1e-6  # of the largest load seen: how far a located limit point may be from the extremum
TARGET_TOLERANCE = 1e-6  # of the largest distance to the target seen: how close the run must land on it
TRIALS = 40  # arcs tried for one limit point or target; a smooth path takes 2 to 4, bisection at a kink 20


@dataclass(frozen=True)
class ArcSteps:
    """Steps of a continuation.

    first: load increment the first step aims at; largest: bound of the arc [length], about the mean displacement of a step;
    smallest: share of the first arc to which failing ones are cut; most: number of accepted steps after which the run
    gives up; iterations: tangent solves per step, and turn: angle [radians] by which the path's direction changes in a step,
    that steer the arc's length.
    """

    first: float = 0.05
    largest: float = np.inf
    smallest: float = 1e-4
    most: int = 200
    iterations: int = 5
    turn: float = 0.3


class Path:
    """Continuation of a system: accepted steps, limit points located, each leg's end on one of its targets.

    steps: ArcSteps; on_step(report, seconds, True): called after each accepted step, on all ranks.
    """

    def __init__(self, system, arc, steps, on_step):
        self.system, self.arc, self.steps, self.on_step = system, arc, steps, on_step
        self.verdict = Verdict(converged=False)
        self.highest = self.furthest = 0.0  # largest |t| and displacement [length] accepted
        self.taken = 0  # steps accepted
        self.last = None  # increment of the last accepted step

    def follow(self, targets):
        """Continue, after a first leg turning round, until a target is reached; its name. StepFailed where there is no way.

        targets: {words: function () -> distance of the state from the target, which changes its sign there}.
        """
        rate = self.arc.start(self.system, self.last)
        self.slope = rate.dt  # of the path's unit rate at the accepted state; its sign counts
        self.targets = targets
        self.spans = dict.fromkeys(targets, 0.0)  # largest distances seen
        self._measure()
        first = length = min(self.steps.first / abs(rate.dt), self.steps.largest)
        while self.taken < self.steps.most:
            start = time.perf_counter()
            arrival, reached, length = self._take(length, rate, self.steps.smallest * first)
            self._commit(arrival)
            self.on_step(arrival.report, time.perf_counter() - start, True)
            if reached:
                return reached
            turned = np.arccos(np.clip(self.arc.dot(rate, arrival.rate), -1.0, 1.0))
            rate = arrival.rate
            length = min(length * self._growth(arrival.report, turned), self.steps.largest)
            self.arc.weigh(self.furthest, self.highest)
            size = self.arc.norm(rate)  # 1 in the lengths before
            length, rate = length * size, rate.times(1.0 / size)
        why = f"{self.taken} steps reached none of: {', '.join(targets)}"
        raise StepFailed(why, OUT_OF_STEPS, remedy="allow more steps, ArcSteps(most=...), or longer ones")

    def _take(self, length, rate, smallest):
        """A step of `length` or, where that fails, of a half of it, and so on. Also returns the length that went well."""
        while True:
            try:
                return *self._step(length, rate), length
            except StepFailed:
                self._back()
                length /= 2
                if length < smallest:
                    raise
                self.verdict.cuts += 1

    def _back(self):
        """To the accepted state, tangent included: a term may predict from its last tangent."""
        self.system.rollback()
        self.system.assemble_tangent()

    def _step(self, length, rate):
        """The next state, not yet accepted, and the name of the target reached, if any; StepFailed if there is none."""
        arrival = self._arrive(length, rate)
        self._onward = arrival.rate.dt
        if arrival.rate.dt * self.slope < 0.0:
            bound = LIMIT_TOLERANCE * max(self.highest, abs(self.system.state.t))
            arrival = self._locate(
                arrival, rate, self.slope, lambda a: a.rate.dt, lambda dt, width: abs(dt) * width <= bound
            )
            arrival.report.limit_point = int(np.sign(self.slope))
        reached = None
        for name, gap in self.targets.items():
            before, now = self.gaps[name], gap()
            if now * before < 0.0 or now == 0.0:
                near = TARGET_TOLERANCE * max(self.spans[name], abs(now))
                arrival = self._locate(
                    arrival, rate, before, lambda _, gap=gap: gap(), lambda now, _, near=near: abs(now) <= near
                )
                reached = name
        return arrival, reached

    def _commit(self, arrival):
        self.system.commit()
        # a located limit point lies a hair before or behind the extremum: its own sign says nothing
        self.slope = self._onward if arrival.report.limit_point else arrival.rate.dt
        self.highest = max(self.highest, abs(self.system.state.t))
        self.furthest = max(self.furthest, self.arc.extent(self.system))
        self.taken += 1
        self.last = arrival.increment
        self._measure()
        self.verdict.accept(arrival.report, self.system)

    def _measure(self):
        self.gaps = {name: gap() for name, gap in self.targets.items()}
        self.spans = {name: max(self.spans[name], abs(gap)) for name, gap in self.gaps.items()}

    def _arrive(self, length, rate):
        arrival = self.arc.step(self.system, length, rate)
        if wrong := self.system.objection():
            raise StepFailed.of(wrong)
        return arrival

    def _growth(self, report, turned):
        """Change of the arc length: longer after few tangent solves (Ramm 1981), shorter where the path turns, in bounds."""
        solves = len(report.residuals) / (1 + report.augmentations + report.raises)
        ratio = min(self.steps.iterations / solves, self.steps.turn / max(turned, 1e-12))
        return float(np.clip(np.sqrt(ratio), 0.5, 2.0))

    def _locate(self, arrival, rate, first, value, close):
        """The arrival within this step where value(arrival) vanishes: regula falsi over arc lengths, Illinois variant
        (Dowell & Jarratt 1971, doi:10.1007/BF01934364).

        first: the value at the step's start, or its sign; close(value, width of the bracket): whether that is it.
        """
        low, high, at_low, at_high, here, kept = 0.0, arrival.length, first, value(arrival), value(arrival), 0
        solves = 0
        for _ in range(TRIALS):
            if close(here, high - low):
                arrival.report.iterations += solves
                return arrival
            solves += arrival.report.iterations
            self._back()
            place = high - at_high * (high - low) / (at_high - at_low)
            arrival = self._arrive(place, rate)
            here = value(arrival)
            if here * at_high > 0.0:
                high, at_high, at_low, kept = place, here, at_low * (0.5 if kept < 0 else 1.0), -1
            else:
                low, at_low, at_high, kept = place, here, at_high * (0.5 if kept > 0 else 1.0), 1
        raise StepFailed(f"{TRIALS} arcs did not settle on one point")


def follow(system, arc, steps, legs, on_step):
    """Continue from the system's state along its path through the legs' targets, turning round after each of them.

    legs: list of {words: function () -> distance from the target}; on_step(report, seconds, True): called after each
    accepted step, on all ranks. Returns a Verdict, not converged where a target was not reached.
    """
    path, reached = Path(system, arc, steps, on_step), []
    verdict = path.verdict
    try:
        for targets in legs:
            reached.append(path.follow(targets))
    except StepFailed as failure:
        found, t = diagnose(system, failure), system.state.t
        if found.kind == LIMIT_POINT:  # no news to a continuation: the arc was too long for the turn of its path
            found = found._replace(remedy="keep the arcs shorter: ArcSteps(first=..., largest=...)")
        verdict.stop(found, t)
    else:
        verdict.converged, verdict.reason = True, "reached " + ", then ".join(reached)
    return verdict

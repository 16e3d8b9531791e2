"""Where a continuation goes, as it is stated: its arcs, the legs and their targets, the branch it takes."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

import numpy as np

from fenics_contact.types import Ints

Leg = dict[str, Callable[[], float]]  # words of a target: distance of the state from it, which changes its sign there


@dataclass(frozen=True)
class ArcSteps:
    """Steps of a continuation, which follows the equilibrium path through its limit points, t being an unknown that may pass
    1 or fall: solve(..., steps=ArcSteps(until=...)).

    until: where it ends, the last step landing there: Load(t), Displacement(surface, axis, value), Travel(tool, axis,
    value), a function of the state (u, t, travel and angles of the tools) that changes its sign there, or a list of these,
    of which the first reached counts; back: the same for a way back along the path, with friction another one.

    first: load increment the first step aims at; largest: bound of the arc [length], about the mean displacement of a step;
    smallest: share of the first arc to which failing ones are cut; most: number of accepted steps after which the run
    gives up; iterations: tangent solves per step, to which the arc's length is steered; turn: angle [radians] by which the
    path's direction may change in a step, likewise; stations: targets like `until`, on each of which a step lands
    every time the path passes it; branch: a Branch, on which the path goes on from a bifurcation.
    """

    until: object
    _: KW_ONLY
    back: object = None
    first: float = 0.05
    largest: float = np.inf
    smallest: float = 1e-4
    most: int = 200
    iterations: int = 5
    turn: float = 0.3
    stations: Sequence[object] = ()
    branch: object = None


@dataclass(frozen=True)
class Fork:
    """Where a path is to leave itself: at the bifurcation of this number, along the null vector most like a motion of the
    owned `dofs`, so that these move `towards` (1 or -1)."""

    dofs: Ints
    towards: float
    number: int


class Route(NamedTuple):
    """Where a path goes: legs {words: function () -> distance of the state from a target, which changes its sign there},
    after each of which but the last it is followed back; stations, alike, where steps land on the way; at which bifurcation
    it takes a branch."""

    legs: list[Leg]
    stations: Leg = {}
    fork: Fork | None = None

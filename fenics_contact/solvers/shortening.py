"""How much of an increment is taken: all that lowers the force out of balance, and turns no element inside out."""

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.solvers.linear import Solution
from fenics_contact.solvers.out_of_balance import finite_residual, upright
from fenics_contact.solvers.verdict import StepFailed

SHORTEST = 1 / 64  # of a Newton step; shorter ones stall rather than converge
UPRIGHT = 6  # halvings of an increment that turns an element inside out, where nothing else shortens it


def move(system: System, increment: Solution, start: float, end: float) -> float:
    """Move from one share of an increment to another; returns the out-of-balance share there."""
    du, dq = increment
    step = du.copy()
    step.scale(end - start)
    system.update(step, (end - start) * dq, end)
    return finite_residual(system)


def put_upright(system: System, increment: Solution) -> tuple[float, float]:
    """Halve an increment until no element is inside out; returns the out-of-balance share and that of it left undone."""
    share, size = 1.0, np.inf
    for _ in range(UPRIGHT):
        size, share = move(system, increment, share, 0.5 * share), 0.5 * share
        if np.isfinite(size):
            return size, 1.0 - share
    raise StepFailed("an element turned inside out")


def shorten(system: System, increment: Solution, before: float, size: float, strict: bool) -> tuple[float, float]:
    """Where a full step does not lower the out-of-balance share, halve it while that helps; returns the one then, and what
    part of the increment was taken.

    before, size: that at its beginning and at its end. Where no part lowers it, as of nearly incompressible cells carried
    far, and there is no contact, all of it is taken. Condensed unknowns follow the tangent here. strict: halve it until it
    does lower it. A residual costs about a hundredth of a tangent solve. Where points that slip turn on its way it ends
    where the first one does.
    """
    if not strict and (turn := to_turn(system, increment)) != 0.0:
        return upright(move(system, increment, 1.0, turn)), turn
    share, whole = 1.0, size
    while size > before and share > (SHORTEST / 16 if strict else SHORTEST):
        shorter = move(system, increment, share, 0.5 * share)
        if shorter >= size and np.isfinite(size) and not strict:
            move(system, increment, 0.5 * share, share)
            break
        share, size = 0.5 * share, shorter
    else:
        # no part lowers it, and the shortest ones would creep; kinks of contacts a whole step may pass the wrong way
        if size > before and np.isfinite(whole) and not system.contact_terms:
            size, share = move(system, increment, share, 1.0), 1.0
    return upright(size), share


def to_turn(system: System, increment: Solution) -> float:
    """The share of an increment after which the first point has slid back to where it sticks; 0: none has.

    The tangent holds the direction in which a point slips. Where all slip, nothing but the body's own stiffness may hold
    it, which may be all but zero: far along such an increment many points have turned at once, and no half of it lowers
    the out-of-balance force. The first one to turn sticks in the next tangent and holds the body. Where the stiffness is
    below zero the increment leads against the force, and the body goes the other way until friction holds it.
    """
    onwards, back = system.foresight.first_turns(system.state)
    if min(onwards, back) >= 1.0:
        return 0.0
    move(system, increment, 1.0, 0.0)
    (du, dq), free = increment, system.tools.free
    gained = du.dot(system.residual_vector) + np.vdot(system.tool_residual[free], dq[free])
    move(system, increment, 0.0, 1.0)
    turn = onwards if gained < 0.0 else -back
    return turn if abs(turn) < 1.0 else 0.0

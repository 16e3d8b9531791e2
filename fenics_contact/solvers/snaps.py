"""Steps that end in balance beyond a limit point: Newton's method has led the state through a snap that it cannot follow."""

from contextlib import nullcontext

import numpy as np

from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trail import Accepted
from fenics_contact.solvers.arc_length import ArcLength
from fenics_contact.solvers.augmented import Augmented
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.motions import Drift
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.report import Stepper, StepReport
from fenics_contact.solvers.softness import AHEAD, arcs, damping, fold_ahead, load_change, where
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Floats

FAR, WANDERING = 0.1, 6  # of the force; after so many solves that leave more of it a step is looked at more closely
HALVINGS = 6  # of the step, to see whether it is the path or the step that goes so far
# Of the step's way: a sixty-fourth of the step that has more of it is a jump. Of an even path each half has a half of it, so
# that one halving tells where this is above a half
MOST = 0.51
PUSHED = 10.0  # overlaps as drawn: how far what they push apart in a first step may go
LEAP = 10.0  # times the way that the last one foresees: with no state in between to be found, no path goes so far
SNAP, MAYBE = "it has passed through a snap", "it may have passed through a snap"  # what a step is said to have done
DRIVEN = "loads or drives jump"

Place = tuple[Floats, Floats]  # displacement (local array) and tools' coordinates (tools, 6) [length]
Reached = tuple[float, Place]  # t, and the state in balance there


def wandered(system: System, report: StepReport) -> bool:
    """Whether a step took so many solves, but multipliers and springs that carry over a gap take many anyway, or went so far
    that it may have passed a snap.

    Not where the step goes on as the one before it, but for less than a jump would have of it, nor where nothing moves by
    more than rounding. Collective.
    """
    anyway = report.augmentations > 0 and (bool(system.augmented) or not _supported(system))
    many = not anyway and sum(size > FAR for size in report.residuals) >= WANDERING
    if len(system.trail.accepted) < 2:
        return many
    (old, old_q, before), (u, q, t) = system.trail.accepted[-2:]
    ratio = (system.state.t - t) / (t - before)
    start, end = _place(system, u, q), _place(system)
    foreseen = _place(system, u + ratio * (u - old), q + ratio * (q - old_q))
    way, on = _distance(system, end, start), _distance(system, foreseen, start)
    if not way > TOLERANCE * max(system.scales.farthest, system.scales.moved):
        return False
    return _distance(system, end, foreseen) > (1.0 - MOST) * way and (many or 0.0 < LEAP * on < way)


def _supported(system: System) -> bool:
    """Whether supports alone hold all bodies and tools, so that springs of the stabilisation carry nothing over a gap."""
    return not system.holds.reliant and not system.tools.free.any()


def snapped(system: System, goal: float, raised: bool) -> str | None:
    """Words on a jump that the state in balance at t = goal, not yet accepted, has behind it or may have, or None; raised:
    penalties were on the way there. Collective.

    Halves of the step, of that half and so on, each from the last accepted state, close in on the jump; where some of them
    are not solved it is one if the path before leads nowhere near the state beyond, and may be if it leads elsewhere. The
    system is left at the accepted state.
    """
    with system.grounding.away() if system.grounding and _supported(system) else nullcontext():
        return _snapped(system, goal, raised)


def _snapped(system: System, goal: float, raised: bool) -> str | None:
    """The same with the springs that are in. Collective."""
    newton = Newton(LinearSolver(system))
    stepper = Augmented(newton) if system.augmented else newton  # under old multipliers penalties give way by as much
    reached = [(t, _place(system, u, q)) for u, q, t in system.trail.accepted]
    before, low = reached[-2] if len(reached) > 1 else None, reached[-1]
    high, blocked = (goal, _place(system)), None  # blocked: the first t found that no step reaches
    if raised:
        if not _under_old_penalties(system, stepper, goal):
            return _told(system, low, high, MAYBE)
        high = goal, _place(system)
    total = _distance(system, low[1], high[1])
    for _ in range(HALVINGS):
        if _distance(system, low[1], high[1]) <= MOST * total:
            break  # no jump in between has that much of the step's way
        middle = 0.5 * (low[0] + (blocked or high[0]))
        system.trail.rollback()
        try:
            stepper.step(system, middle)
        except StepFailed:
            blocked = middle
            continue
        here = middle, _place(system)
        if _distance(system, here[1], low[1]) < _distance(system, here[1], high[1]):
            before, low = low, here
        else:
            high, blocked = here, None
    found = SNAP if _distance(system, low[1], high[1]) > MOST * total else ""
    if found and blocked:
        found = _judged(system, stepper, before, low, high, blocked)
    system.trail.rollback()
    if found and len(reached) == 1 and _farthest(system, low, high) <= PUSHED * _overlap(system):
        found = ""  # what is drawn overlapping is in no balance at the start, however short the step
    if found and _drives_jump(system, (low[0], blocked or high[0]), (system.trail.last.t, goal)):
        found = DRIVEN
    return _told(system, low, high, found) if found else None


def _overlap(system: System) -> float:
    """How deep slaves lie in their masters at the accepted state [length]. Collective."""
    gaps = [contact.response(system.state).gap.min(initial=0.0) for contact in system.contact_terms]
    return -min(system.comm.allgather(min(gaps, default=0.0)))


def _farthest(system: System, low: Reached, high: Reached) -> float:
    """How far the node or tool that moves most goes between two states [length]. Collective."""
    ways = [np.abs(after - before).max(initial=0.0) for before, after in zip(low[1], high[1], strict=True)]
    return float(max(system.comm.allgather(max(ways))))


def _under_old_penalties(system: System, stepper: Stepper, goal: float) -> bool:
    """Whether the state in balance at t = goal has one beside it under the penalties that there were, in which the system is
    then: what greater ones push apart is no part of the path. A step there may end elsewhere. Collective."""
    u, q = system.state.u.x.array.copy(), system.state.q.copy()
    system.trail.rollback()
    system.state.u.x.array[:], system.state.q[:] = u, q
    try:
        stepper.settle(system, goal)
    except StepFailed:
        system.trail.rollback()
        return False
    return True


def _judged(system: System, stepper: Stepper, before: Reached | None, low: Reached, high: Reached, blocked: float) -> str:
    """Whether what lies between the state `low` of the path and `high`, where no step reaches t = blocked, is a snap, or may
    be one: "" where the path goes on to there. Collective."""
    if before is not None and _leaps(system, before, low, high):
        return SNAP
    system.trail.rollback()
    if low[0] > system.trail.last.t:
        try:
            stepper.step(system, low[0])
        except StepFailed:
            return MAYBE
    if before is not None:
        ahead = fold_ahead(system, [Accepted(*place, t) for t, place in (before, low)])
        if ahead <= AHEAD * (blocked - low[0]):
            return SNAP
    return MAYBE if _strays(system, low, high) else ""


def _leaps(system: System, before: Reached, low: Reached, high: Reached) -> bool:
    """Whether the state `high` lies far beyond where the path from `before` to `low` leads. Collective."""
    on = _distance(system, before[1], low[1]) * (high[0] - low[0]) / (low[0] - before[0])
    return 0.0 < LEAP * on < _distance(system, low[1], high[1])


def _strays(system: System, low: Reached, high: Reached) -> bool:
    """Whether the path's rate at its state `low`, in which the system is, leads past the state `high` by as much as makes a
    step wander. Collective."""
    try:
        rate = ArcLength(LinearSolver(system, "direct", afresh=True)).start(system)
    except StepFailed:
        return True
    rate = rate.times((high[0] - low[0]) / rate.dt)
    foreseen = low[1][0] + rate.du.array_r, low[1][1] + rate.dq
    return _distance(system, high[1], foreseen) > (1.0 - MOST) * _distance(system, high[1], low[1])


def _told(system: System, low: Reached, high: Reached, found: str) -> str:
    """Words on what was found between two states. Collective."""
    du, far = system.new_vector(), _farthest(system, low, high)
    du.array[:], dq = high[1][0] - low[1][0], high[1][1] - low[1][1]
    if found == DRIVEN:
        return (
            f"{DRIVEN} near t = {low[0]:.6g}, and the state with them by {far:.3g}: where it could come to "
            "rest in several places it is Newton's choice; let them change over a time of some steps"
        )
    name, place, most = where(system, Drift(du, dq))
    ways = np.linalg.norm(dq, axis=1)
    what = f"body '{name}' at {place}" if most >= ways.max(initial=0.0) else f"tool '{system.tools.names[ways.argmax()]}'"
    jumped = f"near t = {low[0]:.6g} the state jumped by {far:.3g}, {what} farthest"
    if found == MAYBE:
        jumped = f"no shorter step past t = {low[0]:.6g} finds a state on the way to its end, {far:.3g} on, {what} farthest"
    # damping acts where a step fails, and this one has not
    shorter = f"take shorter steps; where one fails, {(*damping(system), 'damping carries it on')[0]}"
    return f"{found}: {jumped}; where it came to rest is Newton's choice: {', or '.join([*arcs(system), shorter])}"


def _drives_jump(system: System, within: tuple[float, float], step: tuple[float, float]) -> bool:
    """Whether loads, or supports and tools, go most of their way in a step between two t `within` it. Collective."""
    return any(part > MOST * whole for part, whole in zip(_driven(system, *within), _driven(system, *step), strict=True))


def _driven(system: System, start: float, end: float) -> tuple[float, float]:
    """How far loads [force], and supports and tools [length], go from one t to another at the accepted state. Collective."""
    owed = [system.begin_step(t) for t in (start, end)]
    supports, tools = (after - before for before, after in zip(*owed, strict=True))
    loads, pushes = load_change(system, start, end)
    system.trail.rollback()
    square = system.comm.allreduce(float(np.sum(supports**2))) + np.sum(tools**2)
    return float(np.hypot(loads.norm(), np.linalg.norm(pushes))), float(np.sqrt(square))


def _place(system: System, u: Floats | None = None, q: Floats | None = None) -> Place:
    """Displacement of owned nodes and tools' coordinates, of the state by default."""
    u = system.state.u.x.array if u is None else u
    q = system.state.q if q is None else q
    return u[: system.vector.getLocalSize()].copy(), q.copy()


def _distance(system: System, one: Place, other: Place) -> float:
    """Of the way between two places [length]. Collective."""
    du = system.new_vector()
    du.array[:] = one[0] - other[0]
    return system.length(du, one[1] - other[1])

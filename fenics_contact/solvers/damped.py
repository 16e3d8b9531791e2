"""A jump of the load path: loads and drives held, damped motion from the last state in balance to the next one."""

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.damping import Damping
from fenics_contact.assembly.exchange import copy_to_ghosts
from fenics_contact.assembly.system import System
from fenics_contact.solvers.entering import Entering
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.report import Stepper, StepReport
from fenics_contact.solvers.verdict import JUMPED, StepFailed
from fenics_contact.types import Array, Floats

FIRST = 1.0  # damping at first, over E V / L^2 of a body of volume V and size L: about its own stiffness
# Bounds of it. Where friction lifts a point off as soon as it touches, statuses repeat in damped motion too, until damping
# outweighs the penalty on the point's node, some hundred E/h, and with it what friction there moves: that takes some hundred
# to a thousand times (L/h)^2, 5e5 where cells are a sixteenth of the body
MOST, LEAST = 1e8, 1e-6
HARDER, SOFTER = 8.0, 0.25  # its change after a motion that failed, and after an easy one
EASY = 6  # tangents up to which it was easy, of each solve
MOTIONS = 100  # at most
FOLLOWS = 2.0  # times what drives it: where a body goes farther it does not follow, it is about to buckle
RESTING = 1e-2  # of the largest force: what damping may still carry where balance without it is tried

# displacement, q, t, poses that rotations are counted from, force scale and the terms' histories of an accepted state
Kept = tuple[Floats, Floats, float, tuple[Floats, Floats], float, list[dict[str, Array]]]


def jump(system: System, goal: float, stepper: Stepper, farthest: float = np.inf) -> StepReport:
    """Carry the system at the loads of t = goal to rest, in balance there without damping; StepReport, not yet accepted.

    farthest: the greatest motion of a node or a tool [length]; stepper: that of the run; it settles the state of rest, with
    all that a step asks for: springs that pull no more, multipliers that have taken over, penalties that hold.
    Each motion is a step of implicit Euler for viscous forces, its friction accepted as history. On failure the system is
    where it was: StepFailed. Collective.
    """
    kept = _keep(system)
    system.trail.rollback()
    origin, q, scale = _driven(system, goal), system.state.q.copy(), system.scales.accepted
    _damping(system).begin(origin, q)
    _damping(system).keep_fluids(True)
    report, moving, share, failed = StepReport(), _moving(system), FIRST, ""
    for _ in range(MOTIONS):
        try:
            moved = _settle(system, moving, goal, share)
        except StepFailed as failure:
            share, failed = HARDER * share, failure.finding.reason
            if share > MOST:
                break
            continue
        resting = _damping(system).spent(system.state)[0] <= RESTING * max(system.scales.forces, scale)
        report.add(moved)
        system.trail.commit()
        share = max(SOFTER * share, LEAST) if moved.iterations <= EASY * (1 + moved.raises) else share
        last = _at_rest(system, stepper, goal) if resting else None
        if system.state.way_from(origin, q) > farthest:
            break  # or Newton's method has led what came to rest through a snap
        if last:
            report.add(last)
            _conclude(system, report, system.state.way_from(origin, q), scale)
            return report
    _restore(system, kept)
    raise StepFailed(f"damped motion did not come to rest: {failed}" if failed else "damped motion did not come to rest")


def _moving(system: System) -> Stepper:
    """Newton's method, and fluids that come further in while the bodies move."""
    newton = Newton(LinearSolver(system))
    return Entering(newton) if system.fluids else newton


def _settle(system: System, stepper: Stepper, goal: float, share: float) -> StepReport:
    """Balance at t = goal with this damping; StepFailed, and the state as it was, if there is none."""
    _damping(system).resist(share)
    try:
        report = stepper.settle(system, goal)
        if wrong := system.acceptance.objection():
            raise StepFailed.of(wrong)
    except StepFailed:
        system.trail.rollback()
        raise
    return report


def _at_rest(system: System, stepper: Stepper, goal: float) -> StepReport | None:
    """The report of balance without damping, or None; where contact has cut a fluid off again, and there is none without
    it, with what has come in."""
    for stays in (False, True) if system.fluids else (False,):
        _damping(system).keep_fluids(stays)
        try:
            return _settle(system, stepper, goal, 0.0)
        except StepFailed:
            pass
    return None


def _driven(system: System, goal: float) -> Floats:
    """Displacement (local array) from which damping counts: that of the last state, carried on as the bodies by themselves
    follow what drives their supports to the places of t = goal. That way is no jump, nor is work done against it.
    Collective."""
    damping, u = _damping(system), system.trail.last.u.copy()
    owed, dq = system.begin_step(goal)
    most = max(system.comm.allgather(np.abs(owed).max(initial=0.0)))
    if most == 0.0:
        return u
    damping.begin(u, system.state.q)
    damping.resist(LEAST)  # bodies that nothing but contact holds stay where they are
    system.assemble_tangent([system.terms[0], damping])
    rest = system.new_vector()
    rest.set(0.0)
    try:
        ((way, _),) = LinearSolver(system, "direct", afresh=True).solve_sides(
            [(rest, np.zeros_like(dq), owed, np.zeros_like(dq))]
        )
    except LinearFailure:
        return u
    finally:
        damping.resist(0.0)
    if way.norm(PETSc.NormType.NORM_INFINITY) <= FOLLOWS * most:
        copy_to_ghosts(way)
        with way.localForm() as local:
            u += local.array_r
    return u


def _conclude(system: System, report: StepReport, way: float, scale: float) -> None:
    """What the jump was, in the report; steps go on from its end alone. way: how far it went [length]."""
    report.jumped, report.way = True, way
    _damping(system).keep_fluids(False)
    report.notes = [
        f"the state jumped by {way:.3g} {JUMPED}; where several states may follow it is the one that slow motion comes to"
    ]
    system.scales.go_by(scale)
    system.trail.accepted.clear()


def _damping(system: System) -> Damping:
    """The damping, without which nothing moves here."""
    if system.damping is None:
        raise ValueError("this System has no damping")
    return system.damping


def _keep(system: System) -> Kept:
    u, q, t = system.trail.last
    poses = system.state.poses.counted.copy(), system.state.poses.turns.copy()
    return u.copy(), q.copy(), t, poses, system.scales.accepted, [term.history() for term in system.terms]


def _restore(system: System, kept: Kept) -> None:
    u, q, t, poses, scale, histories = kept
    _damping(system).resist(0.0)
    _damping(system).keep_fluids(False)
    system.state.u.x.array[:] = u
    system.state.poses.resume(*poses)
    system.trail.resume(q, t, histories)
    system.assemble_residual()
    system.scales.go_by(scale)

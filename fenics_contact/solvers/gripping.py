"""The first solve of a step: what slid in the last one slides on, or sticks and springs back; nothing holds without load."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.system import System
from fenics_contact.solvers.increment import solve_once
from fenics_contact.solvers.linear import LinearSolver, Solution
from fenics_contact.solvers.reuse import TIGHTEST
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Bools, Floats

GRIP = 1e6  # a friction under which all that is closed sticks
MOSTLY = 0.5  # of the work of friction at all nodes and tools: it does so much of it in place of taking it
NOISE = 1e-5  # of that: less work of forces is what Newton's method has left of them
SLIGHT = 1e-8  # of how far a solve moves nodes or tools: points that lie no deeper behind it are not pressed by it

Forces = tuple[Floats, Floats]  # on dofs, and wrenches on tools (tools, 6)


def first_solve(system: System, linear: LinearSolver, du: Floats, dq: Floats, tolerance: float = TIGHTEST) -> Solution:
    """solve_once; from the last accepted state with an eye on what slides. du, dq: the motion owed. Collective.

    Points that touch and carry nothing are left out where that solve does not press them: closed, they would stick, however
    little friction nothing allows, and a tool that moves aside or off would drag or pull the body along, far from where
    nothing has happened. There friction of what was dragged is all the force there is, to which nothing converges.

    Points on the cone of friction go on sliding in this solve. Where that would have friction drive what slides, has it move
    against what the forces change by, or where nothing else holds a body or tool, the motion is about to turn: then all that
    is closed sticks in it, and the bodies spring back. Without that a tool that slid, and is pushed less from then on, is
    thrown off to where it slides the other way, or goes on as on a slope that falls.
    """
    if (increment := _let_go(system, linear, (du, dq), tolerance)) is not None:
        return increment
    state = system.state
    rough = [contact for contact in system.contact_terms if contact.rough]
    rubbing = _rubbing(system, rough) if rough else None
    if rubbing is None:
        return solve_once(system, linear, du, dq, tolerance)
    start = state.u.x.array.copy(), state.q.copy()
    changes = system.residual_vector.array.copy(), np.where(system.tools.free, system.tool_residual, 0.0)
    try:
        increment = solve_once(system, linear, du, dq, tolerance)
        if not _turns(system, rubbing, changes, (state.u.x.array - start[0], state.q - start[1])):
            return increment
    except StepFailed:  # what slides holds nothing
        pass
    state.u.x.array[:], state.q[:] = start
    system.assemble_residual()
    return solve_once(system, linear, du, dq, tolerance, {c: c.trial.with_friction(GRIP) for c in rough})


def _let_go(system: System, linear: LinearSolver, owed: tuple[Floats, Floats], tolerance: float) -> Solution | None:
    """solve_once without the points of contacts that touch and carry nothing; None, and nothing done, where there are none,
    where they alone may hold a body, where nothing is driven, or where they come to be pressed, as by how far tools are to
    go. Collective."""
    state, driven = system.state, max(np.abs(one).max(initial=0.0) for one in owed)
    idle = _idle(system) if max(system.comm.allgather(driven)) > 0.0 else {}
    if not idle:
        return None
    start = state.u.x.array.copy(), state.q.copy()
    state.q += owed[1]
    way = SLIGHT * system.state.way_from(*start)
    pressed = any(contact.forces.pressed(state, mask, way) for contact, mask in idle.items())
    state.q[:] = start[1]
    if pressed:
        return None
    try:
        increment = solve_once(system, linear, *owed, tolerance, {c: c.trial.only(~mask) for c, mask in idle.items()})
        way = SLIGHT * system.state.way_from(*start)
        if not any(contact.forces.pressed(state, mask, way) for contact, mask in idle.items()):
            return increment
    except StepFailed:  # they hold a body or a tool
        pass
    state.u.x.array[:], state.q[:] = start
    system.assemble_residual()
    return None


def _idle(system: System) -> dict[ContactTerm, Bools]:
    """{contact: which points (n,) of it touch and carry no more than rounding}, of those where none carries more; {} too
    where some body, or tool that has a force on it, may be held by nothing else. Collective."""
    state, found, bears = system.state, {}, set()
    for contact in system.contact_terms:
        idle, loaded = contact.forces.idle(state)
        touches, carries = system.comm.allreduce(np.array([idle.any(), loaded.any()], dtype=int))
        if carries:
            bears.add(contact)
        elif touches:
            found[contact] = idle
    # springs leave a body by some roundings elsewhere, and what touches is open then
    springs = system.grounding is not None and system.grounding.engaged
    if not found or springs or np.abs(system.tool_residual[system.tools.free]).max(initial=0.0) > system.scales.noise:
        return {}
    loose = system.holds.loose(lambda contact: contact.forces.could_hold(state) if contact in bears else set())
    return {} if loose else found


def _rubbing(system: System, rough: Sequence[ContactTerm]) -> Forces | None:
    """Of the friction of points that slip in the last accepted state, local dofs; None elsewhere, or where none does.
    Collective."""
    state = system.state
    slips = [contact.response(state).status.ravel() == contact.parts.laws(False)["slip"] for contact in rough]
    counts = sum(int(mask.sum()) for mask in slips), int(not np.array_equal(state.u.x.array, system.trail.last.u))
    points, elsewhere = system.comm.allreduce(np.array(counts))
    if elsewhere or not points:
        return None
    forces, wrenches = np.zeros_like(state.u.x.array), np.zeros_like(state.q)
    bare, smooth = np.zeros_like(forces), np.zeros_like(wrenches)
    for contact, mask in zip(rough, slips, strict=True):
        contact.add_residual(state, forces, wrenches, {contact: contact.parts.part(mask)})
        contact.add_residual(state, bare, smooth, {contact: contact.parts.part(mask, frictionless=True)})
    return forces - bare, wrenches - smooth


def _turns(system: System, rubbing: Forces, changes: Forces, motion: tuple[Floats, Floats]) -> bool:
    """Whether friction drives a motion, of local dofs and tools, or it goes against what the outer forces have changed by.

    changes: these, on owned dofs, and on the tools. Collective.
    """
    taken, most = (np.array([np.vdot(f, way), np.abs(f * way).sum()]) for f, way in zip(rubbing, motion, strict=True))
    dofs, tools = changes
    local = [*(taken + most), np.vdot(dofs, motion[0][: len(dofs)])]
    taken, most, gained = system.comm.allreduce(np.array(local))
    return bool(taken < -MOSTLY * most or gained + np.vdot(tools, motion[1]) > NOISE * most)

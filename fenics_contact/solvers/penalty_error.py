"""What the penalties cost: how forces and pressures would change if they grew without bound, to first order."""

import numpy as np

from fenics_contact.assembly.exchange import copy_to_ghosts, sum_to_owners
from fenics_contact.solvers.linear import LinearFailure

NUDGE = 1e-4  # of the change of displacement: small enough to leave statuses alone, far above round-off of the gaps
LINEAR = 1e-4  # relative residual of an iterative solve: the extrapolation itself is good to some percent


def penalty_error(system, linear):
    """Changes as all penalties grow without bound: {"contacts": {name: {...}}, "travel": (tools, 3)}; None if not to be had.

    With every penalty divided by theta, contact forces at a fixed displacement are proportional to 1/theta, in stick as in
    slip. So K du/dtheta = R_C at theta = 1, and dF/dtheta = -F + DF.du; a step to theta = 0 is the first-order
    extrapolation of F. Changes of the contact area and of the path before are left out. Collective.
    """
    terms = [term for term in system.terms if term.penalised]
    if not terms or not (rates := _rates(system, terms, linear)):
        return None
    du, dq = rates
    u, travel = system.state.u.x.array.copy(), system.state.travel.copy()
    values = {}
    for side in (1.0, -1.0, 0.0):  # the state itself last: that is what the terms remember
        system.state.u.x.array[:] = u + side * NUDGE * du
        system.state.travel[:] = travel + side * NUDGE * dq
        values[side] = [term.resultants(system.state) for term in terms]
    found = {}
    for term, ahead, behind, here in zip(terms, values[1.0], values[-1.0], values[0.0], strict=True):
        force, pressure = here
        to_force = force - (ahead[0] - behind[0]) / (2.0 * NUDGE)
        limit = pressure + pressure - (ahead[1] - behind[1]) / (2.0 * NUDGE)
        peak, at_limit = (max(system.comm.allgather(p.max(initial=0.0))) for p in (pressure, limit))
        found[term.name] = {"force": force, "force_change": to_force, "peak": peak, "peak_change": at_limit - peak}
    return {"contacts": found, "travel_change": -dq}


def _rates(system, terms, linear):
    """du/dtheta, a local array, and dq/dtheta of the tools' travel; None where the tangent is singular."""
    system.assemble_residual()
    system.assemble_tangent()
    residual, tools = system.residual_vector.duplicate(), np.zeros_like(system.tool_residual)
    with residual.localForm() as local:
        local.set(0.0)
        for term in terms:
            term.add_residual(system.state, local.array_w, tools)
    sum_to_owners(residual)
    residual.scale(-1.0)
    with residual.localForm() as local:
        local.array_w[system.supports.dofs] = 0.0
    residual.copy(system.residual_vector)
    system.tool_residual = -system.comm.allreduce(tools)
    try:
        du, dq = linear.solve(np.zeros(len(system.supports.dofs)), np.zeros_like(system.state.travel), LINEAR)
    except LinearFailure:
        return None
    finally:
        system.assemble_residual()
    copy = system.vector.duplicate()
    du.copy(copy)
    copy_to_ghosts(copy)
    with copy.localForm() as local:
        return local.array_r.copy(), dq

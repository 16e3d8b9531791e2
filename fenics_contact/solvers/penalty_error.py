"""What the penalties cost: how forces and pressures would change if they grew without bound."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_contact.assembly.exchange import copy_to_ghosts
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import ContactTerm
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.types import Floats, Vec

NUDGE = 1e-4  # of the penalties, over which forces are differenced: few statuses change, far above round-off of the gaps
# Of the peak pressure: a greater change is no small one, and the peak (at a corner, an edge) is the penalty's as much as the
# bodies'. With springs in series a third of the present value is half of it in truth.
UNSETTLED = 1 / 3
LINEAR = 1e-4  # relative residual of an iterative solve: the extrapolation itself is good to some percent


def penalty_error(system: System, linear: LinearSolver) -> dict[str, Any] | None:
    """Changes as all penalties grow without bound: {"contacts": {name: {...}}, "travel_change", "angle_change": (tools, 3)};
    None if not to be had.

    With s the logarithm of all penalties, K du/ds = -dR/ds and dF/ds is the change of F that is left, to first order in
    1/penalty. Contacts say what other penalties would make of them, see `Penalties.stiffened`: multipliers stay, and what
    sticks has come to rest under the same traction. Changes of the contact area and of the path before are left out. Of a
    contact: force_change (3,); load, the pressure integrated over the surface, which a resultant may cancel, and its
    load_change; peak pressure, peak_at, its reference position, and peak_change, None where it is too great for a first
    order. What is round-off, or less than a balance leaves, is zero. Collective.
    """
    terms = system.contacts
    if not terms or not (rates := _rates(system, terms, linear)):
        return None
    du, dq = rates
    u, q = system.state.u.x.array.copy(), system.state.q.copy()
    values = {}
    for side in (1.0, 0.0, -1.0):
        nudged = u + side * NUDGE * du, q + side * NUDGE * dq
        values[side] = _at(system, terms, 1.0 + side * NUDGE, *nudged)
    system.assemble_residual()  # the state itself is what the terms remember
    found, least = {}, max(ALLOWED * system.scales.largest, system.scales.noise)
    for term, ahead, behind, here in zip(terms, values[1.0], values[-1.0], values[0.0], strict=True):
        pressure, area = here[1], term.surface.area.ravel()
        to_force, to_pressure = ((a - b) / (2.0 * NUDGE) for a, b in zip(ahead, behind, strict=True))
        load, to_load = system.comm.allreduce(np.array([pressure @ area, to_pressure @ area]))
        peak, place = max(system.comm.allgather(_highest(pressure, term.spots())))
        change = max(system.comm.allgather((pressure + to_pressure).max(initial=0.0))) - peak
        found[term.name] = {"force_change": to_force, "load": load, "load_change": to_load, "peak": peak}
        found[term.name]["peak_at"] = list(place)
        found[term.name]["peak_change"] = change if abs(change) <= UNSETTLED * peak else None
        if not load > least:  # nothing presses there
            found[term.name] |= {
                "force_change": np.zeros(3),
                "load": 0.0,
                "load_change": 0.0,
                "peak": 0.0,
                "peak_change": 0.0,
            }
    dq = np.where(np.abs(dq) > ALLOWED * system.extent, dq, 0.0)
    return {"contacts": found, "travel_change": dq[:, :3], "angle_change": dq[:, 3:] / system.state.poses.lever}


def _highest(pressure: Floats, spots: Floats) -> tuple[float, tuple[float, ...]]:
    """(peak, its place) of this rank's points."""
    point = int(pressure.argmax()) if len(pressure) else -1
    return (float(pressure[point]), tuple(spots[point])) if point >= 0 else (0.0, ())


def _at(system: System, terms: Sequence[ContactTerm], factor: float, u: Floats, q: Floats) -> list[tuple[Floats, Floats]]:
    """Resultants of the terms with penalties greater by `factor` at a displacement and tools' coordinates. Collective."""
    state, place = system.state, (system.state.u.x.array.copy(), system.state.q.copy())
    trials = [term.penalties.stiffened(state, factor) for term in terms]
    state.u.x.array[:], state.q[:] = u, q
    found = [term.forces.resultants(state, trial) for term, trial in zip(terms, trials, strict=True)]
    state.u.x.array[:], state.q[:] = place
    return found


def _take(terms: Sequence[ContactTerm], trials: Sequence[Any]) -> None:
    for term, trial in zip(terms, trials, strict=True):
        term.take(trial)


def _out_of_balance(system: System, terms: Sequence[ContactTerm], trials: Sequence[Any]) -> tuple[Vec, Floats]:
    """The residual and that of the tools where the contacts are evaluated with these trials. Collective."""
    _take(terms, trials)
    system.assemble_residual()
    return system.residual_vector.copy(), system.tool_residual


def _rates(system: System, terms: Sequence[ContactTerm], linear: LinearSolver) -> tuple[Floats, Floats] | None:
    """du/ds, a local array, and dq/ds of the tools' coordinates; None where the tangent is singular.

    The whole residual is differenced: a fluid's share goes by what the contacts press with.
    """
    own = [term.trial for term in terms]
    behind, same, ahead = (
        [term.penalties.stiffened(system.state, 1.0 + side) for term in terms] for side in (-NUDGE, 0.0, NUDGE)
    )
    (force, tools), (less, tools_less) = (_out_of_balance(system, terms, trials) for trials in (ahead, behind))
    _take(terms, same)
    system.assemble_residual()
    system.assemble_tangent()
    force.axpy(-1.0, less)
    force.scale(0.5 / NUDGE)
    force.copy(system.residual_vector)
    system.tool_residual = np.divide(tools - tools_less, 2.0 * NUDGE)
    try:
        du, dq = linear.solve(np.zeros(len(system.supports.dofs)), np.zeros_like(system.state.q), LINEAR)
    except LinearFailure:
        return None
    finally:
        _take(terms, own)
        system.assemble_residual()
    copy = system.new_vector()
    du.copy(copy)
    copy_to_ghosts(copy)
    with copy.localForm() as local:
        return local.array_r.copy(), dq

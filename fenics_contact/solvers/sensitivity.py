"""How forces and pressures of contacts change with what these are evaluated with: first derivatives in an accepted state."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.exchange import copy_to_ghosts
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trial, Trials
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.types import Floats, Vec

SLIPPING = 0.5  # of the limit of friction: what slips does so on both sides of its state
NUDGE = 1e-4  # over which forces are differenced: few statuses change, far above round-off of the gaps
LINEAR = 1e-4  # relative residual of an iterative solve: an extrapolation itself is good to some percent

# The trial of a contact where a parameter differs by a number from that of the accepted state
Vary = Callable[[ContactTerm, float], Trial]
Pressures = Callable[[ContactTerm], Floats]  # of all local nodes, as the system's state has them


class ContactRates(NamedTuple):
    """Of a contact: pressure (n,) at this rank's points, its integral over the surface, load, and the rates of the force on
    the slave (3,), of the pressure and of the load with the parameter; at_nodes, to_nodes: pressures of local nodes and
    their rates, where asked for."""

    pressure: Floats
    load: float
    to_force: Floats
    to_pressure: Floats
    to_load: float
    at_nodes: Floats
    to_nodes: Floats


class Sensitivity(NamedTuple):
    """Changes by contact, and the rate of the tools' coordinates (tools, 6) [length]."""

    contacts: dict[str, ContactRates]
    tools: Floats


def sensitivities(
    system: System,
    linear: LinearSolver,
    varied: Sequence[Vary],
    tolerance: float = LINEAR,
    pressures: Pressures | None = None,
) -> list[Sensitivity] | None:
    """Of each parameter s, by one factorisation: K du/ds = -dR/ds, and dF/ds along it; None where the tangent is singular.

    tolerance: relative residual of an iterative solve; pressures: of nodes, for those who ask for them. The whole residual
    is differenced: a fluid's share goes by what the contacts press with. Collective.
    """
    if not system.contact_terms:
        return None
    with system.as_accepted():
        if (rates := _rates(system, linear, varied, tolerance)) is None:
            return None
        found = [_along(system, vary, rate, pressures) for vary, rate in zip(varied, rates, strict=True)]
        system.assemble_residual()  # the state itself is what the terms remember
    return found


def _varied(system: System, vary: Vary, s: float) -> Trials:
    """Trials at a parameter s in which points press, stick and slip as at 0: where one is on its limit of friction, or about
    to open, rates of both sides are not those of one tangent. Collective."""
    of = {term: (vary(term, s), vary(term, 0.0)) for term in system.contact_terms}
    return {term: term.multipliers.held(system.state, *trials, SLIPPING) for term, trials in of.items()}


def _along(system: System, vary: Vary, rate: tuple[Floats, Floats], pressures: Pressures | None) -> Sensitivity:
    """What changes along the rates of the displacement, a local array, and of the tools. Collective."""
    u, q, (du, dq) = system.state.u.x.array.copy(), system.state.q.copy(), rate
    places = [(s, u + s * du, q + s * dq) for s in (NUDGE, 0.0, -NUDGE)]
    ahead, here, behind = (_at(system, _varied(system, vary, s), place, pressures) for s, *place in places)
    contacts = {}
    for term, more, now, less in zip(system.contact_terms, ahead, here, behind, strict=True):
        to_force, to_pressure, to_nodes = ((a - b) / (2.0 * NUDGE) for a, b in zip(more, less, strict=True))
        area, (_, pressure, at_nodes) = term.surface.area.ravel(), now
        load, to_load = system.comm.allreduce(np.array([pressure @ area, to_pressure @ area]))
        contacts[term.name] = ContactRates(pressure, float(load), to_force, to_pressure, float(to_load), at_nodes, to_nodes)
    return Sensitivity(contacts, dq)


def _at(
    system: System, trials: Trials, place: Sequence[Floats], pressures: Pressures | None
) -> list[tuple[Floats, Floats, Floats]]:
    """Resultants of the contacts and pressures of nodes with these trials, at a displacement and tools' coordinates.
    Collective."""
    state, own = system.state, (system.state.u.x.array.copy(), system.state.q.copy())
    state.u.x.array[:], state.q[:] = place
    with system.foresight.trying(trials):
        found = [
            (*term.forces.resultants(state), pressures(term) if pressures else np.empty(0)) for term in system.contact_terms
        ]
    state.u.x.array[:], state.q[:] = own
    return found


def _out_of_balance(system: System, trials: Trials) -> tuple[Vec, Floats]:
    """The residual and that of the tools where the contacts are evaluated with these trials. Collective."""
    system.assemble_residual(trials=trials)
    return system.residual_vector.copy(), system.tool_residual.copy()


def _rates(
    system: System, linear: LinearSolver, varied: Sequence[Vary], tolerance: float
) -> list[tuple[Floats, Floats]] | None:
    """du/ds, a local array, and dq/ds of the tools' coordinates by each parameter; None where the tangent is singular."""
    trials = [[_varied(system, vary, s) for s in (NUDGE, -NUDGE)] for vary in varied]
    sides = []
    for ahead, behind in trials:
        (force, tools), (less, tools_less) = (_out_of_balance(system, at) for at in (ahead, behind))
        force.axpy(-1.0, less)
        force.scale(0.5 / NUDGE)
        sides.append((force, (tools - tools_less) / (2.0 * NUDGE), *system.still()))
    here = {term: varied[0](term, 0.0) for term in system.contact_terms}  # the tangent of what presses, not of what is held
    system.assemble_residual(trials=here)
    system.assemble_tangent(trials=here)
    try:
        return [(local(system, du), dq) for du, dq in linear.solve_sides(sides, tolerance)]
    except LinearFailure:
        return None
    finally:
        system.assemble_residual()


def local(system: System, du: Vec) -> Floats:
    """An increment of this rank's dofs, ghosts included."""
    copy = system.new_vector()
    du.copy(copy)
    copy_to_ghosts(copy)
    with copy.localForm() as local:
        return np.array(local.array_r)

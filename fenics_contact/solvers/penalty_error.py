"""What the penalties cost: how forces and pressures would change if they grew without bound."""

from typing import Any

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import foremost
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.section import Section, adding_up
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trial
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.sensitivity import ContactRates, Sensitivity, Vary, sensitivities

# Of the peak pressure: a greater change is no small one, and the peak (at a corner, an edge) is the penalty's as much as the
# bodies'. With springs in series a third of the present value is half of it in truth.
UNSETTLED = 1 / 3
OPENS = 0.5  # of a change: what points that would pull have of it, from which on no first order tells it


def stiffer(system: System) -> Vary:
    """All penalties greater by the factor 1 + s.

    With s the logarithm of all penalties, dF/ds is the change of F that is left, to first order in 1/penalty. Contacts say
    what other penalties would make of them, see `Penalties.stiffened`: multipliers stay, and what sticks has come to rest
    under the same traction. Changes of the contact area and of the path before are left out.
    """

    def vary(term: ContactTerm, s: float) -> Trial:
        return term.penalties.stiffened(system.state, 1.0 + s)

    return vary


def penalty_error(system: System, found: Sensitivity, section: Section | None) -> dict[str, Any]:
    """Changes as all penalties grow without bound, by their Sensitivity: {"contacts": {name: {...}}, "travel_change",
    "angle_change": (tools, 3)}.

    found: with pressures of nodes. Of a contact: force_change (3,); load, the pressure integrated over the surface, which a
    resultant may cancel, and its load_change; opening, with what points would pull by then, which open before; peak pressure
    of a node, peak_at, its reference position, and peak_change, None where it is too great for a first order. What is
    round-off, or less than a balance leaves, is zero, and so are forces that cancel all round the axis of a plane mesh, of a
    section. Collective.
    """
    out, least, adds_up = {}, least_load(system), adding_up(section)
    places = system.space.tabulate_dof_coordinates()
    for term in system.contact_terms:
        change = found.contacts[term.name]
        highest = foremost(system.comm, change.at_nodes, places)
        peak = highest.value if highest else 0.0
        after = max(system.comm.allgather((change.at_nodes + change.to_nodes).max(initial=0.0)))
        grown = after - peak if abs(after - peak) <= UNSETTLED * peak else None
        pressed = {"load": change.load, "load_change": change.to_load, "peak": peak, "peak_change": grown}
        pressed["opening"] = _opening(system, term, change)
        if not change.load > least:  # nothing presses there
            pressed = dict.fromkeys(pressed, 0.0)
        force = np.where(adds_up & (change.load > least), change.to_force, 0.0)
        out[term.name] = {"force_change": force, "peak_at": highest.place.tolist() if highest else []} | pressed
    dq = np.where(np.abs(found.tools) > ALLOWED * system.extent, found.tools, 0.0)
    return {"contacts": out, "travel_change": dq[:, :3], "angle_change": dq[:, 3:] / system.state.poses.lever}


def penalty_costs(system: System, linear: LinearSolver) -> dict[str, float]:
    """By contact the part of its load by which that, or its force, would change were all penalties endless, to first order;
    {} where the tangent is singular, and none of a contact where points that would pull by then, and open before, have most
    of that. Collective."""
    found, least, costs = sensitivities(system, linear, [stiffer(system)]), least_load(system), dict[str, float]()
    if found is None:
        return costs
    for term in system.contact_terms:
        change = found[0].contacts[term.name]
        most = max(float(np.linalg.norm(change.to_force)), abs(change.to_load))
        if change.load > least and _opening(system, term, change) < OPENS * most:
            costs[term.name] = most / change.load
    return costs


def _opening(system: System, term: ContactTerm, change: ContactRates) -> float:
    """Force with which points would pull were all penalties endless, to first order. Collective."""
    pulls = np.minimum(change.pressure + change.to_pressure, 0.0) @ term.surface.area.ravel()
    return -float(system.comm.allreduce(pulls))


def least_load(system: System) -> float:
    """Load [force] of a contact that is none: what a balance leaves, and round-off."""
    return max(ALLOWED * system.scales.largest, system.scales.noise)

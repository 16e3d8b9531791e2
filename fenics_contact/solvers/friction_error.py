"""What it costs that friction is linear between nodes: how loads would change, were it at its limit where it turns round."""

from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import foremost
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trial
from fenics_contact.solvers.penalty_error import least_load
from fenics_contact.solvers.sensitivity import Sensitivity, Vary
from fenics_contact.types import Floats

LITTLE = 1e-3  # of a contact's friction, at its limit: less of it between nodes moves nothing that is told of


class BetweenNodes(NamedTuple):
    """By contact, what places between nodes rub with more (np, 3), and the reference position [length] around which that is
    most."""

    more: dict[str, Floats]
    place: dict[str, list[float]]


def between_nodes(system: System) -> BetweenNodes | None:
    """None where all there is between nodes rubs as they do, but for what no force feels. Collective."""
    found, some = BetweenNodes({}, {}), False
    for term in system.contact_terms:
        more, sizes = term.findings.between_nodes(system.state)
        first = foremost(system.comm, sizes, term.spots())
        found.more[term.name], found.place[term.name] = more, first.place.tolist() if first else []
        total, (_, limit) = sizes.sum(), term.forces.grip(system.state)
        all_of, limits = system.comm.allreduce(np.array([total, limit]))
        some = some or bool(all_of > max(LITTLE * limits, least_load(system)))
    return found if some else None


def at_limits(system: System, found: BetweenNodes) -> Vary:
    """Places between nodes rub by s times what they would more at their limit."""

    def vary(term: ContactTerm, s: float) -> Trial:
        return term.penalties.stiffened(system.state, 1.0).rubbing(s * found.more[term.name])

    return vary


def friction_error(system: System, between: BetweenNodes, found: Sensitivity) -> dict[str, tuple[float, list[float]]]:
    """{contact: (change of its load over that, to first order, and the place as of BetweenNodes)}; of contacts without
    load or friction nothing. Collective."""
    out, least = {}, least_load(system)
    for term in system.contact_terms:
        change = found.contacts[term.name]
        if term.rough and change.load > least:
            out[term.name] = change.to_load / change.load, between.place[term.name]
    return out

"""What nodes cost that lie deeper than the points beside them: how loads would change, were they held as these are."""

from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trial
from fenics_contact.solvers.penalty_error import least_load
from fenics_contact.solvers.sensitivity import Sensitivity, Vary
from fenics_contact.types import Floats

WITHIN = 10.0  # times the penalty's penetration: gaps that `sensitivities` changes by 1e-3 of it change no point's status


class Deeper(NamedTuple):
    """By contact, how much deeper (ne, nq) [length] than the points nodes lie there; part: of that, which a rate is for."""

    depths: dict[str, Floats]
    part: float


def deeper(system: System) -> Deeper | None:
    """None where no node lies deeper than what a penalty lets points sink in by, of which the penalty error tells.
    Collective."""
    depths, part = {}, np.inf
    for term in system.contact_terms:
        depths[term.name] = by = term.findings.nodes_deeper(system.state)
        pressure, _ = term.forces.split_traction(system.state)
        here = by.max(initial=0.0), (pressure / term.trial.law.eps_n[:, None]).max(initial=0.0)
        depth, penetration = np.max(system.comm.allgather(here), axis=0)
        if depth > penetration > 0.0:
            part = min(part, WITHIN * penetration / depth)
    return Deeper(depths, part) if part < np.inf else None


def lifted(system: System, found: Deeper) -> Vary:
    """Points hold the deepest nodes of their facets out of the master in place of themselves, with s = 1 by `part`."""

    def vary(term: ContactTerm, s: float) -> Trial:
        return term.penalties.stiffened(system.state, 1.0).nearer(s * found.part * found.depths[term.name])

    return vary


def node_error(system: System, nodes: Deeper, found: Sensitivity) -> dict[str, tuple[float, float | None]]:
    """{contact: (change of its load over that, to first order, and how much deeper [length] than points nodes lie)}, None
    where points are nodes, of which steps have said how deep others lie; of contacts without load nothing. Collective."""
    out, least = {}, least_load(system)
    for term in system.contact_terms:
        change, depth = found.contacts[term.name], nodes.depths[term.name].max(initial=0.0)
        if change.load > least:
            deep = float(max(system.comm.allgather(depth)))
            out[term.name] = change.to_load / nodes.part / change.load, None if term.surface.at_nodes else deep
    return out

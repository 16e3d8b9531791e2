"""What straight cells cost where they stand for round surfaces: how loads would change with what these cut off."""

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.scales import ROUNDED
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trial
from fenics_contact.solvers.penalty_error import least_load
from fenics_contact.solvers.sensitivity import Sensitivity, Vary


def rounder(system: System) -> Vary:
    """All gaps smaller by s times what facets cut off there: with s = 1 those of the round surfaces, on average."""

    def vary(term: ContactTerm, s: float) -> Trial:
        return term.penalties.stiffened(system.state, 1.0).nearer(s * term.places.cut_off(system.state))

    return vary


def is_round(system: System) -> bool:
    """Whether surfaces that press differ from their facets by more than round-off. Collective."""
    here = [np.abs(term.places.cut_off(system.state)).max(initial=0.0) for term in system.contact_terms]
    return max(system.comm.allgather(max(here, default=0.0))) > ROUNDED * system.extent


def chord_error(system: System, found: Sensitivity) -> dict[str, tuple[float, float]]:
    """{contact: (change of its load over that, to first order, and the greatest distance [length] of round surfaces from
    the facets that press, 0 of round-off)}; of contacts without load nothing. Collective."""
    out, least = {}, least_load(system)
    for term in system.contact_terms:
        change = found.contacts[term.name]
        off = np.where(change.pressure > 0.0, np.abs(term.places.cut_off(system.state)).ravel(), 0.0)
        most = max(system.comm.allgather(off.max(initial=0.0)))
        if change.load > least:
            out[term.name] = change.to_load / change.load, most if most > ROUNDED * system.extent else 0.0
    return out

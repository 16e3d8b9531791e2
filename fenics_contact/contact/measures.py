"""What a contact's slave points add up to at a state: forces, slips, counts over all ranks, and what penalties store."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.contact.on_facets import PlacesOnFacets
from fenics_contact.kernels.status import OPEN, STICK
from fenics_contact.types import Bools, Floats

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact


def contact_measures(contact: Contact, state: State) -> dict[str, Any]:
    """Sums over a contact's points, by name. Collective.

    force (3,), moment (3,): of the forces that act at the slave body's nodes, about point (3,), the tool's own or the slave
    surface's centroid [force, force x length]; friction (3,): the part of the force that friction gives; load: the pressure
    integrated over the surface [force]; slip: (greatest, mean over what has been in contact) way slid [length];
    penetration [length]; active, sticking, points: counts.
    """
    s, comm, response = contact.surface, state.comm, contact.response(state)
    x = s.points_at(state.u.x.array)
    pressure, friction = contact.forces.acting(state)
    status, h = contact.forces.status(state), contact.trial.history
    closed = status != OPEN
    # at the nodes: an average acts through the samples around its node, and not where that is
    places, forces = contact.partner.on_slave(contact.places.feet(state), response)
    met = np.where(h.met, s.area, 0.0)
    sums = comm.allreduce(
        np.concatenate([
            forces.sum(axis=0),
            np.cross(places, forces).sum(axis=0),
            (friction * s.area[..., None]).sum(axis=(0, 1)),
            (x * s.area[..., None]).sum(axis=(0, 1)),
            [s.area.sum(), (pressure * s.area).sum(), met.sum(), (met * h.slip_path).sum()],
            [closed.sum(), (status == STICK).sum(), s.area.size],
        ])
    )  # fmt: skip
    resultant, whole, met_area = sums[:3], max(sums[12], 1e-300), max(sums[14], 1e-300)
    about = contact.places.point(state)
    about = sums[9:12] / whole if about is None else about
    greatest = max(comm.allgather(h.slip_path.max(initial=0.0)))
    return {
        "force": resultant,
        "moment": sums[3:6] - np.cross(about, resultant),
        "point": about,
        "friction": sums[6:9],
        "load": sums[13],
        "slip": (greatest, sums[15] / met_area),
        "active": int(sums[16]),
        "sticking": int(sums[17]),
        "points": int(sums[18]),
        "penetration": _penetration(state, response, closed, h.shift),
    }


def within_facets(contact: Contact, state: State) -> float:
    """Share of the mean squares of a contact's pressures over facets of the master, each of these counted alike, that varies
    within them: what facets resolve varies from one to the next. Zero of tools of formulas. Collective."""
    if not isinstance(contact.places, PlacesOnFacets):
        return 0.0
    points, facets, areas = contact.places.meets(contact.places.feet(state))
    pressure = np.maximum(contact.forces.acting(state)[0].ravel()[points], 0.0)
    comm, weights = state.comm, (areas, areas * pressure, areas * pressure**2)
    count = max(comm.allgather(int(facets.max(initial=-1)))) + 1
    area, load, squares = comm.allreduce(np.array([np.bincount(facets, each, count) for each in weights]))
    means, squares = (np.divide(of, area, out=np.zeros(count), where=area > 0.0) for of in (load, squares))
    return float(1.0 - means @ means / squares.sum()) if squares.any() else 0.0


def _penetration(state: State, response: Response, closed: Bools, shift: Floats) -> float:
    """How far [length] the deepest closed point lies in the master. Collective."""
    comm = state.comm
    whole = closed & (response.cover >= 1.0)  # points half out over an end are meant to sink in
    if not comm.allreduce(int(whole.sum())):  # of all of them what the penalty gives way, without the body's spring
        whole = closed
    held = (response.cover * (response.gap + shift) - shift)[whole]
    return max(comm.allgather(0.0 - held.min(initial=0.0)))


def stored_energy(contact: Contact, state: State, trial: Trial) -> float:
    """Energy [force x length] in the penalties at this rank's points. Multipliers hold without giving way: what they carry
    stores none, and with them friction does not either."""
    s, response = contact.surface, contact.response(state, trial)
    pressure, friction = contact.forces.split_traction(state, trial)
    stored = np.where(response.status != OPEN, 0.5 * pressure * np.maximum(-response.gap, 0.0), 0.0)
    if trial.rough and contact.penetration is None:
        stiff = trial.law.eps_t[:, None] * np.where(response.cover > 0.0, response.cover, 1.0)
        stored = stored + 0.5 * np.einsum("eqc,eqc->eq", friction, friction) / stiff
    return float((stored * s.area).sum())

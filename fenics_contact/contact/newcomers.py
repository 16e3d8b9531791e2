"""Points that come to touch within a step: how much of their friction is of their way through the air."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.contact_term import Newcomers
from fenics_contact.assembly.term import State
from fenics_contact.contact.unit import unit

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

ALL = 0.95  # of a contact's load on points that come in: it had none before
SHEARED = 0.1  # of what resists pressing in: what resists a way aside, of a block that bends, too


def first_touch(contact: Contact, state: State) -> Newcomers:
    """Of the points that were open when the step began, where all of the load is on such. Collective.

    The way of such a point counts as slip from where the step began. Had it stuck once it touched, body and master would
    have gone on against each other in the direction in which they came: friction to pressure were as the way aside to the
    gap, times what resists either. Its sum, or what it turns them by, is what a body gets of it.
    """
    s, trial, response, comm = contact.surface, contact.trial, contact.response(state), state.comm
    pressure, friction = contact.forces.split_traction(state)
    loads, (gaps, before) = np.maximum(pressure, 0.0) * s.area, (of.reshape(s.area.shape) for of in trial.history.gaps)
    comes = contact.forces.idle(state)[1].reshape(s.area.shape) & (gaps > trial.law.touch)
    x = np.einsum("eqk,ekc->eqc", s.a, s.X + state.u.x.array.reshape(-1, 3)[s.nodes])[comes]
    load, came, *middle = comm.allreduce(np.array([loads.sum(), loads[comes].sum(), *(loads[comes] @ x)]))
    if came <= ALL * load:
        return Newcomers(0.0, float(load), (0.0, 0.0), np.zeros(3))
    size = np.linalg.norm(friction, axis=2)
    way = contact.partner.anchors.slid(contact.places.feet(state), trial, response.status)[0]
    way = way + size / s.stiffness[:, None]  # and what friction has kept it from
    explained = SHEARED * pressure * way / np.where(comes, gaps, 1.0)
    more = np.maximum(size - explained, 0.0) / np.where(size > 0.0, size, 1.0)
    along = (friction * (s.area * more)[..., None])[comes]
    arms = x - np.array(middle) / came
    weighed = [loads[comes] @ of for of in (np.square(arms).sum(axis=1), gaps[comes], before[comes])]
    normal = loads[comes] @ contact.forces.normals(state)[comes]
    sums = comm.allreduce(np.array([*along.sum(axis=0), *np.cross(arms, along).sum(axis=0), *weighed, *normal]))
    square, then, earlier = sums[6:9] / came
    turns = np.linalg.norm(sums[3:6]) / np.sqrt(square) if square > 0.0 else 0.0
    rubs = max(float(np.linalg.norm(sums[:3])), float(turns))
    return Newcomers(rubs, float(load), (float(then), float(earlier)), unit(sums[9:]))

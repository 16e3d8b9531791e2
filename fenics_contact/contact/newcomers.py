"""Points that come to touch within a step: how much of their friction is of their way through the air."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.contact_term import Leads, Newcomers
from fenics_contact.assembly.term import State
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.status import STICK
from fenics_contact.types import Bools

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

ALL = 0.95  # of a contact's load on points that come in: it had none before
SHEARED = 0.1  # of what resists pressing in: what resists a way aside, of a block that bends, too
SHORT = 0.005  # of a cell's height: ways aside that matter little
STEEP = 0.2  # of the way nearer: with more of it aside points come on a flank, of which the other may be opposite


def first_touch(contact: Contact, state: State, leads: Leads) -> Newcomers:
    """Of the points that were open when the step began and are led aside. Collective.

    The way of such a point counts as slip from where the step began. Had it stuck once it touched, body and master would
    have gone on against each other in the direction in which they came: friction to pressure were as the way aside to the
    gap, times what resists either. Its sum, or what it turns them by, is what a body gets of it. What comes from farther
    than is searched may rest, or rub in any direction. Beside others that press what slides rubs as it should, so that what
    sticks alone is asked for, and where surfaces as a whole are led aside: of straight ways what is left over cancels.
    """
    s, trial, response, comm = contact.surface, contact.trial, contact.response(state), state.comm
    pressure, friction = contact.forces.split_traction(state)
    gaps, earlier = (of.reshape(s.area.shape) for of in trial.history.gaps)
    loads, had = np.maximum(pressure, 0.0) * s.area, trial.law.eps_n[:, None] * np.maximum(-gaps, 0.0) * s.area
    comes = contact.forces.idle(state)[1].reshape(s.area.shape) & (gaps > trial.law.touch)
    x = s.points_at(state.u.x.array)[comes]
    sums = np.array([loads.sum(), had.sum(), loads[comes].sum(), *(loads[comes] @ x)])
    load, had_load, came, *middle = comm.allreduce(sums)
    if came <= 0.0:
        return Newcomers(0.0, 0.0, 0.0, float(load), (0.0, 0.0))
    size = np.linalg.norm(friction, axis=2)
    way = contact.partner.anchors.slid(contact.places.feet(state), trial, response.status)[0]
    way = way + size / s.stiffness[:, None]  # and what friction has kept it from
    explained = SHEARED * pressure * way / np.where(comes, gaps, 1.0)
    more = np.maximum(size - explained, 0.0) / np.where(size > 0.0, size, 1.0)
    normals, short = contact.forces.normals(state)[comes], SHORT * s.cell_height
    mean, along = unit(comm.allreduce(loads[comes] @ normals))[None], (friction * (s.area * more)[..., None])[comes]
    if came <= ALL * load or had_load > (1.0 - ALL) * load:
        sticks = (response.status == STICK).reshape(comes.shape)[comes] & (leads.across(mean) > short)
        beside = np.linalg.norm(comm.allreduce(along[sticks].sum(axis=0)))
        return Newcomers(0.0, 0.0, float(beside), float(load), (0.0, 0.0))
    # all points are led aside as the surfaces are, and each on a flank
    across = leads.across(normals)
    aside = (leads.across(mean) > short) | ((across > STEEP * leads.along(normals)) & (across > short))
    arms, far = x - np.array(middle) / came, gaps[comes] >= contact.places.search
    square, then, before = (
        comm.allreduce(np.array([loads[comes] @ of for of in (np.square(arms).sum(axis=1), gaps[comes], earlier[comes])]))
        / came
    )

    def rubs(points: Bools) -> float:
        unknown = (contact.forces.limits(state) * s.area)[comes] @ (far & points)
        force, turn = along[points].sum(axis=0), np.cross(arms, along)[points].sum(axis=0)
        sums = comm.allreduce(np.array([*force, *turn, unknown]))
        turns = np.linalg.norm(sums[3:6]) / np.sqrt(square) if square > 0.0 else 0.0
        return max(float(np.linalg.norm(sums[:3])), float(turns), float(sums[6]))

    return Newcomers(rubs(aside), rubs(np.ones_like(aside)), 0.0, float(load), (float(then), float(before)))

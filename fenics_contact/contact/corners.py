"""Inner corners of unions: a point there has one foot, on the part that is nearer, where two parts should hold it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.finding import UNKNOWN, Finding
from fenics_contact.assembly.term import State
from fenics_contact.contact.foremost import worst
from fenics_contact.contact.passing import at_start, tool_distances, tool_normals
from fenics_contact.contact.rigid_places import RigidPlaces
from fenics_contact.contact.tools import parts_of
from fenics_contact.kernels.rigid_shapes import UNION
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

NEAR = 0.05  # of a cell's height: a point that is no farther from a second part meets it about now
ALIKE = 0.99  # cosine of normals of two parts from which on either holds a point as the other does
APART = "state its parts as tools in contacts of their own, moved alike, or a profile with a fillet there"


def cornered(contact: Contact, state: State, by: Floats | None = None) -> Finding | None:
    """None, or the Finding that a point lies where two parts of a union meet; by (3,): one that is no farther from there
    than a cell's height, in the reference. Collective."""
    places, s = contact.places, contact.surface
    if not isinstance(places, RigidPlaces) or places.tool.kind != UNION:
        return None
    feet = places.feet(state)
    x = feet.pose.before((s.a @ feet.x).reshape(-1, 3))
    parts = [at_start(part) for part in parts_of(places.tool)]
    gaps, normals = (np.array([of(x, part) for part in parts]) for of in (tool_distances, tool_normals))
    nearest = normals[gaps.argmin(axis=0), np.arange(len(x))]
    aside = np.einsum("pnc,nc->pn", normals, nearest) < ALIKE
    second = np.where(aside, gaps, np.inf).min(axis=0, initial=np.inf)
    if by is not None:
        second = np.where(np.linalg.norm(contact.spots() - by, axis=1) <= s.cell_height, second, np.inf)
    near, place = worst(contact, state.comm, -second, above=(least := -NEAR * s.cell_height))
    if near <= least:
        return None
    text = f"a point lies in an inner corner of '{contact.master_name}', of whose parts the nearest alone holds it"
    return Finding(UNKNOWN, text, place, APART)

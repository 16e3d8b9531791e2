"""What of a master reaches past the faces of pairs, and so presses nothing there: contact ends at them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import Foremost, Remark, foremost, spot
from fenics_contact.assembly.pairs import HERE, Image
from fenics_contact.assembly.term import State
from fenics_contact.contact.node_places import NodePlaces
from fenics_contact.contact.passing import tool_distances
from fenics_contact.contact.point_places import PointPlaces
from fenics_contact.contact.rigid_places import RigidPlaces
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from fenics_contact.assembly.system import System

IMAGES = "past faces of pairs"  # by which a run remembers what it has said of these
INSIDE = 1e-3  # of a cell's height: an image that lies deeper in a master than what presses there is left out
MISSED = 0.01  # of the area that should press: what more of it lies past faces of pairs is worth a note


def images_note(system: System) -> dict[str, Remark]:
    """By contact what is to be said of a master in which neighbours, where pairs of faces put them, lie deeper than what it
    presses here: a tool or body that repeats presses both alike, so does a tool of which the image is one. Collective."""
    if system.supports.pairs is None:
        return {}
    state, comm, pairs = system.state, system.comm, system.supports.pairs
    images = pairs.images(pairs.ways(state.t))
    pressed, remarks = np.zeros(len(state.u.x.array) // 3), dict[str, Remark]()
    own = [_depths(contact, state, HERE) for contact in system.contacts]
    for contact, depth in zip(system.contacts, own, strict=True):
        np.maximum.at(pressed, contact.surface.nodes, depth.max(axis=1, initial=0.0)[:, None])
    for contact, depth in zip(system.contacts, own, strict=True):
        s, here = contact.surface, pressed[contact.surface.nodes].max(axis=1, initial=0.0)[:, None]
        beyond = np.max([_depths(contact, state, image) for image in images], axis=0) - here
        inner = np.einsum("eqk,ek->eq", s.a, ~pairs.on_faces[s.nodes]) > 0.0  # what presses one face presses the other
        left_out = inner & (beyond > INSIDE * s.cell_height)
        missed, met = comm.allreduce(np.array([s.area[left_out].sum(), s.area[~left_out & (depth > 0.0)].sum()]))
        if not missed > MISSED * (missed + met):
            continue
        share = missed / (missed + met)
        if found := foremost(
            comm, np.where(left_out, beyond, 0.0).ravel(), np.einsum("eqk,ekc->eqc", s.a, s.X).reshape(-1, 3)
        ):
            remarks[contact.name] = Remark(share, _words(contact, share, found))
    return remarks


def _words(contact: ContactTerm, share: float, found: Foremost) -> str:
    remedy = "state several cells as one: the share falls with their number"
    if contact.partner.grounded:
        remedy = "state its image, one cell or sector on, as a second tool that moves alike"
    return (
        f"contact '{contact.name}' at {spot(found.place)}: the neighbour that a pair of faces stands for lies "
        f"{found.value:.3g} deep in '{contact.master_name}', which reaches past these faces, and contact ends there: "
        f"{share:.0%} of the area that should press does not, and the force is too small; {remedy}"
    )


def _depths(contact: ContactTerm, state: State, image: Image) -> Floats:
    """How deep (ne, nq) an image of the slave points would lie in the master [length], none of what has no partner."""
    places, feet = contact.places, contact.places.feet(state)
    if isinstance(places, NodePlaces | PointPlaces):
        gaps = places.gaps_of(image, feet)
    elif isinstance(places, RigidPlaces):
        x = np.einsum("eqk,ekc->eqc", contact.surface.a, feet.x).reshape(-1, 3)
        gaps = tool_distances(image.of(x), places.tool_at(feet.pose))
    return np.maximum(-gaps, 0.0).reshape(contact.surface.area.shape)

"""What of a master reaches past the faces of pairs, and so presses nothing there: contact ends at them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import Foremost, Remark, foremost, spot
from fenics_contact.assembly.pairs import HERE, Image
from fenics_contact.contact.repeats import Repeats, gaps_at
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from fenics_contact.assembly.system import System

IMAGES = "past faces of pairs"  # by which a run remembers what it has said of these
INSIDE = 1e-3  # of a cell's height: an image that lies deeper in a master than what presses there is left out
DEEPER = 3.0  # times as deep as contacts press here: of two bodies that are each other's images one hangs lower
MISSED = 0.01  # of the area that should press: what more of it lies past faces of pairs is worth a note


class Images:
    """What slave points' neighbours, where pairs of faces put them, may lie in. Construction is collective.

    What lay in a master before anything had moved, deeper than slave points themselves, is not pressed by it: it stands for
    the neighbour, as a plane between two bodies that meet alike does.
    """

    def __init__(self, system: System) -> None:
        self._system, self._pairs = system, system.supports.pairs
        if self._pairs is None:
            return
        self._repeats = Repeats(system, self._pairs)
        images = self._repeats.images
        self._drawn = []  # of each contact and image (images, ne, nq): whether points lay in the master from the start
        for contact in system.contact_terms:
            at = self._repeats.feet[contact.name]
            own = max(system.comm.allgather(_depths(contact, at, HERE).max(initial=0.0)))
            allowed = own + INSIDE * contact.surface.cell_height
            self._drawn.append(np.array([_depths(contact, at, image) > allowed for image in images]))

    def remarks(self) -> dict[str, Remark]:
        """By contact what is to be said of a master in which neighbours lie far deeper than any contact presses points
        here: a tool or body that repeats presses both alike, and so does a tool of which the image is one; by tools what
        is to be said of those that do not move so. Collective."""
        if self._pairs is None:
            return {}
        system, moved = self._system, self._repeats.remarks()
        remarks = {f"tools {', '.join(names)}": remark for names, remark in moved.items()}
        state, images = system.state, self._pairs.images(system.state.t)
        pressed = np.zeros(len(state.u.x.array) // 3)
        feet = [contact.places.feet(state) for contact in system.contact_terms]
        own = [_depths(contact, at, HERE) for contact, at in zip(system.contact_terms, feet, strict=True)]
        for contact, depth in zip(system.contact_terms, own, strict=True):
            np.maximum.at(pressed, contact.surface.nodes, depth.max(axis=1, initial=0.0)[:, None])
        for contact, at, depth, drawn in zip(system.contact_terms, feet, own, self._drawn, strict=True):
            s, there = contact.surface, np.array([_depths(contact, at, image) for image in images])
            # what presses one face of a pair presses the other
            inner = np.einsum("eqk,ek->eq", s.a, ~self._pairs.on_faces[s.nodes]) > 0.0
            beyond = np.where(inner, np.where(drawn, 0.0, there).max(axis=0), 0.0)
            here = pressed[s.nodes].max(axis=1, initial=0.0)[:, None]
            left_out = beyond > np.maximum(DEEPER * here, INSIDE * s.cell_height)
            missed, met = system.comm.allreduce(np.array([s.area[left_out].sum(), s.area[depth > 0.0].sum()]))
            if not missed > MISSED * (missed + met) or any(contact.master_name in names for names in moved):
                continue
            share = missed / (missed + met)
            met_twice = system.comm.allreduce(int((left_out & (depth > 0.0)).sum())) > 0  # the tool's image would lie in it
            alone = contact.partner.grounded and (met_twice or self._repeats.itself(contact))
            if found := foremost(
                system.comm, np.where(left_out, beyond, 0.0).ravel(), np.einsum("eqk,ekc->eqc", s.a, s.X).reshape(-1, 3)
            ):
                remarks[contact.name] = Remark(share, _words(contact, share, found, alone))
        return remarks


def _words(contact: ContactTerm, share: float, found: Foremost, alone: bool) -> str:
    """alone: whether it is a tool beside which there is no room for its image."""
    remedy = "state several cells as one: the share falls with their number"
    if alone:
        remedy = "its image, one cell or sector on, would lie in it: let it be that image, as a shaft on the axis is"
    elif contact.partner.grounded:
        remedy = (
            "state its image, one cell or sector on, too: as a second tool that moves alike, or, of one that is pushed, "
            "both as a rigid_union"
        )
    return (
        f"contact '{contact.name}' at {spot(found.place)}: the neighbour that a pair of faces stands for lies "
        f"{found.value:.3g} deep in '{contact.master_name}', which reaches past these faces, and contact ends there: "
        f"{share:.0%} of the area that should press does not, and the force may be off; {remedy}"
    )


def _depths(contact: ContactTerm, feet: Any, image: Image) -> Floats:
    """How deep (ne, nq) an image of the slave points at `feet` would lie in the master [length]. Collective."""
    return np.maximum(-gaps_at(contact, feet, image), 0.0)

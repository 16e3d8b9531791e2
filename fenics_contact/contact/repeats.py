"""Tools that pairs of faces put on themselves, or on one another: on the whole they are one body, or move alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import Remark
from fenics_contact.assembly.pairs import HERE, Image, Pairs
from fenics_contact.assembly.term import State
from fenics_contact.contact.node_places import NodePlaces
from fenics_contact.contact.on_facets import PlacesOnFacets
from fenics_contact.contact.point_places import PointPlaces
from fenics_contact.contact.rigid_places import RigidPlaces, distances_to, pressed
from fenics_contact.types import Bools, Floats

if TYPE_CHECKING:
    from fenics_contact.assembly.system import System

ITSELF = 0.01  # of a cell's height: by so much a tool may lie beside its own image, as meshed round ones do
PLACED = 1e-3  # of a cell's height: by so much a second tool may lie beside the image of a first
ASIDE = 0.01  # of a tool's way: less is what balance leaves
ROUNDED = 1e-9  # of the bodies' size
ALIKE = (
    "on the next cell or sector it would go another way, and the whole would not; with a cyclic pair let it move along the "
    "axis, and turn about it, alone, with a periodic one travel, and turn about the way from face to face, and leave "
    "relative= out where it is rough"
)
TURNED = "move both alike, with a cyclic pair turned with the sector, or, pushed ones over a periodic pair, as a rigid_union"


class Repeats:
    """Which tools are their own images at the start, or those of others. Construction is collective.

    images: `Pairs.images` then; feet: of all contacts then; links: of contacts with tools, one of which the images of these
    numbers put on the other's, or on itself.
    """

    def __init__(self, system: System, pairs: Pairs) -> None:
        self._system, self._pairs = system, pairs
        self._rest = State(compat.Function(system.space), np.zeros_like(system.state.q), system.tools.poses())
        self.feet = {contact.name: contact.places.first_feet(self._rest) for contact in system.contact_terms}
        self.images, self._X = pairs.images(0.0), system.space.tabulate_dof_coordinates()
        self.links: list[tuple[ContactTerm, ContactTerm, list[int]]] = []
        tools = [contact for contact in system.contact_terms if contact.partner.grounded]
        for one in tools:
            own = [k for k, image in enumerate(self.images) if self._itself(one, image)]
            self.links.append((one, one, own))
            for other in tools:
                known = range(len(self.images)) if one.master_name != other.master_name else ()
                if there := [k for k in known if k not in own and self._placed(one, other, self.images[k])]:
                    self.links.append((one, other, there))

    def itself(self, contact: ContactTerm) -> bool:
        """Whether its tool is its own image, by any."""
        return any(own for one, other, own in self.links if one is other is contact)

    def remarks(self) -> dict[tuple[str, str], Remark]:
        """By two tools' names, or twice one's, what is to be said of them where they do not move alike. Collective."""
        found, x = dict[tuple[str, str], Remark](), self._X + self._system.state.u.x.array.reshape(-1, 3)
        now = self._pairs.images(self._system.state.t)
        for one, other, numbers in self.links:
            held = pressed(self._system.space, [one])
            # beneath a smooth lid what is stretched may slide
            then = self.images if one.rough or one is not other else now
            most, size = self._at_faces(one, x, held) if one is other else (0.0, 0.0)
            for k in numbers:
                apart, way = self._apart((one, other), x[held], now[k], then[k])
                most, size = max(most, apart), max(size, way)
            if not most > max(ASIDE * size, ROUNDED * self._system.extent):
                continue
            name, second = one.master_name, other.master_name
            text = (
                f"tool '{name}', which repeats with a pair of faces or presses on both, moves there by {most:.3g} otherwise "
                f"than what repeats: {ALIKE}"
            )
            if one is not other:
                text = (
                    f"tool '{second}' is the image of '{name}' by a pair of faces, and moves by {most:.3g} otherwise than "
                    f"that: on the whole they are one; {TURNED}"
                )
            names = min(name, second), max(name, second)
            if names not in found or most > found[names].size:
                found[names] = Remark(most, text)
        return found

    def _gone(self, contact: ContactTerm, x: Floats) -> Floats:
        """How far (n, 3) what a tool has at x (n, 3) has come from where it was at the start."""
        system = self._system
        return x - system.state.pose(system.tools.names.index(contact.master_name)).before(x)

    def _apart(self, pair: tuple[ContactTerm, ContactTerm], x: Floats, now: Image, then: Image) -> tuple[float, float]:
        """How far the second's tool has at the image of x (n, 3) another place than the image of what the first's has at x,
        and the longer of their ways [length]. Collective."""
        one, other = (self._gone(contact, at) for contact, at in zip(pair, (x, now.of(x)), strict=True))
        apart = now.of(x) - other - then.of(x - one)
        lengths = [np.linalg.norm(vectors, axis=1).max(initial=0.0) for vectors in (apart, one, other)]
        most, *ways = np.max(self._system.comm.allgather(lengths), axis=0)
        return float(most), float(max(ways))

    def _at_faces(self, contact: ContactTerm, x: Floats, held: Bools) -> tuple[float, float]:
        """The same of a tool at nodes, of held (n,) ones, that it presses on both faces of a pair. Collective."""
        pairs, system, gone = self._pairs, self._system, self._gone(contact, x)
        count = 3 * system.space.dofmap.index_map.size_local
        leading = pairs.led(np.repeat(held.astype(float), 3)[:count])[:, 0] > 0.0
        led = np.einsum("nab,nb->na", pairs.follower.turn, pairs.led(gone.ravel()[:count]))
        if contact.rough:
            led += pairs.follower.offset(pairs.ways(system.state.t))
        apart = np.linalg.norm(gone[pairs.nodes] - led, axis=1) * (leading & held[pairs.nodes])
        ways = [np.linalg.norm(way, axis=1).max(initial=0.0) for way in (gone, led)]
        most, size = np.max(system.comm.allgather((apart.max(initial=0.0), max(ways))), axis=0)
        return float(most), float(size)

    def _itself(self, contact: ContactTerm, image: Image) -> bool:
        """Whether a tool is at the start as far from the slave points at faces as from their images. Collective."""
        s, feet = contact.surface, self.feet[contact.name]
        at = self._pairs.on_faces[s.nodes].any(axis=1)
        here, there = (gaps_at(contact, feet, one)[at] for one in (HERE, image))
        known = np.isfinite(here) & np.isfinite(there)
        off = np.abs(here[known] - there[known]).max(initial=0.0)
        alone = bool((np.isfinite(here) != np.isfinite(there)).any())
        most, apart, found = np.max(self._system.comm.allgather((off, alone, known.any())), axis=0)
        return bool(found and not apart and most <= ITSELF * s.cell_height)

    def _placed(self, one: ContactTerm, other: ContactTerm, image: Image) -> bool:
        """Whether an image puts the first's tool at the start on the second's. Collective."""
        a, b, s = one.places, other.places, one.surface
        off = np.inf
        if isinstance(a, RigidPlaces) and isinstance(b, RigidPlaces):
            x = np.einsum("eqk,ekc->eqc", s.a, s.X).reshape(-1, 3)
            gaps = [distances_to(places, at, self._rest.pose(places.index)) for places, at in ((a, x), (b, image.of(x)))]
            off = np.abs(gaps[0] - gaps[1]).max(initial=0.0)
        elif isinstance(a, PlacesOnFacets) and isinstance(b, PlacesOnFacets) and a.master.X.shape == b.master.X.shape:
            off = np.abs(image.of(a.master.X) - b.master.X).max(initial=0.0)
        return bool(max(self._system.comm.allgather(off)) <= PLACED * s.cell_height)


def gaps_at(contact: ContactTerm, feet: Any, image: Image) -> Floats:
    """Gaps (ne, nq) between an image of the slave points at `feet` and the master [length], endless without a partner.
    Collective."""
    places, gaps = contact.places, np.empty(0)
    if isinstance(places, NodePlaces | PointPlaces):
        gaps = places.gaps_of(image, feet)
    elif isinstance(places, RigidPlaces):
        x = np.einsum("eqk,ekc->eqc", contact.surface.a, feet.x).reshape(-1, 3)
        gaps = distances_to(places, image.of(x), feet.pose)
    return gaps.reshape(contact.surface.area.shape)

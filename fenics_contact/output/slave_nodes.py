"""A contact at the nodes of its slave surface: pressure, friction, gap, status and slip, and what they say of its zone."""

from dataclasses import dataclass, replace

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.facet_points import MIDDLES, Skin, skin_of
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.section import Section
from fenics_contact.assembly.size import extremes
from fenics_contact.assembly.system import System
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK
from fenics_contact.output.places import corner_weights
from fenics_contact.types import Bools, Floats, Ints, Ints64

# How much a point is held, by its status code: of two the one that is held more shows.
RANK_OF_STATUS = np.empty(4)
RANK_OF_STATUS[[OPEN, CLOSED, SLIP, STICK]] = 0, 1, 2, 3
STATUS_OF_RANK = np.argsort(RANK_OF_STATUS)
ALIKE = 1e-6  # of the greatest pressure: nodes that differ by less have it in common
STRETCHED = 0.05  # change of the area in contact from which on a law of friction that knows pressures is off by it
IN_CONTACT = np.array([CLOSED, SLIP, STICK])
MEANS = ("pressure", "gap", "slip")  # what is between corners of degree 2 the mean of theirs, friction too
SUMS = 22  # numbers that are summed at a node
ROUNDED = 1e-9  # weight of a corner that a node does not lie beside
TINY = 1e-200  # in the place of a pressure that is none: such points still have a status
# Of its share of the facets around: a node that keeps less present area has no pressure of its own. On a facet of degree 2
# that folds over at its corner the shape functions leave it less than none
FOLDED = 0.1
FACING = 0.5  # cosine of a facet's normal with what presses a node of it, from which on the facet is among what is pressed


@dataclass(frozen=True)
class NodalContact:
    """At all local nodes (n,), ghosts too; what is no slave node is not `on`.

    area: current one of the slave surface that belongs to a node, of an edge that of the sides that are pressed [length^2];
    pressure, friction (n, 3): tractions on that area [pressure], where a facet has folded over at a node on its share, as at
    the start, of that of the facets around; gap, slip: means over the points around a node, slip along the way [length]; of
    points on facets the gap is that of those which press, weighted by how much, where any does, the slip of those that have
    met; status: codes of kernels/status.py, open where nothing presses, else that of points around that press most in sum;
    closed: share of the node's area in contact; covered: share of it that lies over the master; stretch: all area of the
    facets around over that at the start.
    """

    on: Bools
    area: Floats
    pressure: Floats
    friction: Floats
    gap: Floats
    slip: Floats
    status: Ints
    closed: Floats
    covered: Floats
    stretch: Floats


@dataclass(frozen=True)
class Zone:
    """Where a contact presses: greatest pressure of a node and its place (3,), current area [length^2], and the extents
    (3,) along x, y, z, which end midway between a node in contact and one that is not [length]."""

    peak_pressure: float
    peak_at: Floats
    area: float
    width: Floats


class SlaveNodes:
    """Nodal values of one contact, the same on any number of ranks. facets: those of the slave on this rank.

    extent: size of the bodies [length]; reference (n, 3): positions of all local nodes [length]; rings (n, 2 ... 4): nodes
    around the facets, or around the parts of those of degree 2 between all nodes that have pressures.
    """

    def __init__(self, system: System, contact: ContactTerm, facets: Ints, section: Section | None = None) -> None:
        self.contact, self._system, space = contact, system, system.space
        self.comm, self.extent = system.comm, system.extent
        self.skin = skin_of(space, facets, section)
        self._sums = compat.node_values(space, SUMS)
        s = contact.surface
        bare = section if compat.degree(space) == 2 and not s.linear else None
        self._share = (s.area * _over_depth(s.a, s.X, bare))[..., None] * _lumped(s.a, s.X)
        self._lumped = _of_corners(self.skin) if s.linear else _lumped(self.skin.N, self.skin.X)
        self.rings = _rings(self.skin, s.linear)
        self._over_depth = _over_depth(self.skin.N, self.skin.X, bare)
        self.reference = space.tabulate_dof_coordinates()
        self._points: Skin | None = None  # Gauss points of the contact, where it has such on facets that bend
        if s.gradients is not None and compat.degree(space) == 2 and not s.corners:
            self._points = replace(self.skin, nodes=s.nodes, N=s.a, slopes=s.gradients, area=s.area, X=s.X)
        self._owned = space.dofmap.index_map.size_local
        self._keys: Ints64 | None = None

    def at_state(self) -> NodalContact:
        """The values at the system's state. Collective."""
        state, contact = self._system.state, self.contact
        response, s, h = contact.response(state), contact.surface, contact.trial.history
        pressure, friction = contact.forces.acting(state)
        covered = contact.forces.covered(state)
        status = contact.forces.status(state)
        closed = np.where(status != OPEN, covered, 0.0)
        tells, pressed = self._telling(status != OPEN), self._pressed()
        values = np.stack([np.ones_like(pressure), pressure, response.gap, closed, covered, h.slip_path], axis=-1)
        values[..., 2:] *= tells[..., None]
        values = np.concatenate([values, tells[..., None], friction], axis=-1)
        held = (status[..., None] == IN_CONTACT) * np.maximum(pressure, TINY)[..., None]
        sums = self._sums.array.reshape(-1, SUMS)
        sums[:] = 0.0
        np.add.at(sums[:, 2:12], s.nodes, np.einsum("eqk,eqv->ekv", self._share, values))
        np.add.at(sums[:, 12:15], s.nodes, np.einsum("eqk,eqv->ekv", np.abs(self._share), held))
        if s.gradients is not None:  # an open point beside says nothing of one that presses
            told = np.stack([held.sum(axis=2), h.met], axis=-1)
            told = np.concatenate([told, told * np.stack([response.gap, h.slip_path], axis=-1)], axis=-1)
            np.add.at(sums[:, 18:], s.nodes, np.einsum("eqk,eqv->ekv", np.abs(self._share), told))
        areas, skin = self._areas(), self.skin
        around = np.stack([areas, skin.area]) * self._over_depth
        parts = np.einsum("eq,eqk->ek", around[0], self._lumped)
        np.add.at(sums[:, 0], skin.nodes, pressed * np.einsum("eq,eqk->ek", areas, self._lumped))
        np.add.at(sums[:, 1], skin.nodes, parts)
        np.add.at(sums[:, 15:17], skin.nodes, around.sum(axis=2).T[:, None])
        np.add.at(sums[:, 17], skin.nodes, pressed * parts)
        compat.sum_to_owners(self._sums)
        compat.copy_to_ghosts(self._sums)
        area, now, weight, means, held = sums[:, 0].copy(), sums[:, 1], sums[:, 2], sums[:, 3:12], sums[:, 12:15]
        on = weight > 0.0
        shared = weight * np.divide(sums[:, 15], sums[:, 16], out=np.zeros_like(now), where=on)
        folded = now < FOLDED * shared
        now = np.where(folded, shared, now)
        under = np.where(folded | ~(sums[:, 17] > 0.0), now, sums[:, 17])
        mean, of_told, per_area = (
            np.divide(1.0, of, out=np.zeros_like(of), where=on) for of in (weight, means[:, 5], under)
        )
        gap, closed, covered, slip = (means[:, 1:5] * of_told[:, None]).T
        pressure, friction = means[:, 0] * per_area, means[:, 6:] * per_area[:, None]
        presses = (held > 0.0).any(axis=1) & ((closed > 0.0) | (pressure > 0.0))
        status = np.where(presses, IN_CONTACT[held.argmax(axis=1)], OPEN)
        told = sums[:, 18:20] * np.column_stack([presses, on])
        gap, slip = np.divide(sums[:, 20:], told, out=np.column_stack([gap, slip]), where=told > 0.0).T
        return NodalContact(on, area, pressure, friction, gap, slip, status, closed, covered, now * mean)

    def _telling(self, closed: Bools) -> Floats:
        """1 at the points (ne, nq) whose values a node is to show, else 0: of those on both sides of an edge, which lie at
        one node, those that press, if any does."""
        s = self.contact.surface
        if s.gradients is not None:  # points of facets
            return np.ones(closed.shape)
        presses = np.zeros(len(self.reference), dtype=bool)
        presses[s.nodes[closed[:, 0]]] = True
        return np.where(closed | ~presses[s.nodes[:, :1]], 1.0, 0.0)

    def _pressed(self) -> Bools:
        """At which nodes (nf, k) of the facets these look towards what presses there, where slave points are nodes: a flank
        beside an edge may be named with it, but its area bears nothing. All of them where nothing presses. Collective."""
        s, skin = self.contact.surface, self.skin
        if s.gradients is not None:  # facets have points of their own
            return np.ones(skin.nodes.shape, dtype=bool)
        sums, state = self._sums.array.reshape(-1, SUMS), self._system.state
        sums[:] = 0.0
        np.subtract.at(sums[:, :3], s.nodes[:, 0], s.area * self.contact.forces.pressing(state)[:, 0])
        compat.copy_to_ghosts(self._sums)
        x = skin.X + state.u.x.array.reshape(-1, 3)[skin.nodes]
        normal, push = np.cross(*skin.tangents(x)).sum(axis=1), sums[:, :3][skin.nodes]
        size = np.linalg.norm(normal, axis=1)[:, None] * np.linalg.norm(push, axis=2)
        return np.asarray(np.einsum("ec,ekc->ek", normal, push) >= FACING * size)

    def whole(self, at: NodalContact) -> NodalContact:
        """The same, and at nodes of degree 2 between corners that alone have values, as averages have, the means of these;
        of their statuses the one that holds most. Collective."""
        space = self._system.space
        if compat.degree(space) == 1:
            return at
        table = corner_weights(compat.cell_name(space.mesh), 2)
        dofs, many = compat.cell_dofs(space)[self.skin.cells], table.shape[1]
        known = np.column_stack([np.ones(len(at.on)), *(getattr(at, name) for name in MEANS), at.friction])
        rank, sums = RANK_OF_STATUS[at.status], compat.node_values(space, known.shape[1] + 1)
        rows = sums.array.reshape(len(known), known.shape[1] + 1)
        for nodes, weights in zip(dofs.T[many:], table[many:], strict=True):
            mine = np.isin(nodes, self.skin.nodes)
            corners = dofs[mine, :many][:, weights > ROUNDED]
            found = np.column_stack([known[corners].mean(axis=1), rank[corners].max(axis=1)])
            np.add.at(rows, nodes[mine], found)
        compat.sum_to_owners(sums)
        compat.copy_to_ghosts(sums)
        between = (rows[:, 0] > 0.0) & ~at.on
        mean = rows[between] / rows[between, :1]
        new = {name: getattr(at, name).copy() for name in (*MEANS, "on", "friction", "status")}
        for name, column in zip(MEANS, mean.T[1:], strict=False):
            new[name][between] = column
        new["friction"][between] = mean[:, len(MEANS) + 1 : -1]
        new["status"][between] = STATUS_OF_RANK[np.rint(mean[:, -1]).astype(int)]
        new["on"][between] = True
        return replace(at, **new)

    def area_note(self) -> str | None:
        """What is to be said of a law of friction that takes pressures per area at the start, where that has changed.
        Collective."""
        if not self.contact.trial.law.friction.asks_pressure:
            return None
        at = self.at_state()
        change = np.where(at.closed > 0.0, at.stretch - 1.0, 0.0)[: self._owned]
        least, most = min(self.comm.allgather(change.min(initial=0.0))), max(self.comm.allgather(change.max(initial=0.0)))
        worst = least if -least > most else most
        if abs(worst) <= STRETCHED:
            return None
        off = "larger" if worst > 0.0 else "smaller"
        return (
            f"contact '{self.contact.name}': its law of friction is evaluated with pressures per area at the start. That "
            f"area has changed by up to {worst:+.0%} in contact, so these are up to {abs(worst):.0%} {off} than the true "
            "pressures. A second run, with the law stated for pressures off by so much, tells whether it matters"
        )

    def keys(self) -> Ints64:
        """Numbers (n,) of all local nodes, the same on any number of ranks. Collective when asked first."""
        if self._keys is None:
            self._keys = node_keys(self._system.space)
        return self._keys

    def least_pressure(self) -> float:
        """Pressure up to which it is round-off anywhere, see `Forces.round_off` [pressure]. Collective."""
        return max(self.comm.allgather(float(self.contact.forces.round_off().max(initial=0.0))))

    def positions(self) -> Floats:
        """Current positions (n, 3) of all local nodes [length]."""
        return self.reference + self._system.state.u.x.array.reshape(-1, 3)

    def _areas(self, of: Skin | None = None) -> Floats:
        """Current areas (ne, nq) of the points of a skin, by default those of the facets [length^2]."""
        skin = of or self.skin
        return skin.current_area(skin.X + self._system.state.u.x.array.reshape(-1, 3)[skin.nodes])

    def zone(self, at: NodalContact) -> Zone:
        """Where the contact presses. Collective."""
        comm, x, touched = self.comm, self.positions(), at.closed > 0.0
        area = comm.allreduce(self._pressed_area(at, touched) if self._points is None else self._closed_area(self._points))
        peak, place = self._peak(at, x)
        return Zone(peak, place, area, self._width(touched, x))

    def _pressed_area(self, at: NodalContact, touched: Bools) -> float:
        """Of nodes, on this rank. Collective."""
        # a facet between nodes that all touch is in contact as a whole, though single points of it may be open just now
        whole = touched[self.skin.corners].all(axis=1)
        share = np.where(whole[:, None], at.covered[self.skin.nodes], at.closed[self.skin.nodes])
        return float(np.einsum("ek,eq,eqk->", self._pressed() * share, self._areas(), self._lumped))

    def _closed_area(self, points: Skin) -> float:
        """Of Gauss points, on this rank: within a facet of which some press the contact ends midway between the area of them
        and all of it, for points before its end stay open, too. Straight facets press as a whole: it ends between nodes."""
        state, forces = self._system.state, self.contact.forces
        closed = forces.status(state) != OPEN
        share = np.where(closed, 1.0, 0.5 * closed.any(axis=1, keepdims=True))
        return float((share * forces.covered(state) * self._areas(points)).sum())

    def _peak(self, at: NodalContact, x: Floats) -> tuple[float, Floats]:
        """Greatest pressure and its place: of nodes alike, as symmetry makes them, the first by x, y, z of the reference."""
        owned = at.pressure[: self._owned]
        peak = max(self.comm.allgather(float(owned.max(initial=0.0))))
        alike = np.flatnonzero(owned >= (1.0 - ALIKE) * peak) if peak > 0.0 else np.empty(0, dtype=np.int64)
        X = np.round(self.reference[alike] / self.extent, 9)
        first = alike[np.lexsort(X.T[::-1])[:1]]
        found = [pair for pair in self.comm.allgather([(tuple(self.reference[i]), tuple(x[i])) for i in first]) if pair]
        return peak, np.array(min(pair[0] for pair in found)[1] if found else np.zeros(3))

    def _width(self, touched: Bools, x: Floats) -> Floats:
        starts, ends = self.rings, np.roll(self.rings, -1, axis=1)
        first, second = touched[starts].ravel(), touched[ends].ravel()
        rim = first != second
        middles = 0.5 * (x[starts].reshape(-1, 3)[rim] + x[ends].reshape(-1, 3)[rim])
        places = np.concatenate([x[starts].reshape(-1, 3)[first], middles, np.empty((0, 3))])
        low, high = extremes(self.comm, places)
        return np.maximum(high - low, 0.0)


def _over_depth(N: Floats, X: Floats, section: Section | None) -> Floats | float:
    """One over the reference depth (ne, nq) of a plane mesh in points with shape functions N (ne, nq, k), nodes at X (ne, k,
    3): values at a node of degree 2 are means over lengths, for on the axis of a turned plane it has no area."""
    return 1.0 if section is None else 1.0 / section.depth(np.einsum("eqk,ekc->eqc", N, X))


def _of_corners(skin: Skin) -> Floats:
    """Shares (ne, nq, k) of a skin's nodes where corners have all of them."""
    shares = np.zeros_like(skin.N)
    shares[:, :, : skin.linear.shape[2]] = skin.linear
    return shares


def _rings(skin: Skin, linear: bool) -> Ints:
    """Nodes (n, 2 ... 4) around the facets; of those of degree 2 whose middles have pressures of their own, around their
    halves or quarters. linear: corners alone have pressures, and so it is on triangles, see `_lumped`."""
    nodes, corners = skin.nodes, skin.corners
    kind = (corners.shape[1], nodes.shape[1])
    if linear or kind not in ((2, 3), (4, 9)):
        return corners
    if kind == (2, 3):
        return np.concatenate([nodes[:, [0, 2]], nodes[:, [2, 1]]])
    middles = nodes[:, MIDDLES]
    quarters = [corners, middles, np.broadcast_to(nodes[:, 8:], corners.shape), np.roll(middles, 1, axis=1)]
    return np.stack(quarters, axis=2).reshape(-1, 4)


def _lumped(N: Floats, X: Floats) -> Floats:
    """Shares (ne, nq, k) of the nodes at X (ne, k, 3) in points with shape functions N (ne, nq, k).

    Quadratic triangles give their corners no area: there the linear functions of the corners take all of it.
    """
    if N.shape[2] != 6:
        return N
    corners, middles = X[:, :3], X[:, 3:]
    pairs = 0.5 * (corners[:, [1, 0, 0]] + corners[:, [2, 2, 1]])  # opposite the corners
    opposite = np.argmin(np.linalg.norm(middles[:, :, None] - pairs[:, None], axis=3), axis=2)
    halves = 0.5 * (opposite[:, :, None] != np.arange(3))
    linear = N[:, :, :3] + N[:, :, 3:] @ halves
    return np.concatenate([linear, np.zeros_like(linear)], axis=2)

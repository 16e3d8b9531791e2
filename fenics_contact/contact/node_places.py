"""Where the samples around slave nodes meet the facets of a master, and how much of the nodes' areas lies over these."""

from collections.abc import Callable
from functools import partial

import numpy as np

from fenics_contact.assembly.pairs import Image
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.term import State
from fenics_contact.contact.crossing import Crossing
from fenics_contact.contact.lost import FIRST_SEARCH
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.meeting import MortarFeet, Sights
from fenics_contact.contact.mirrors import Mirrors, Standing
from fenics_contact.contact.on_facets import MARGIN, PlacesOnFacets, seen_from_behind
from fenics_contact.contact.pairing import Pairing, Watch, in_sight
from fenics_contact.contact.samples import RINGS, NodeNormals, Samples, SlaveFacets, Steered, corner_shapes, samples_for
from fenics_contact.contact.seams import abutting, slits
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.unit import unit
from fenics_contact.contact.walls import walls_between
from fenics_contact.kernels import mortar as kernel
from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.coverage import Ends, beyond_edges, coverage, surface_ends
from fenics_contact.kernels.normals import CREASE
from fenics_contact.kernels.quadratic import foot_shapes
from fenics_contact.kernels.segments import JOINT
from fenics_contact.timing import Timers
from fenics_contact.types import Array, Bools, Floats, Ints64

Project = Callable[[Floats, Floats, Floats], Projection]

ACROSS = np.sqrt(0.5)  # less of a lean that lies along an edge: it leans across that
SETTLED = 1e-4  # less by which a normal leans, a hundredth of a percent of the load aside, is nothing; the double is all
FLATTER = 30.0  # times less than by which a slave bends: what the squares of the master's normals spread around a node
NONE_LEANS = np.radians(1.0)  # what corners of flat facets lean by
SEARCH = 2.0  # times a cell or facet: iterates go far, and a sample that loses its foot loses its node's pressure


class NodePlaces(PlacesOnFacets[MortarFeet]):
    """Of slave nodes that meet a master through samples of the facets around them.

    ring (nf, m): corners of the master's facets; edges (nf, m): from which of them to the next it ends or has a crease;
    ends, beyond: as drawn, see `ends_at`; parted: parts of the master lie side by side without common nodes; surface:
    SlaveSurface of nodes; bends (ns,): `_spread` of their normals as drawn; crossing.skin: all facets of the slave;
    held: as of SlaveFacets; part: of the mesh, as of `walls_between`. Each process evaluates all samples around its own
    nodes against the whole master, and so needs nothing of the others. The constructor and methods that take a state are
    collective.
    """

    sights: Sights
    samples: Samples

    def __init__(
        self,
        surface: SlaveSurface,
        master: MasterSurface | ToolSurface,
        crossing: Crossing,
        timers: Timers,
        held: tuple[Array, Mirrors],
        part: Ints64,
    ) -> None:
        skin, search = crossing.skin, SEARCH * max(surface.cell_height, master.longest)
        each = 2 if skin.whole else 1  # a facet of degree 2 is as two of degree 1
        joined = np.isin(skin.blocks, master.blocks)
        self.around = SlaveFacets(skin, each * samples_for(skin.edge, master.edge), held, joined)
        super().__init__(self.around.parted(surface), master, crossing, (skin.owned, len(skin.X)), search, timers)
        self.skin = skin
        ring, self._walls = self.around.corners, None
        if isinstance(master, MasterSurface):
            ours = skin, ring if ring.shape[1] == 4 else ring[:, [0, 1, 2, 2]]
            self._walls = walls_between(ours, (master, master.corners[0]), part, search)
            self.meets_itself = max(self.comm.allgather(self._walls is not None))  # a process may have no facet of the slave
        self._corners = master.corners[0] + self.first, master.corners[1]
        normals, cosine = unit(area_vectors(master.X[master.corners[0]])), np.cos(np.radians(CREASE))
        z = master.X[master.corners[0], 2]
        counts = None if skin.section is None else z != np.roll(z, -1, axis=1)  # a strip goes on across, however deep it is
        starts, edges, sides, smooth = surface_ends(master.corners, normals, cosine, counts)
        m = int(master.corners[1].max(initial=3))
        self.ring, X = np.ascontiguousarray(self._corners[0][:, :m]), np.concatenate([np.zeros_like(skin.X), master.X])
        behind = [(normal, np.append(np.zeros(self.first, dtype=bool), on)) for normal, on in held[1].master]
        every = np.ones(len(self.ring), dtype=bool)
        self._smooth = NodeNormals(X, self.ring, m, corner_shapes(m, RINGS[m])[1], every, behind)
        self._mirrors, self._X = held[1], np.concatenate([skin.X, master.X])
        drawn = self._mirrors.standing(np.zeros_like(self._X))
        self._alone = _alone(self._smooth(X, drawn)[0][self._smooth.group], X[self.ring])
        self._aside: tuple[Floats, Steered] | None = None  # places of all nodes, and what a step from there presses along
        self.beyond = beyond_edges(master.corners)
        creased = np.einsum("fc,fec->fe", normals, normals[self.beyond]) < cosine
        self.edges = ((self.beyond < 0) | creased)[:, :m]
        self.ends: Ends = starts, edges + self.first, sides, smooth
        # curved ends bulge past each other between their corners
        straight = isinstance(master, MasterSurface) and not master.whole
        self.parted = straight and slits(master.corners, master.X) is not None
        self._watch = Watch(self.comm, np.unique(np.concatenate([skin.owned, master.owned])))  # what positions rest on
        ends, _ = ends_at(self, np.concatenate([skin.X, master.X]))
        self.use(Samples(self.around, self.around.whole, ends))
        self.bends = _drawn(self, drawn)

    def resampled(self, then: MortarFeet, now: MortarFeet, slides: Floats | None) -> tuple[MortarFeet, MortarFeet | None]:
        """Take samples where the surfaces lie now; returns the feet that they had then, as the last step ended, and, where
        nodes that may rub had none, those that they have now. Collective.

        slides (ns,): how much nodes slide, from 0 to 1, None: without friction. Edges lean otherwise in front of what slides
        than behind it, as do nodes of round sides where few of them touch: both press along the master's normals of then.
        """
        with self.timers("projection"):
            if slides is not None and (self._aside is None or self._aside[0] is not then.coords):
                self._aside = then.coords, _steered(self, then, slides)
            normals, _ = self.around.normals(now.coords, now.standing)
            ends, beyond = ends_at(self, now.coords)
            sites = self.around.crossed(now.coords, normals, (self._corners, beyond), MARGIN * self.master.edge)
            self.use(Samples(self.around, sites, ends))
            project = partial(self.sights.pairing.project, timers=self.timers)
            feet, come = self._at(then.coords, then.pose, project), None
            if slides is not None and not feet.seated.any(axis=1).all():
                come = self._at(now.coords, now.pose, project)
            if slides is not None and self._aside is not None:
                self.samples = self.samples.pressing(*self._aside[1])
            return feet._replace(samples=self.samples), come

    def master_normals(self, feet: MortarFeet) -> Floats:
        """Unit normals (np, 3) of the master at the samples' feet, which point as the samples' own do: of flat facets those
        between their corners', which do not jump from one to the next."""
        facet, ours = feet.projection[0], feet.projection[5]
        if self.skin.whole:
            along, across = (np.einsum("qi,qic->qc", feet.met[9][:, i], feet.coords[self.facets[0][facet]]) for i in (1, 2))
            theirs = unit(np.cross(along, across))
        else:
            corners, flat = (
                self._smooth(feet.coords, feet.standing)[0][self._smooth.group[facet]],
                _flat(feet.coords[self.ring[facet]]),
            )
            corners = corners - self._alone[facet] * _across(corners, flat)
            theirs = unit(np.einsum("qi,qic->qc", feet.met[9][:, 0, : corners.shape[1]], corners))
        return theirs * np.sign(np.einsum("qc,qc->q", ours, theirs))[:, None]

    def use(self, samples: Samples) -> None:
        """Meet the master through these samples."""
        self.samples, self._feet = samples, None
        walled = None if self._walls is None else (samples.slaves.facet, self._walls)
        self.sights = Sights(self.facets, self._corners, self.search, walled)

    def _met(self, state: State) -> MortarFeet:
        return self._feet_at(state, lambda x, n, coords: self.sights.pairing.project(x, n, coords, self.timers))

    def first_feet(self, state: State) -> MortarFeet:
        """The places of the first search, which looks farther. Collective."""
        search = FIRST_SEARCH * self.search
        return self._feet_at(state, lambda x, n, coords: self.sights.pairing.far(x, n, coords, search))

    def _feet_at(self, state: State, project: Project) -> MortarFeet:
        """Where the samples are and what project(points, normals, coords) gives for them. Collective."""
        coords = np.concatenate([self.skin.positions(state), self.master.positions(state)])
        return self._at(coords, self.master.pose(state), project)

    def _at(self, coords: Floats, pose: Pose | None, project: Project) -> MortarFeet:
        """The same of positions coords (nx, 3) and a tool's pose."""
        standing = self._mirrors.standing(coords - self._X)
        normals, turns = self.around.normals(coords, standing)
        points, directions, lengths = self.samples.at(coords, normals)
        met = self._covered(points, coords, project(points, -directions, coords))
        kept = self.around.kept(standing)
        return MortarFeet(self.samples, coords, points, lengths, normals, turns, met, pose, standing, kept)

    def _covered(self, points: Floats, coords: Floats, projection: Projection) -> kernel.Met:
        """The projection without what lies off the master, and how much of each sample lies over it."""
        n, s = len(points), self.samples
        cover = np.empty(n), np.empty((n, 4), dtype=np.int64), np.empty((n, 5, 3))
        N = np.empty((n, 3, self.facets[0].shape[1]))
        foot_shapes(np.arange(n), self.facets, projection, N)
        sight = self.sights.held or (projection[5], coords)
        samples = points, s.corners, s.rims, self.sights.kept
        coverage(coords, samples, (self._corners, s.ends), sight, projection, cover)
        frames = np.empty((n, 5, 3))
        kernel.fill_frames(coords, self.facets, projection, N, frames)
        return *projection, *cover, N, frames

    def gaps_of(self, image: Image, feet: MortarFeet) -> Floats:
        """Gaps (ns,), the least of the samples around them, at an image of the nodes, endless without a partner."""
        coords = np.concatenate([image.of(feet.coords[: self.first]), feet.coords[self.first :]])
        # an image of a wall may meet that wall's other side
        pairing = Pairing(self.facets, in_sight(self._corners), self.search)
        there = self._at(coords, feet.pose, lambda x, n, at: pairing.far(x, n, at, self.search))
        table = there.samples.table
        return np.asarray(np.where(there.seated, there.projection[4][table], np.inf).min(axis=1))

    def far(self, feet: MortarFeet, search: float) -> Projection:
        """Projection from the same places with another search distance."""
        found = self.sights.pairing.far(feet.points, -feet.projection[5], feet.coords, search)
        return self._covered(feet.points, feet.coords, found)[:6]

    def meets(self, feet: MortarFeet) -> tuple[Ints64, Ints64, Floats]:
        """Numbers (n,) of nodes, and of the master's facets that samples around them face, with what areas (n,)."""
        node, sample = np.nonzero(feet.seated)
        table, share = feet.samples.table, feet.samples.share
        return node, feet.projection[0][table[node, sample]], share[node, sample]

    def normals(self, feet: MortarFeet) -> Floats:
        """Unit normals (ns, 1, 3) along which pressure acts on this rank's slave nodes; zero without a partner."""
        return self._mean(feet, feet.projection[1] != NONE)

    def looks(self, state: State) -> Floats:
        """Unit directions (ns, 1, 3) in which this rank's slave nodes look for the master: their normals. Collective."""
        feet = self.feet(state)
        return -self._mean(feet, np.ones(len(feet.points), dtype=bool))

    def _mean(self, feet: MortarFeet, of: Bools) -> Floats:
        """Unit means (ns, 1, 3) of the samples' normals; of (np,): those that count."""
        s = feet.samples
        share = np.where(s.table < 0, 0.0, s.share * of[s.table])
        sums = np.einsum("nj,njc->nc", share, feet.projection[5][s.table])
        return unit(np.einsum("ncd,nd->nc", feet.kept, sums))[:, None]

    def bare(self, feet: MortarFeet, far: bool = False) -> Floats:
        """Shares (ns,) of the nodes' areas that do not lie over the master; far: however far away it is."""
        s, met = feet.samples, feet.met
        if far:
            found = self.sights.pairing.far(feet.points, -feet.projection[5], feet.coords, self.farthest(feet))
            met = self._covered(feet.points, feet.coords, found)
        return 1.0 - (s.share * met[6][s.table]).sum(axis=1) / s.share.sum(axis=1)

    def features(self, feet: MortarFeet) -> Array:
        """Codes (ns, ...): where one changes the traction has a kink."""
        s = feet.samples
        codes = np.column_stack([feet.projection[0], feet.met[7]])[s.table]
        return np.where((s.table < 0)[..., None], -9, codes).reshape(len(codes), 5 * s.table.shape[1])

    def cut_off(self, state: State) -> Floats:
        """How much nearer (ns, 1) [length] the surfaces are than their facets, on average as gaps are. Collective."""
        feet = self.feet(state)
        s, (facet, kind, *_), cover = feet.samples, feet.projection, feet.met[6]
        there = np.where(kind != NONE, self.master.cut_off[facet], 0.0)[s.table]
        share = s.share * np.where(kind != NONE, cover, 0.0)[s.table]
        means = (share * there).sum(axis=1) / np.maximum(share.sum(axis=1), 1e-300)
        return self.surface.cut_off + means[:, None]

    def node_gaps(self, state: State, nodes: Array, X: Floats) -> Floats:
        """Endless gaps (n,): means over samples leave nothing between them to ask for."""
        return np.full(len(nodes), np.inf)

    def back_share(self, state: State) -> float:
        """Share of the samples that see the nearest facet of a tool from behind; those of bodies point out of them.
        Collective."""
        feet = self.feet(state)
        if feet.pose is None:
            return 0.0
        normals, corners = -feet.projection[5], feet.coords[self.facets[0]]
        return seen_from_behind(self.comm, feet.points, normals, corners, self.surface.cell_height)


def _flat(x: Floats) -> Floats:
    """Unit normals (n, 1, 3) of facets with corners x (n, m, 3)."""
    return unit(np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0]))[:, None]


def _across(normals: Floats, flat: Floats) -> Floats:
    """Vectors (n, m, 3) without their part along unit normals (n, 1, 3)."""
    return np.asarray(normals - (normals * flat).sum(axis=2, keepdims=True) * flat)


def _alone(normals: Floats, x: Floats) -> Floats:
    """Shares (nf, m, 1) of what normals (nf, m, 3) at the corners x (nf, m, 3) of facets lean by that have no like at the
    other ends of their sides: on an arc both ends lean as far, beside a ridge, which is none, one alone does."""
    lean = _across(normals, _flat(x))
    kept, whole = np.full((2, *lean.shape[:2]), NONE_LEANS**2)
    for to in (1, -1):
        side = unit(np.roll(x, -to, axis=1) - x)
        one, other = (lean * side).sum(axis=2), -(np.roll(lean, -to, axis=1) * side).sum(axis=2)
        both, whole = np.maximum(one * other, 0.0), whole + one * one
        kept += one * one * np.minimum(2.0 * both / np.maximum(one * one + both, 1e-300), 1.0)
    return np.asarray(1.0 - kept / whole)[..., None]


def ends_at(places: NodePlaces, coords: Floats) -> tuple[Ends, Ints64]:
    """Where the master ends, and facets beyond its edges as of `Joined`, at coords (nx, 3): bodies that lie side by side
    there go on from one to the other."""
    if not places.parted:
        return places.ends, places.beyond
    corners, (starts, edges, sides, smooth) = places.master.corners, places.ends
    found, m = abutting(corners, coords[places.first :]), len(coords)
    sides, beyond = sides.copy(), places.beyond.copy()
    asked = found.facet * m + found.corner + places.first
    order, key = np.argsort(asked), sides[:, 0] * m + edges[:, 0]
    if len(asked):
        at = order[np.minimum(np.searchsorted(asked[order], key), len(asked) - 1)]
        sides[:, 1] = np.where(asked[at] == key, found.beyond[at], sides[:, 1])
        place = (corners[0][found.facet] == found.corner[:, None]).argmax(axis=1)
        beyond[found.facet, place] = JOINT - found.beyond
    return (starts, edges, sides, smooth), beyond


def _steered(places: NodePlaces, then: MortarFeet, slides: Floats) -> Steered:
    """Parts (nf, m, 2) of facets' tangents, by their corners, in what is added to normals, fitted to the samples that a
    facet has as a whole, so that they hang on the state then alone; and how much of it (nf, m) where corners press: all at
    ends and creases, elsewhere where nodes slide on a master that is flatter than the slave was drawn. On one as round the
    slave's normals are as good, and turn with the slave, where the master's are those of another place a step later."""
    places.use(whole := Samples(places.around, places.around.whole, ends_at(places, then.coords)[0]))
    feet = places._at(then.coords, then.pose, partial(places.sights.pairing.project, timers=places.timers))
    theirs, table = places.master_normals(feet), whole.table
    aside, sees, ends = _aside(places, feet, theirs)
    flat = FLATTER * _spread(feet.kept, np.where((table < 0) | ~sees[table], 0.0, whole.share), theirs[table])
    lean = slides * places.bends / (places.bends + flat + SETTLED**2)
    lean[((table >= 0) & ends[table]).any(axis=1)] = 0.0
    number = places.around.number
    part = np.where(number < 0, 0.0, lean[number])
    return whole.fitted(then.coords, aside, sees), np.where(places.around.tips, 1.0, part)


def _drawn(places: NodePlaces, standing: Standing) -> Floats:
    """How far (ns,) normals of the slave spread around each node as it was drawn, see `_spread`."""
    whole, X = places.samples, places.skin.X
    _, directions, _ = whole.at(X, places.around.normals(X, standing)[0])
    return _spread(places.around.kept(standing), whole.share, directions[whole.table])


def _spread(kept: Floats, share: Floats, normals: Floats) -> Floats:
    """Mean squares (ns,) of what unit normals (ns, J, 3) of samples, with their shares (ns, J), are off their mean by, of
    which (ns, 3, 3) is kept."""
    whole = np.maximum(share.sum(axis=1), 1e-300)
    off = normals - (np.einsum("ncd,nj,njd->nc", kept, share, normals) / whole[:, None])[:, None]
    return np.asarray(np.einsum("nj,njc->n", share, off * off) / whole)


def _aside(places: NodePlaces, feet: MortarFeet, theirs: Floats) -> tuple[Floats, Bools, Bools]:
    """What is added to the normals of samples (np, 3) for the master's, theirs (np, 3), which of them see it, and which
    lean across one of its ends or creases, on facets no farther from it than they are long: nothing is added there, for the
    master's edges press along the slave's normals."""
    facet, kind, normals = feet.projection[0], feet.projection[1], feet.projection[5]
    sees = kind != NONE
    part = np.where(sees, np.einsum("qc,qc->q", theirs, normals), 1.0)
    aside = theirs / part[:, None] - normals
    lean, x = np.linalg.norm(aside, axis=1), feet.coords[places.ring[facet]]
    sides = np.roll(x, -1, axis=1) - x
    lengths = np.maximum(np.linalg.norm(sides, axis=2), 1e-300)
    across = np.abs(np.einsum("qec,qc->qe", sides, aside)) < ACROSS * lengths * lean[:, None]
    across &= sees[:, None] & places.edges[facet]
    foot = np.where(sees[:, None], feet.met[10][:, 0], 0.0)[:, None]
    off, own = np.linalg.norm(np.cross(sides, foot - x), axis=2) / lengths, feet.samples.slaves.facet
    corners = feet.coords[places.around.corners]
    size = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1, initial=0.0)
    near = np.zeros(len(corners), dtype=bool)
    near[own[(across & (off < size[own, None])).any(axis=1)]] = True
    ends = across.any(axis=1) & near[own]
    return np.where((sees & ~ends)[:, None], np.clip(lean / SETTLED - 1.0, 0.0, 1.0)[:, None] * aside, 0.0), sees, ends

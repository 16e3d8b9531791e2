"""Bodies that are too stiff, or too soft, since their cells are, which say nothing of it: strain that varies within cells.

A cell of degree 1 that bends has a shear of its own, and with displacement alone a change of volume, that the body has not;
with mixed elements a part of the volume's change costs nothing.  Two enhanced modes for each direction, zero at a cell's
nodes, let it bend as it should (Taylor, Beresford & Wilson 1976, doi:10.1002/nme.1620100602).  Of degree 2 with displacement
alone mixed cells of the same mesh leave out the energy of the part of J that their pressures do not see.

What energy falls by with that, where nodes stay, is a quadratic form in what varies within a cell, and so in the motions of
its nodes: it comes with a force, and the tangent falls.  One solve with what is left of the tangent tells how the bodies
give way.  With the energy W of a body, what it falls by, d, and the force r of that,

    share = (d - r du / 2) / (W + W' du / 2),    stiffness as it should be / stiffness = 1 - share,

where all is linear, whether supports, loads or other bodies lead it.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.section import Section
from fenics_contact.assembly.system import System
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import Isotropic
from fenics_contact.types import Constant, Floats, Function, Ints

if TYPE_CHECKING:
    from fenics_contact.scene.scene import Scene

LEAST = {1: 0.05, 2: 0.03}  # by degree: from which share on it is told that a body is too stiff
SOFT = 0.1  # likewise that it is too soft: a mixed sphere of two layers has 0.08 and is right, for its mean strains are less
# Of a body's energy, what cells have too much where nodes stay, by degree, and that of strain that varies within mixed
# cells, which may have as much too little elsewhere: with less no solve
LOOKED, LOOKED_MIXED = {1: 0.02, 2: 0.004}, 0.05
NUDGE = 1e-4  # of a motion, over which energies are differenced
INCOMPRESSIBLE = 10.0  # K / mu from which on cells of degree 2 should be mixed, too
COUNTS = 0.01  # of the energy of all bodies: one with less may be as stiff as it likes
SLIGHT = 0.02  # of the stiffness of all bodies: so much of it nobody minds, and no figure here is better
MANY = 2_000_000  # values at once, of cells times their points times what varies there, which bounds memory

# Motion (local) by which bodies give way, None where nothing tells: of what the tangent falls by, and of the force (local)
# that comes with it, which is whole once all of that has been drawn. Collective
Give = Callable[[Iterable[Blocks], Floats], Floats | None]


class Stiffness(NamedTuple):
    """Of a body, which share of its stiffness its cells have too much, negative where they have too little, and a note."""

    share: float
    note: str


class _Off(NamedTuple):
    """Energies: what cells have too much where nodes stay, of strain that varies within them, and all; the most that one
    has too much, either way, and where that is."""

    much: float
    varying: float
    all: float
    most: float
    at: Floats


class _Cell(NamedTuple):
    """Points of a square or cube: the basis (q, n), its gradients (q, d, n), weights (q,), places (q, d)."""

    basis: Floats
    gradients: Floats
    weights: Floats
    places: Floats

    @classmethod
    def of(cls, name: str, degree: int, dim: int) -> "_Cell":
        """Gauss's points."""
        x, w = np.polynomial.legendre.leggauss(degree + 1)
        places = 0.5 + 0.5 * np.stack(np.meshgrid(*dim * [x], indexing="ij"), axis=-1).reshape(-1, dim)
        weights = np.prod(np.meshgrid(*dim * [0.5 * w], indexing="ij"), axis=0).ravel()
        values = compat.tabulate(compat.basix_element(name, degree), 1, places)
        return cls(values[0], np.ascontiguousarray(values[1:].transpose(1, 0, 2)), weights, places)


class _Strained(NamedTuple):
    """Cells at their points: F (n, q, 3, 3), inverse jacobians (n, q, d, d), volumes (n, q), and the radius (n, q) of what
    turns about an axis, else None; all as of what has swollen freely."""

    F: Floats
    inverse: Floats
    volume: Floats
    radius: Floats | None

    @classmethod
    def of(cls, section: Section | None, cell: _Cell, at: tuple[Floats, Floats], swollen: Floats) -> "_Strained":
        """Of cells whose nodes lie at X and have moved by u (n, m, 3); swollen (n, q): how much longer they are without
        stress than in X, which is what strains are measured from."""
        (X, u), dim = at, cell.places.shape[1]
        jacobian, moved = (cell.gradients @ values[:, None, :, :dim] for values in (X, u))
        inverse = np.linalg.inv(jacobian)
        F = np.zeros((*jacobian.shape[:2], 3, 3)) + np.eye(3)
        F[..., :dim, :dim] += (inverse @ moved).swapaxes(2, 3)
        volume, radius = np.abs(np.linalg.det(jacobian)) * cell.weights, None
        if section is not None:
            places = cell.basis @ X
            volume = volume * section.depth(places)
            if section.axisymmetric:
                F[..., 2, 2] += (cell.basis @ u[..., :1])[..., 0] / places[..., 0]
                radius = places[..., 0] * swollen
        return cls(F / swollen[..., None, None], inverse / swollen[..., None, None], volume * swollen**3, radius)

    def varying(self, values: Floats) -> Floats:
        """Values (n, q, ...) without their mean over each cell, times the root of volumes."""
        volume = self.volume.reshape(*self.volume.shape, *[1] * (values.ndim - 2))
        varying: Floats = (values - self.mean(values)[:, None]) * np.sqrt(volume)
        return varying

    def mean(self, values: Floats) -> Floats:
        """Over each cell (n, ...) of values (n, q, ...)."""
        volume = self.volume.reshape(*self.volume.shape, *[1] * (values.ndim - 2))
        mean: Floats = (volume * values).sum(axis=1) / volume.sum(axis=1)
        return mean


class _Rates(NamedTuple):
    """With motions of nodes that of F, at their points: of its rows by gradients (n, q, 3, m), of what turns by hoops (n, q,
    m), else None."""

    gradients: Floats
    hoops: Floats | None

    @classmethod
    def of(cls, cell: _Cell, strained: _Strained) -> "_Rates":
        gradients = np.zeros((*strained.volume.shape, 3, cell.basis.shape[1]))
        gradients[..., : cell.places.shape[1], :] = strained.inverse @ cell.gradients
        return cls(gradients, None if strained.radius is None else cell.basis / strained.radius[..., None])

    def each(self, P: Floats) -> Floats:
        """What P (n, q, 3, 3) do at each point with motions (n, q, 3 m) of the nodes."""
        out = (P @ self.gradients).swapaxes(2, 3)
        if self.hoops is not None:
            out[..., 0] += P[..., 2, 2, None] * self.hoops
        return out.reshape(*out.shape[:2], -1)

    def all(self, P: Floats) -> Floats:
        """What several P (n, q, 3, 3, k) do at all points (n, k, 3 m)."""
        n, q, _, _, k = P.shape
        rows = P.transpose(0, 4, 2, 1, 3).reshape(n, 3 * k, 3 * q)
        out = (rows @ self.gradients.reshape(n, 3 * q, -1)).reshape(n, k, 3, -1).swapaxes(2, 3)
        if self.hoops is not None:
            out[..., 0] += P[..., 2, 2, :].swapaxes(1, 2) @ self.hoops
        return out.reshape(n, k, -1)


class _Part:
    """A body's cells of this rank; swells: by which ratio of volumes, a number or, by nodes, a field."""

    def __init__(self, scene: "Scene", system: System, body: Body, swells: Constant | Function | None) -> None:
        space, tags = system.state.u.function_space, scene.mesh.cell_tags
        owned = compat.cell_map(scene.mesh.domain).size_local
        cells = tags.indices[(tags.values == scene.mesh.volume_tag(body.group)) & (tags.indices < owned)]
        self.body, self._scene, self._X = body, scene, system.space.tabulate_dof_coordinates()
        self._cell = _Cell.of(compat.cell_name(space.mesh), scene.degree, space.mesh.topology.dim)
        self._nodes = compat.cell_dofs(space)[cells]
        self._moduli = body.material.shear_modulus, body.material.bulk_modulus
        self._swells, self.mixed = swells, scene.element == "mixed"

    def _strained(self, u: Floats, values: int) -> Iterator[tuple[Ints, _Strained]]:
        """Nodes of some cells, and how they are strained where dofs have moved by so much (local), with so many values in
        each cell's point."""
        moved, many = u.reshape(-1, 3), max(MANY // (9 * len(self._cell.weights) * values), 1)
        for first in range(0, len(self._nodes), many):
            nodes = self._nodes[first : first + many]
            at = self._X[nodes], moved[nodes]
            yield nodes, _Strained.of(self._scene.section, self._cell, at, np.cbrt(self._swollen(nodes)))

    def _swollen(self, nodes: Ints) -> Floats:
        """Ratios (n, q) of volumes."""
        if isinstance(self._swells, compat.Function):
            ratios: Floats = self._swells.x.array[nodes] @ self._cell.basis.T
            return ratios
        return np.full((len(nodes), len(self._cell.weights)), 1.0 if self._swells is None else float(self._swells.value))

    def energy(self, u: Floats) -> float:
        """Of this rank's cells."""
        return sum(self._energy(strained) for _, strained in self._strained(u, 1))

    def _energy(self, strained: _Strained) -> float:
        """As of a law that its moduli at rest tell all of."""
        (mu, bulk), J = self._moduli, np.linalg.det(strained.F)
        dilatation = strained.mean(J)[:, None] if self.mixed else J
        shear = np.cbrt(J) ** -2 * (strained.F**2).sum(axis=(2, 3)) - 3.0
        return float((strained.volume * (0.5 * mu * shear + 0.5 * bulk * (dilatation - 1.0) ** 2)).sum())

    def off(self, u: Floats) -> _Off:
        """Of this rank's cells."""
        much, varying, whole, most, at = 0.0, 0.0, 0.0, -1.0, np.zeros(3)
        for nodes, strained in self._strained(u, 1):
            now, off = self._too_much(strained)
            off = 0.5 * off[:, 0, 0]
            much, varying = much + float(off.sum()), varying + float(now.sum())
            whole += self._energy(strained)
            if np.abs(off).max() > most:
                most, at = float(np.abs(off).max()), self._X[nodes[np.abs(off).argmax()]].mean(axis=0)
        return _Off(much, varying, whole, most, at)

    def softer(self, u: Floats, force: Floats) -> Iterator[Blocks]:
        """What the tangent falls by; adds to a local array the force that comes with it."""
        for nodes, strained in self._strained(u, 3 * self._nodes.shape[1]):
            _, off = self._too_much(strained, _Rates.of(self._cell, strained))
            np.add.at(force.reshape(-1, 3), nodes, -off[:, 1:, 0].reshape(*nodes.shape, 3))
            yield Blocks(cells=(nodes, -off[:, 1:, 1:]))

    def _too_much(self, strained: _Strained, rates: _Rates | None = None) -> tuple[Floats, Floats]:
        """Energies (n,) of what varies within each cell, and twice what they have too much (n, c, c), by strains and, with
        rates, by motions of the nodes."""
        if self._scene.degree == 2:
            return _unseen(self._cell, strained, self._moduli[1], rates)
        return _bending(self._cell, strained, self._moduli, self.mixed, rates)


def stiffnesses(scene: "Scene", system: System, u: Floats, give: Give) -> dict[str, Stiffness]:
    """{body: its Stiffness} of those of quadrilaterals or hexahedra that are off by more than LEAST says where dofs have
    moved by u (local); give: see Give. Collective."""
    if compat.cell_name(scene.mesh.domain) in ("triangle", "tetrahedron") or (scene.degree, scene.element) == (2, "mixed"):
        return {}
    swell = [law.swelling and law.swelling[0] for law in system.terms[0].laws]
    parts = [_Part(scene, system, *of) for of in zip(scene.bodies, swell, strict=True)]
    found = [_sum(system.comm.allgather(part.off(u))) for part in parts]
    counts = COUNTS * sum(off.all for off in found)
    if not any(off.all > counts and _matters(scene, off) for off in found):
        return {}
    forces, total = [np.zeros_like(u) for _ in parts], np.zeros_like(u)

    def softer() -> Iterator[Blocks]:
        for part, force in zip(parts, forces, strict=True):
            yield from part.softer(u, force)
            total[:] += force

    du = give(softer(), total)
    given = [_given(system, part, off, u, (force, du)) for part, off, force in zip(parts, found, forces, strict=True)]
    whole, out = sum(left for _, left in given), dict[str, Stiffness]()
    for body, off, (too_much, left) in zip(scene.bodies, found, given, strict=True):
        share, of_all = too_much / max(left, counts), too_much / whole
        if not -SOFT <= share <= LEAST[scene.degree] and abs(of_all) > SLIGHT:
            out[body.group] = Stiffness(share, _note(scene, body, off, (share, of_all)))
    return out


def _matters(scene: "Scene", off: _Off) -> bool:
    """Whether a solve may tell of a body what is to be told."""
    if scene.element == "mixed":
        return off.varying > LOOKED_MIXED * off.all
    return off.much > LOOKED[scene.degree] * off.all


def _sum(parts: Sequence[_Off]) -> _Off:
    """Of all processes."""
    worst = max(parts, key=lambda part: part.most)
    much, varying, whole = (sum(values) for values in zip(*(part[:3] for part in parts), strict=True))
    return _Off(much, varying, whole, worst.most, worst.at)


def _given(system: System, part: _Part, off: _Off, u: Floats, led: tuple[Floats, Floats | None]) -> tuple[float, float]:
    """What a body's cells have too much, and all, in the units of energy; led: by a force on its nodes these give way so.
    Where that does not tell, as what is left is unstable, what is known without; of mixed cells nothing is. Collective."""
    force, du = led
    if du is not None:
        rate = 0.5 * (part.energy(u + NUDGE * du) - part.energy(u - NUDGE * du)) / NUDGE
        work, rate = system.comm.allreduce(np.array([force @ du, rate]))
        too_much, left = off.much - 0.5 * float(work), off.all + 0.5 * float(rate)
        if work <= 0.0 < left and too_much < left:
            return too_much, left
    return 0.0 if part.mixed else off.much, off.all


def _by(share: float) -> str:
    """By how much what has a share of its stiffness too much is too stiff."""
    return f"{abs(share / (1.0 - share)):.0%}"


def _note(scene: "Scene", body: Body, off: _Off, shares: tuple[float, float]) -> str:
    """How far off a body is, and what to do; shares: of its stiffness, and of that of all bodies."""
    share, of_all = shares
    ratio = body.material.bulk_modulus / body.material.shear_modulus
    split = isinstance(body.material, Isotropic) and body.material.volumetric is not None
    way, more = "stiff" if share > 0.0 else "soft", " or more" if share > 0.0 and scene.degree == 1 else ""
    cells = f"cells of degree {scene.degree}" + (" with displacement alone" if scene.degree == 2 else "")
    off_by = f"body '{body.group}': {cells} make it too {way} by about {_by(share)}{more}"
    off_by += f" (with the other bodies as a whole by {_by(of_all)})" if len(scene.bodies) > 1 else ""
    off_by += f", most at {spot(off.at)}"
    if scene.degree == 2:
        return f"{off_by}, where they lock: take {'element=' + repr('mixed') if split else 'cells of half the size'}"
    mixed = " and element='mixed'" if ratio > INCOMPRESSIBLE and split and scene.element != "mixed" else ""
    where = f"as where it bends across few of them{' or locks' if mixed else ''}"
    return f"{off_by}, {where}: take degree=2{mixed}, or cells of half the size"


def _unseen(cell: _Cell, strained: _Strained, bulk: float, rates: _Rates | None) -> tuple[Floats, Floats]:
    """Of that part of J in each cell which is not linear, see `_Part._too_much`."""
    J, root = np.linalg.det(strained.F), np.sqrt(strained.volume)[..., None]
    changes = J[..., None]
    if rates:
        turned = J[..., None, None] * np.linalg.inv(strained.F).swapaxes(2, 3)
        changes = np.concatenate([changes, rates.each(turned)], axis=2)
    changes, linear = root * changes, np.column_stack([np.ones_like(cell.weights), cell.places])
    left: Floats = changes - _within(np.asarray(root * linear), changes)
    too_much: Floats = bulk * left.swapaxes(1, 2) @ left
    return 0.5 * too_much[:, 0, 0], too_much


def _within(basis: Floats, values: Floats) -> Floats:
    """What of values (n, q, c) sums of a basis (n, q, m) are."""
    across = basis.swapaxes(1, 2)
    within: Floats = basis @ np.linalg.solve(across @ basis, across @ values)
    return within


def _modes(cell: _Cell, strained: _Strained) -> Floats:
    """Strains (n, q, 3, 3, m) of enhanced modes that vary within each cell, small beside those of the cell as a whole."""
    (n, q), dim = strained.volume.shape, cell.places.shape[1]
    whole, modes = strained.mean(strained.F), []
    for i, slope in enumerate((1.0 - 2.0 * cell.places).T):  # of a bubble x (1 - x) along each direction of the cell
        gradient = np.zeros((n, q, 1, 3))
        gradient[..., 0, :dim] = strained.inverse[..., i] * slope[:, None]
        for axis in range(dim):
            H = whole[:, None, axis, :, None] * gradient
            if strained.radius is not None and axis == 0:
                H[..., 2, 2] = whole[:, None, 2, 2] * (cell.places[:, i] * (1.0 - cell.places[:, i])) / strained.radius
            modes.append(strained.varying(0.5 * (H + H.swapaxes(2, 3))))
    return np.stack(modes, axis=-1)


def _bending(
    cell: _Cell, strained: _Strained, moduli: tuple[float, float], mixed: bool, rates: _Rates | None
) -> tuple[Floats, Floats]:
    """Of Green strains that vary within each cell, see `_Part._too_much`: what enhanced modes take of them, and all of the
    changes of volume that no mode can take; of mixed cells these cost nothing as it is, and more with the modes."""
    (mu, bulk), (n, q), F = moduli, strained.volume.shape, strained.F
    modes, green = _modes(cell, strained), strained.varying(0.5 * (F.swapaxes(2, 3) @ F - np.eye(3)))
    of_modes, dilatation = (np.trace(strain, axis1=2, axis2=3) for strain in (modes, green))
    stresses = 2.0 * mu * modes + (bulk - 2.0 * mu / 3.0) * np.eye(3)[:, :, None] * of_modes[:, :, None, None]
    flat = stresses.reshape(n, 9 * q, -1).swapaxes(1, 2)
    works, dilatations = flat @ green.reshape(n, 9 * q, 1), dilatation[..., None]
    if rates:
        root = np.sqrt(strained.volume)[..., None, None, None]
        works = np.concatenate([works, rates.all(root * np.einsum("nqia,nqabk->nqibk", F, stresses))], axis=2)
        dilatations = np.concatenate([dilatations, strained.varying(rates.each(F))], axis=2)
    found = np.linalg.solve(flat @ modes.reshape(n, 9 * q, -1), works)
    slopes = 1.0 - 2.0 * cell.places
    left = dilatations - of_modes @ found
    left -= _within(strained.varying(np.broadcast_to(slopes, (n, *slopes.shape))), left)
    too_much = works.swapaxes(1, 2) @ found + bulk * left.swapaxes(1, 2) @ left
    sheared, changed = (green**2).sum(axis=(1, 2, 3)), (dilatation**2).sum(axis=1)
    now = mu * (sheared - changed / 3.0) + (0.0 if mixed else 0.5 * bulk) * changed
    return now, too_much - bulk * dilatations.swapaxes(1, 2) @ dilatations if mixed else too_much

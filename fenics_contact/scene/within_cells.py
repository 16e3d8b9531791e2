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
# Of a body's energy, by degree, of strain that varies within cells, or of J that mixed cells do not see: with less no solve
VARIES = {1: 0.01, 2: 0.002}
NUDGE = 1e-4  # of a motion, over which energies are differenced
INCOMPRESSIBLE = 10.0  # K / mu from which on cells of degree 2 should be mixed, too
COUNTS = 0.01  # of the energy of all bodies: one with less may be as stiff as it likes
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
        """Of this rank's cells, as of a law that its moduli at rest tell all of."""
        (mu, bulk), whole = self._moduli, 0.0
        for _, strained in self._strained(u, 1):
            J = np.linalg.det(strained.F)
            dilatation = strained.mean(J)[:, None] if self.mixed else J
            shear = np.cbrt(J) ** -2 * (strained.F**2).sum(axis=(2, 3)) - 3.0
            whole += float((strained.volume * (0.5 * mu * shear + 0.5 * bulk * (dilatation - 1.0) ** 2)).sum())
        return whole

    def off(self, u: Floats) -> _Off:
        """Of this rank's cells."""
        much, varying, most, at = 0.0, 0.0, -1.0, np.zeros(3)
        for nodes, strained in self._strained(u, 1):
            now, left = self._products(strained, self._varying(strained))
            off = 0.5 * (now - left)[:, 0, 0]
            much, varying = much + float(off.sum()), varying + 0.5 * float(now[:, 0, 0].sum())
            if np.abs(off).max() > most:
                most, at = float(np.abs(off).max()), self._X[nodes[np.abs(off).argmax()]].mean(axis=0)
        return _Off(much, varying, self.energy(u), most, at)

    def softer(self, u: Floats, force: Floats) -> Iterator[Blocks]:
        """What the tangent falls by; adds to a local array the force that comes with it."""
        for nodes, strained in self._strained(u, 3 * self._nodes.shape[1]):
            now, left = self._products(strained, self._varying(strained, rates=True))
            more = left - now
            np.add.at(force.reshape(-1, 3), nodes, more[:, 1:, 0].reshape(*nodes.shape, 3))
            yield Blocks(cells=(nodes, more[:, 1:, 1:]))

    def _varying(self, strained: _Strained, rates: bool = False) -> Floats:
        """What varies within cells (n, q, ..., 1 or 1 + dofs): Green strains, or of degree 2 J; with their rates."""
        F, cell, degree = strained.F, self._cell, self._scene.degree
        dim, gradients = cell.places.shape[1], strained.inverse @ cell.gradients
        turned = np.linalg.det(F)[..., None, None] * np.linalg.inv(F).swapaxes(2, 3) if degree == 2 else F
        green = 0.5 * (F.swapaxes(2, 3) @ F - np.eye(3))
        columns = [np.linalg.det(F) if degree == 2 else green]
        for node in range(cell.basis.shape[1] if rates else 0):
            for axis in range(3):
                rate = np.zeros_like(F)  # of F, on its row of this axis
                if axis < dim:
                    rate[..., axis, :dim] = gradients[..., node]
                if axis == 0 and strained.radius is not None:
                    rate[..., 2, 2] = cell.basis[:, node] / strained.radius
                if degree == 2:
                    columns.append((turned * rate).sum(axis=(2, 3)))
                else:
                    strain = F.swapaxes(2, 3) @ rate
                    columns.append(0.5 * (strain + strain.swapaxes(2, 3)))
        return np.stack([strained.varying(values) for values in columns], axis=-1)

    def _products(self, strained: _Strained, columns: Floats) -> tuple[Floats, Floats]:
        """Twice the energies (n, c, c) of columns with one another, as cells have them, and as they should."""
        if self._scene.degree == 2:
            return _seen(self._cell, strained, columns, self._moduli[1])
        return _bending(self._cell, strained, columns, self._moduli, self.mixed)


def stiffnesses(scene: "Scene", system: System, u: Floats, give: Give) -> dict[str, Stiffness]:
    """{body: its Stiffness} of those of quadrilaterals or hexahedra that are off by more than LEAST says where dofs have
    moved by u (local); give: see Give. Collective."""
    if compat.cell_name(scene.mesh.domain) in ("triangle", "tetrahedron") or (scene.degree, scene.element) == (2, "mixed"):
        return {}
    swell = [law.swelling and law.swelling[0] for law in system.terms[0].laws]
    parts = [_Part(scene, system, *of) for of in zip(scene.bodies, swell, strict=True)]
    found = [_sum(system.comm.allgather(part.off(u))) for part in parts]
    counts, varies = COUNTS * sum(off.all for off in found), VARIES[scene.degree]
    if not any(off.all > counts and off.varying > varies * off.all for off in found):
        return {}
    forces, total = [np.zeros_like(u) for _ in parts], np.zeros_like(u)

    def softer() -> Iterator[Blocks]:
        for part, force in zip(parts, forces, strict=True):
            yield from part.softer(u, force)
            total[:] += force

    du, out = give(softer(), total), dict[str, Stiffness]()
    for part, off, force in zip(parts, found, forces, strict=True):
        if not off.all > counts:
            continue
        share = _share(system, part, off, u, (force, du))
        if not -SOFT <= share <= LEAST[scene.degree]:
            out[part.body.group] = Stiffness(share, _note(scene, part.body, off, share))
    return out


def _sum(parts: Sequence[_Off]) -> _Off:
    """Of all processes."""
    worst = max(parts, key=lambda part: part.most)
    much, varying, whole = (sum(values) for values in zip(*(part[:3] for part in parts), strict=True))
    return _Off(much, varying, whole, worst.most, worst.at)


def _share(system: System, part: _Part, off: _Off, u: Floats, led: tuple[Floats, Floats | None]) -> float:
    """Of a body's stiffness, what its cells have too much; led: by a force on its nodes these give way so. Where that does
    not tell, as what is left is unstable, what is known without; of mixed cells nothing is. Collective."""
    force, du = led
    if du is not None:
        rate = 0.5 * (part.energy(u + NUDGE * du) - part.energy(u - NUDGE * du)) / NUDGE
        work, rate = system.comm.allreduce(np.array([force @ du, rate]))
        too_much, left = off.much - 0.5 * work, off.all + 0.5 * rate
        if work <= 0.0 and too_much < left:
            return float(too_much / left)
    return 0.0 if part.mixed else off.much / off.all


def _note(scene: "Scene", body: Body, off: _Off, share: float) -> str:
    """How far off a body is, and what to do."""
    ratio = body.material.bulk_modulus / body.material.shear_modulus
    split = isinstance(body.material, Isotropic) and body.material.volumetric is not None
    way, more = "stiff" if share > 0.0 else "soft", " or more" if share > 0.0 and scene.degree == 1 else ""
    cells = f"cells of degree {scene.degree}" + (" with displacement alone" if scene.degree == 2 else "")
    off_by = f"body '{body.group}': {cells} make it too {way} by about {abs(share / (1.0 - share)):.0%}{more}"
    off_by += f", most at {spot(off.at)}"
    if scene.degree == 2:
        return f"{off_by}, where they lock: take {'element=' + repr('mixed') if split else 'cells of half the size'}"
    mixed = " and element='mixed'" if ratio > INCOMPRESSIBLE and split and scene.element != "mixed" else ""
    where = f"as where it bends across few of them{' or locks' if mixed else ''}"
    return f"{off_by}, {where}: take degree=2{mixed}, or cells of half the size"


def _seen(cell: _Cell, strained: _Strained, columns: Floats, bulk: float) -> tuple[Floats, Floats]:
    """Of columns (n, q, c) of J, products (n, c, c) of what is not linear in each cell, as its energy has them, and none."""
    root: Floats = np.sqrt(strained.volume)[..., None]
    left = columns - _within(root * np.column_stack([np.ones_like(cell.weights), cell.places]), columns)
    now: Floats = bulk * left.swapaxes(1, 2) @ left
    return now, np.zeros_like(now)


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
    cell: _Cell, strained: _Strained, columns: Floats, moduli: tuple[float, float], mixed: bool
) -> tuple[Floats, Floats]:
    """Of columns (n, q, 3, 3, c) of Green strains that vary within each cell, products (n, c, c) as its energy has them, and
    where enhanced modes take what they can of it. A change of volume that no mode can take costs nothing then."""
    (mu, bulk), (n, q) = moduli, strained.volume.shape
    flat, modes = (
        (values.reshape(n, 9 * q, -1), np.trace(values, axis1=2, axis2=3)) for values in (columns, _modes(cell, strained))
    )
    (strains, traces), (modes_, of_modes) = flat, modes
    lame = bulk - 2.0 * mu / 3.0

    def product(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
        value: Floats = 2.0 * mu * a.swapaxes(1, 2) @ b + lame * c.swapaxes(1, 2) @ d
        return value

    found = np.linalg.solve(product(modes_, modes_, of_modes, of_modes), product(modes_, strains, of_modes, traces))
    bent, dilated = strains - modes_ @ found, traces - of_modes @ found
    slopes = 1.0 - 2.0 * cell.places
    reached = _within(strained.varying(np.broadcast_to(slopes, (n, *slopes.shape))), dilated)

    def energies(strain: Floats, dilatation: Floats, change: Floats) -> Floats:
        """change (n, q, c): of the volume, that which costs something."""
        shear = strain.swapaxes(1, 2) @ strain - dilatation.swapaxes(1, 2) @ dilatation / 3.0
        value: Floats = 2.0 * mu * shear + bulk * change.swapaxes(1, 2) @ change
        return value

    return energies(strains, traces, np.zeros_like(traces) if mixed else traces), energies(bent, dilated, reached)

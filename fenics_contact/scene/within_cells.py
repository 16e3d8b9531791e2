"""Bodies that are too stiff, or too soft, since their cells are, which say nothing of it: strain that varies within cells.

Degree 1.  A cell that bends has a shear of its own, and with displacement alone a change of volume, that the body has not;
with mixed elements a part of the volume's change costs nothing.  Two enhanced modes for each direction, zero at a cell's
nodes, let it bend as it should (Taylor, Beresford & Wilson 1976, doi:10.1002/nme.1620100602): what its energy would be with
them, all else being as it is, tells how far off a body is that is led.  A strip of 20 x 1 of square cells, 1 ... 4 across,
K / mu = 5, is 1.17, 0.30, 0.077 too stiff, and this says 1.16, 0.30, 0.075; with mixed elements -0.31, -0.073, -0.018, and
-0.31, -0.078, -0.020; an arch of 4 x 48 cells, pressed at its crown, 0.09, 0.21, 0.74 at K / mu = 5, 12.75, 50 (0.08, 0.18,
0.60), of one cell across, mixed, -0.10, -0.18, -0.22 (-0.13, -0.21, -0.25); a sphere of two layers under pressure 0.10,
0.31, 1.12 at 10, 30, 100 (0.09, 0.31, 1.16), Cook's membrane of 16 cells 0.07, 0.16, 0.40 (0.05, 0.11, 0.24); a bonded strip
is so by three times what this says.

Degree 2 of displacement alone.  Mixed cells of the same mesh leave out the energy of the part of J that their pressures do
not see, v of all; the body gives way by more than that: an arch of 6 ... 24 cells along it and 1 across is 3 ... 28 % too
stiff for v of 0.010 ... 0.053, the membrane 2.5 % for 0.007, a bonded strip 3 % for 0.005, a sphere 1 and 5 % for 0.02 and
0.065.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.system import System
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import Isotropic
from fenics_contact.types import Floats, Ints

if TYPE_CHECKING:
    from fenics_contact.scene.scene import Scene

LEAST = {1: 0.05, 2: 0.01}  # by degree: of a body's energy, from which share on it is told that a body is too stiff
# Likewise of energy of strain that varies within mixed cells in space or about an axis: where sides are free, or hoops give
# way, dofs themselves are far from where they should be, and nothing tells the sign. Beams of 4 x 2 x 1 cells, twice as long
# as high, are 70 % too stiff, of 8 x 1 x 1 cubes 25 % too soft
EITHER = 0.2
SOFT = 0.1  # likewise that it is too soft: a mixed sphere of two layers has 0.08 and is right, for its mean strains are less
INCOMPRESSIBLE = 10.0  # K / mu from which on cells of degree 2 should be mixed, too
COUNTS = 0.01  # of the energy of all bodies: one with less may be as stiff as it likes
MANY = 2_000_000  # values at once, of cells times their points times what varies there, which bounds memory


class Stiffness(NamedTuple):
    """Of a body, which share of its energy its cells have too much, negative where they have too little, and a note."""

    share: float
    note: str


class _Off(NamedTuple):
    """Energy that cells have too much, and all [energy]; the most that one has, either way, and where that is."""

    much: float
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
    turns about an axis, else None."""

    F: Floats
    inverse: Floats
    volume: Floats
    radius: Floats | None

    @classmethod
    def of(cls, scene: "Scene", cell: _Cell, X: Floats, u: Floats) -> "_Strained":
        """Of cells whose nodes X (n, m, 3) have moved by u (n, m, 3)."""
        dim = cell.places.shape[1]
        jacobian, moved = (cell.gradients @ values[:, None, :, :dim] for values in (X, u))
        inverse = np.linalg.inv(jacobian)
        F = np.zeros((*jacobian.shape[:2], 3, 3)) + np.eye(3)
        F[..., :dim, :dim] += (inverse @ moved).swapaxes(2, 3)
        volume, section = np.abs(np.linalg.det(jacobian)) * cell.weights, scene.section
        if section is None:
            return cls(F, inverse, volume, None)
        places = cell.basis @ X
        volume = volume * section.depth(places)
        if not section.axisymmetric:
            return cls(F, inverse, volume, None)
        F[..., 2, 2] += (cell.basis @ u[..., :1])[..., 0] / places[..., 0]
        return cls(F, inverse, volume, places[..., 0])

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


def stiffnesses(scene: "Scene", system: System, u: Floats) -> dict[str, Stiffness]:
    """{body: its Stiffness} of those of quadrilaterals or hexahedra that are off by more than LEAST or SOFT says where dofs
    have moved by u (local). Collective."""
    if compat.cell_name(scene.mesh.domain) in ("triangle", "tetrahedron") or (scene.degree, scene.element) == (2, "mixed"):
        return {}
    owned, tags, found = compat.cell_map(scene.mesh.domain).size_local, scene.mesh.cell_tags, list[_Off]()
    for body in scene.bodies:
        cells = tags.indices[(tags.values == scene.mesh.volume_tag(body.group)) & (tags.indices < owned)]
        found.append(_sum(system.comm.allgather(_off(scene, system, body, (cells, u)))))
    counts = COUNTS * sum(off.all for off in found)
    soft, least = (SOFT, LEAST[scene.degree]) if _signed(scene) else (0.0, EITHER)
    return {
        body.group: Stiffness(off.much / off.all, _note(scene, body, off))
        for body, off in zip(scene.bodies, found, strict=True)
        if off.all > counts and not -soft * off.all <= off.much <= least * off.all
    }


def _sum(parts: Sequence[_Off]) -> _Off:
    """Of all processes."""
    worst = max(parts, key=lambda part: part.most)
    return _Off(sum(part.much for part in parts), sum(part.all for part in parts), worst.most, worst.at)


def _signed(scene: "Scene") -> bool:
    """Whether it is known which way bodies are off: not of mixed cells in space or about an axis, see EITHER."""
    return bool(scene.element != "mixed" or (scene.section and not scene.section.axisymmetric))


def _note(scene: "Scene", body: Body, off: _Off) -> str:
    """How far off a body is, and what to do."""
    share, ratio = off.much / off.all, body.material.bulk_modulus / body.material.shear_modulus
    split, place = isinstance(body.material, Isotropic) and body.material.volumetric is not None, spot(off.at)
    if scene.degree == 2:
        return (
            f"body '{body.group}', K / mu = {ratio:.3g}: {share:.1%} of its energy is that of volumes that change within "
            f"cells, most at {place}: cells of displacement alone lock, and it is too stiff by as much, or up to six times "
            f"that; take {'element=' + repr('mixed') if split else 'finer cells'}"
        )
    if not _signed(scene):
        return (
            f"body '{body.group}': {share:.0%} of its energy is that of strain that varies within cells, most at {place}, "
            "as where it bends across few of them: mixed cells of degree 1 may be off by as much, too stiff where they are "
            "longer than high, too soft where not; take degree=2, or cells of half the size"
        )
    mixed = " and element='mixed'" if ratio > INCOMPRESSIBLE and split and scene.element != "mixed" else ""
    way, more = ("stiff", " or more") if share > 0.0 else ("soft", "")
    return (
        f"body '{body.group}': cells of degree 1 make it too {way} by about {abs(share / (1.0 - share)):.0%}{more}, most "
        f"at {place}, as where it bends across few of them{' or locks' if mixed else ''}: take degree=2{mixed}, or cells of "
        "half the size"
    )


def _off(scene: "Scene", system: System, body: Body, moved: tuple[Ints, Floats]) -> _Off:
    """Of these cells, where dofs have moved by so much."""
    cells, u = moved
    space, X = system.state.u.function_space, system.space.tabulate_dof_coordinates()
    cell = _Cell.of(compat.cell_name(space.mesh), scene.degree, space.mesh.topology.dim)
    nodes_moved, mixed = u.reshape(-1, space.dofmap.index_map_bs), bool(scene.element == "mixed")
    mu, bulk = body.material.shear_modulus, body.material.bulk_modulus
    much, whole, most, at = 0.0, 0.0, -1.0, np.zeros(3)
    dofs, many = compat.cell_dofs(space)[cells], max(MANY // (9 * cell.basis.size), 1)
    for first in range(0, len(cells), many):
        nodes = dofs[first : first + many]
        strained = _Strained.of(scene, cell, X[nodes], nodes_moved[nodes])
        J = np.linalg.det(strained.F)
        dilatation = np.broadcast_to(strained.mean(J)[:, None], J.shape) if mixed else J
        shear = np.cbrt(J) ** -2 * (strained.F**2).sum(axis=(2, 3)) - 3.0
        whole += float((strained.volume * (0.5 * mu * shear + 0.5 * bulk * (dilatation - 1.0) ** 2)).sum())
        off = _unseen(cell, strained, bulk) if scene.degree == 2 else _bending(cell, strained, (mu, bulk), scene)
        much += float(off.sum())
        if np.abs(off).max() > most:
            most, at = float(np.abs(off).max()), X[nodes[np.abs(off).argmax()]].mean(axis=0)
    return _Off(much, whole, most, at)


def _unseen(cell: _Cell, strained: _Strained, bulk: float) -> Floats:
    """Energies (n,) of that part of J in each cell which is not linear."""
    linear: Floats = np.column_stack([np.ones_like(cell.weights), cell.places])
    root: Floats = np.sqrt(strained.volume)
    left = _without(root[..., None] * linear, root * np.linalg.det(strained.F))
    energies: Floats = 0.5 * bulk * (left**2).sum(axis=1)
    return energies


def _without(basis: Floats, values: Floats) -> Floats:
    """What of values (n, q) no sum of a basis (n, q, m) is."""
    across = basis.swapaxes(1, 2)
    left: Floats = values - (basis @ np.linalg.solve(across @ basis, across @ values[..., None]))[..., 0]
    return left


def _bending(cell: _Cell, strained: _Strained, moduli: tuple[float, float], scene: "Scene") -> Floats:
    """By how much the energy (n,) of Green strains that vary within each cell falls where enhanced modes let them, or all of
    it where no sign is known; small strains beside those of the cell as a whole. A change of volume that no mode can take
    costs nothing then."""
    (mu, bulk), (n, q), dim = moduli, strained.volume.shape, cell.places.shape[1]
    slopes = 1.0 - 2.0 * cell.places  # of a bubble x (1 - x) along each direction of the cell
    whole, modes = strained.mean(strained.F), []
    for i in range(dim):
        gradient = np.zeros((n, q, 1, 3))
        gradient[..., 0, :dim] = strained.inverse[..., i] * slopes[:, i, None]
        for axis in range(dim):
            H = whole[:, None, axis, :, None] * gradient
            if strained.radius is not None and axis == 0:
                H[..., 2, 2] = whole[:, None, 2, 2] * (cell.places[:, i] * (1.0 - cell.places[:, i])) / strained.radius
            modes.append(strained.varying(0.5 * (H + H.swapaxes(2, 3))))
    green = strained.varying(0.5 * (strained.F.swapaxes(2, 3) @ strained.F - np.eye(3)))
    trace, traces = np.trace(green, axis1=2, axis2=3), np.stack([np.trace(mode, axis1=2, axis2=3) for mode in modes], axis=2)
    strains, flat = np.stack(modes, axis=4).reshape(n, 9 * q, -1), green.reshape(n, 9 * q, 1)
    lame = bulk - 2.0 * mu / 3.0

    def product(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
        value: Floats = 2.0 * mu * a.swapaxes(1, 2) @ b + lame * c.swapaxes(1, 2) @ d
        return value

    found = np.linalg.solve(product(strains, strains, traces, traces), product(strains, flat, traces, trace[..., None]))
    bent, dilated = (flat - strains @ found)[..., 0], trace - (traces @ found)[..., 0]
    reached = dilated - _without(strained.varying(np.broadcast_to(slopes, (n, *slopes.shape))), dilated)

    def energy(strain: Floats, dilatation: Floats, change: Floats) -> Floats:
        """change (n, q): of the volume, that which costs something."""
        shear = (strain**2).sum(axis=1) - (dilatation**2).sum(axis=1) / 3.0
        energies: Floats = mu * shear + 0.5 * bulk * (change**2).sum(axis=1)
        return energies

    now = energy(flat[..., 0], trace, np.zeros_like(trace) if scene.element == "mixed" else trace)
    return now - energy(bent, dilated, reached) if _signed(scene) else now

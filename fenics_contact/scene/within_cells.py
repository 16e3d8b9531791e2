"""Bodies that are too stiff since their cells are, which say nothing of it: what varies within cells tells.

Strain: a cell of degree 1 that bends has a shear of its own that the body has not.  Of a section that bends, n square
cells high, about 1/n^2 of the squares of the strain varies, and more the longer the cells are.  A strip of 10 x 1 led aside
at its ends is 1.11, 1.18, 1.38, 2.3 times too stiff with 4 ... 1 of them across, and 0.07, 0.12, 0.26, 0.88 of it varies;
with mixed elements 0.8 ... 0.99 times, but 1.3 where cells are four times as long as high.  Where contacts press on coarse
cells it is some hundredths.

Volume: cells of displacement alone lock where K is far above mu.  Mixed ones of the same mesh leave out the energy of the
part of J that their pressures do not see: a body that is led has what is left at most then, so that with displacement
alone it is too stiff by v / (1 - v) at least, v the share of the energy left out.  An arch pressed at its crown, of 4 x 48
cells of degree 1, is so by 9, 21, 74 % at K / mu = 5, 12.75, 50, and this says 9, 20, 64 %; Cook's membrane of 16 by 7, 14,
28 % at 10, 30, 100 (5, 12, 26 %), a sphere of two layers by 9, 24, 53 % (8, 25, 89 %).  In degree 2 what gives way then
is more: the arch of 6 ... 24 cells along it and 1 across is 3 ... 28 % too stiff for v of 0.010 ... 0.053, the membrane
2.5 % for 0.007, a bonded strip 3 % for 0.005, the sphere 1 and 5 % for 0.02 and 0.065.
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

# of the squares of a body's strain, from which share on it is told, and what cells of degree 1 are then
VARIES = {
    "displacement": (0.2, "too stiff there by about that share or more"),
    "mixed": (0.3, "off there by about that share or more, mostly too stiff"),
}
LOCKS = {1: 0.03, 2: 0.01}  # by degree: of a body's energy, from which share on it is told
COUNTS = 0.01  # of all bodies' strain, by their moduli: a body with less may be as stiff as it likes
MANY = 1_000_000  # values at once, of cells times their nodes times their points, which bounds memory


class _Share(NamedTuple):
    """What varies within cells of a body, and all of it; what the cell has in which most does, and where that is."""

    varies: float
    whole: float
    most: float
    at: Floats


class _Cell(NamedTuple):
    """Points of a cell: the basis (q, n), its gradients (q, d, n), weights (q,), and what pressures can be (q, m)."""

    basis: Floats
    gradients: Floats
    weights: Floats
    pressures: Floats

    @classmethod
    def of(cls, name: str, degree: int, dim: int) -> "_Cell":
        """Gauss's points of a square or cube."""
        x, w = np.polynomial.legendre.leggauss(degree + 1)
        points = 0.5 + 0.5 * np.stack(np.meshgrid(*dim * [x], indexing="ij"), axis=-1).reshape(-1, dim)
        weights = np.prod(np.meshgrid(*dim * [0.5 * w], indexing="ij"), axis=0).ravel()
        values = compat.tabulate(compat.basix_element(name, degree), 1, points)
        pressures = np.column_stack([np.ones(len(points)), *(points.T if degree > 1 else ())])
        return cls(values[0], np.ascontiguousarray(values[1:].transpose(1, 0, 2)), weights, pressures)


def stiff_notes(scene: "Scene", system: System) -> list[str]:
    """Notes on each body of quadrilaterals or hexahedra that bends across few of them, as VARIES says, and that locks, as
    LOCKS does. Collective."""
    if compat.cell_name(scene.mesh.domain) in ("triangle", "tetrahedron"):
        return []
    owned, tags = compat.cell_map(scene.mesh.domain).size_local, scene.mesh.cell_tags
    found = []
    for body in scene.bodies:
        cells = tags.indices[(tags.values == scene.mesh.volume_tag(body.group)) & (tags.indices < owned)]
        found.append(
            [_sum(parts) for parts in zip(*system.comm.allgather(_shares(scene, system, body, cells)), strict=True)]
        )
    moduli = [body.material.shear_modulus for body in scene.bodies]
    least = COUNTS * sum(modulus * strain.whole for modulus, (strain, _) in zip(moduli, found, strict=True))
    notes = []
    for body, modulus, (strain, volume) in zip(scene.bodies, moduli, found, strict=True):
        if modulus * strain.whole > least:
            notes += [_bends(scene, body, strain), _locks(scene, body, volume)]
    return [note for note in notes if note]


def _sum(parts: Sequence[_Share]) -> _Share:
    """Of all processes."""
    worst = max(parts, key=lambda part: part.most)
    return _Share(sum(part.varies for part in parts), sum(part.whole for part in parts), worst.most, worst.at)


def _bends(scene: "Scene", body: Body, strain: _Share) -> str:
    """The note on a body that bends across few cells, empty where it does not."""
    least, words = VARIES[scene.element]
    if scene.degree != 1 or strain.varies <= least * strain.whole:
        return ""
    return (
        f"body '{body.group}': {strain.varies / strain.whole:.2g} of its strain varies within cells, most at "
        f"{spot(strain.at)}, as where it bends across few of them: cells of degree 1 are {words}; take degree=2, or twice "
        "as many cells across what bends and along it"
    )


def _locks(scene: "Scene", body: Body, volume: _Share) -> str:
    """The note on a body that locks, empty where it does not."""
    share, material = volume.varies / volume.whole if volume.whole > 0.0 else 0.0, body.material
    if scene.element != "displacement" or share <= LOCKS[scene.degree]:
        return ""
    more = (
        f"about {share / (1.0 - share):.1%} or more, three times that where it is bonded"
        if scene.degree == 1
        else "as much, or up to six times that"
    )
    split = isinstance(material, Isotropic) and material.volumetric is not None
    remedy = "element='mixed'" if split else "finer cells" if scene.degree == 2 else "degree=2"
    return (
        f"body '{body.group}', K / mu = {material.bulk_modulus / material.shear_modulus:.3g}: {share:.1%} of its energy is "
        f"that of volumes that change within cells, most at {spot(volume.at)}: cells of displacement alone lock, and it is "
        f"too stiff by {more}; take {remedy}"
    )


def _shares(scene: "Scene", system: System, body: Body, cells: Ints) -> tuple[_Share, _Share]:
    """Of these cells squares of the Green strain, times volumes; and energy, of which the volume's may vary."""
    space, X = system.state.u.function_space, system.space.tabulate_dof_coordinates()
    dim, u = space.mesh.topology.dim, system.state.u.x.array.reshape(-1, space.dofmap.index_map_bs)
    cell, bulk = _Cell.of(compat.cell_name(space.mesh), scene.degree, dim), 0.5 * body.material.bulk_modulus
    sums, most, at = np.zeros((2, 2)), np.full(2, -1.0), np.zeros((2, 3))
    dofs, many = compat.cell_dofs(space)[cells], max(MANY // cell.basis.size, 1)
    for first in range(0, len(cells), many):
        nodes = dofs[first : first + many]
        F, weight = _deformation(scene, cell, X[nodes], u[nodes])
        green = 0.5 * (F.swapaxes(2, 3) @ F - np.eye(3))
        off = green - np.average(green, axis=1, weights=np.broadcast_to(weight[..., None, None], green.shape))[:, None]
        J = np.linalg.det(F)
        shear = 0.5 * body.material.shear_modulus * (np.cbrt(J) ** -2 * (F**2).sum(axis=(2, 3)) - 3.0)
        bends, locks = (weight * (off**2).sum(axis=(2, 3))).sum(axis=1), bulk * _unseen(cell, J, weight)
        sums += [
            [bends.sum(), (weight * (green**2).sum(axis=(2, 3))).sum()],
            [locks.sum(), (weight * (shear + bulk * (J - 1.0) ** 2)).sum()],
        ]
        for i, varies in enumerate((bends, locks)):
            if varies.max() > most[i]:
                most[i], at[i] = varies.max(), X[nodes[varies.argmax()]].mean(axis=0)
    strain, volume = (_Share(float(sums[i, 0]), float(sums[i, 1]), float(most[i]), at[i]) for i in range(2))
    return strain, volume


def _deformation(scene: "Scene", cell: _Cell, X: Floats, u: Floats) -> tuple[Floats, Floats]:
    """F (n, q, 3, 3) at points of cells whose nodes X (n, m, 3) have moved by u (n, m, 3), and volumes (n, q) there."""
    dim = cell.gradients.shape[1]
    jacobian, moved = (cell.gradients @ values[:, None, :, :dim] for values in (X, u))
    F = np.zeros((*jacobian.shape[:2], 3, 3)) + np.eye(3)
    F[..., :dim, :dim] += np.linalg.solve(jacobian, moved).swapaxes(2, 3)
    volume = np.abs(np.linalg.det(jacobian)) * cell.weights
    if scene.section is None:
        return F, volume
    places = np.einsum("qm,nmi->nqi", cell.basis, X)
    if scene.section.axisymmetric:
        F[..., 2, 2] += np.einsum("qm,nm->nq", cell.basis, u[..., 0]) / places[..., 0]
    return F, volume * scene.section.depth(places)


def _unseen(cell: _Cell, J: Floats, volume: Floats) -> Floats:
    """The integral over each cell (n,) of the square of what of J (n, q) pressures of mixed cells do not see."""
    gram = np.einsum("nq,qi,qj->nij", volume, cell.pressures, cell.pressures)
    seen = np.linalg.solve(gram, np.einsum("nq,qi,nq->ni", volume, cell.pressures, J)[..., None])[..., 0] @ cell.pressures.T
    squares: Floats = (volume * (J - seen) ** 2).sum(axis=1)
    return squares

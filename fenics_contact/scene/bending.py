"""Bodies that bend across few cells of degree 1, which are too stiff for that, and say nothing of it.

A cell that bends has a shear of its own that the body has not.  Strain that varies within cells tells: of a section that
bends, n square cells high, about 1/n^2 of the squares of it, and more the longer the cells are.  A strip of 10 x 1 led aside
at its ends is 1.11, 1.18, 1.38, 2.3 times too stiff with 4 ... 1 of them across, and 0.07, 0.12, 0.26, 0.88 of it varies;
with mixed elements 0.8 ... 0.99 times, but 1.3 where cells are four times as long as high.  Where contacts press on coarse
cells it is some hundredths.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.system import System
from fenics_contact.types import Floats, Ints

if TYPE_CHECKING:
    from fenics_contact.scene.scene import Scene

# of the squares of a body's strain, from which on it is told, and what cells are then
VARIES = {
    "displacement": (0.2, "too stiff there by about that share or more"),
    "mixed": (0.3, "off there by about that share or more, mostly too stiff"),
}
COUNTS = 0.01  # of all bodies' strain, by their moduli: a body with less may bend as it likes
MANY = 50_000  # cells at once, which bounds memory


class _Strain(NamedTuple):
    """Squares of the Green strain's part that varies within cells, and of all of it, times volumes; the place of the cell
    with most of the first, and what it has."""

    varies: float
    whole: float
    at: Floats
    most: float


def bending_notes(scene: "Scene", system: System) -> list[str]:
    """A note for each body of which so much of the strain varies within cells as VARIES says. Collective."""
    if scene.degree != 1 or compat.cell_name(scene.mesh.domain) not in ("quadrilateral", "hexahedron"):
        return []
    owned, tags = compat.cell_map(scene.mesh.domain).size_local, scene.mesh.cell_tags
    X, found = system.space.tabulate_dof_coordinates(), {}
    for body in scene.bodies:
        cells = tags.indices[(tags.values == scene.mesh.volume_tag(body.group)) & (tags.indices < owned)]
        parts = system.comm.allgather(_strain(system, X, cells))
        worst = max(parts, key=lambda part: part.most)
        found[body.group] = _Strain(sum(p.varies for p in parts), sum(p.whole for p in parts), worst.at, worst.most)
    moduli = {body.group: body.material.shear_modulus for body in scene.bodies}
    everywhere = sum(moduli[name] * strain.whole for name, strain in found.items())
    least, words = VARIES[scene.element]
    return [
        f"body '{name}': {strain.varies / strain.whole:.2g} of its strain varies within cells, most at {spot(strain.at)}, "
        f"as where it bends across few of them: cells of degree 1 are {words}; take degree=2, or twice as many cells across "
        "what bends and along it"
        for name, strain in found.items()
        if strain.varies > least * strain.whole and moduli[name] * strain.whole > COUNTS * everywhere
    ]


def _strain(system: System, X: Floats, cells: Ints) -> _Strain:
    """The sums over these cells of nodes at X (n, 3) in the reference."""
    space = system.state.u.function_space
    name, dim = compat.cell_name(space.mesh), space.mesh.topology.dim
    line = 0.5 + 0.5 * np.polynomial.legendre.leggauss(2)[0]
    # of weights that are all the same
    points = np.stack(np.meshgrid(*dim * [line], indexing="ij"), axis=-1).reshape(-1, dim)
    gradients = np.ascontiguousarray(compat.tabulate(compat.basix_element(name, 1), 1, points)[1:].transpose(1, 0, 2))
    u = system.state.u.x.array.reshape(-1, space.dofmap.index_map_bs)
    dofs, varies, whole = compat.cell_dofs(space)[cells], 0.0, 0.0
    at, most = np.zeros(3), -1.0
    for first in range(0, len(cells), MANY):
        nodes = dofs[first : first + MANY]
        jacobian, moved = (gradients @ values[nodes][:, None, :, :dim] for values in (X, u))
        H = np.linalg.solve(jacobian, moved)  # transposed
        green = 0.5 * (H + H.swapaxes(2, 3) + H @ H.swapaxes(2, 3))
        weight = np.abs(np.linalg.det(jacobian))[..., None, None]
        off = green - (weight * green).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
        part = (weight * off**2).sum(axis=(1, 2, 3))
        varies, whole = varies + float(part.sum()), whole + float((weight * green**2).sum())
        if part.max() > most:
            at, most = X[nodes[np.argmax(part)]].mean(axis=0), float(part.max())
    return _Strain(varies, whole, at, most)

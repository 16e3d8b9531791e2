"""Master surfaces, of a deformable body or a meshed tool: facets and current node positions, in full on every rank."""

from functools import cached_property
from typing import Protocol

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.facet_points import geometry_degree
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.section import Section
from fenics_contact.assembly.term import State
from fenics_contact.contact.chords import arches, cut_off
from fenics_contact.contact.tools import MeshedTool
from fenics_contact.kernels.closest_point import Projection
from fenics_contact.kernels.facets import MAX_NODES, Surface
from fenics_contact.kernels.quadratic import LINE, STRIP, TRIANGLE
from fenics_contact.kernels.vectors import Vector
from fenics_contact.types import Floats, Ints, Ints64, Space

# Derivatives of a facet's shape functions in its centre, by its number of corners: two tangents, of a plane cell's side one
CENTRE = {
    2: np.array([[-1.0, 1.0, 0.0, 0.0]]),
    3: np.array([[-1.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0]]),
    4: np.array([[-0.5, 0.5, 0.5, -0.5], [-0.5, -0.5, 0.5, 0.5]]),
}
NORMAL = 1e-6  # of a direction of length one: what lies less in a facet is normal to it


def motion(then: "Meeting", now: "Meeting", first: int) -> Floats:
    """Ways (nx, 3) of nodes from one meeting to another, those of a tool, from number `first` on, along the tangents of
    their circles, as a tangent foresees them: their chords would lead it away from what it turns on."""
    out = now.coords - then.coords
    if then.pose is not None and now.pose is not None:
        out[first:] = then.pose.way(now.pose, then.coords[first:])
    return out


class Meeting(Protocol):
    """Where slave and master are: coords (nx, 3) of the slave's nodes, then the master's, points (np, 3) [length]; of a tool
    its pose; which facets points meet there."""

    @property
    def coords(self) -> Floats: ...

    @property
    def points(self) -> Floats: ...

    @property
    def pose(self) -> Pose | None: ...

    @property
    def projection(self) -> Projection: ...


def oriented_facets(space: Space, facets: Ints) -> tuple[Ints64, Ints64, Ints64]:
    """Exterior facets of owned cells as rings of nodes, counter-clockwise seen from outside.

    space: vector Lagrange space of degree 1; facets: local facet numbers. Returns nodes (nf, 4) local node numbers (a
    triangle repeats its third), size (nf,) and key (nf,): a number of the facet that no partition changes.
    """
    mesh = space.mesh
    cells, local = compat.cells_of_exterior_facets(mesh, facets)
    if mesh.topology.dim == 2:
        return _strips(space, cells, local)
    hexahedra = compat.cell_name(mesh) == "hexahedron"
    ring = [0, 1, 3, 2] if hexahedra else [0, 1, 2, 2]  # quadrilaterals are numbered like a grid
    corners = np.array([compat.facet_closure_dofs(space, f)[ring] for f in range(6 if hexahedra else 4)])
    of_cell = compat.cell_dofs(space)[cells]
    nodes = np.take_along_axis(of_cell, corners[local], axis=1).astype(np.int64)
    X = space.tabulate_dof_coordinates()
    outward = X[nodes].mean(axis=1) - X[of_cell].mean(axis=1)
    inside_out = np.einsum("fc,fc->f", area_vectors(X[nodes]), outward) < 0.0
    nodes[inside_out] = nodes[inside_out][:, [0, 3, 2, 1] if hexahedra else [0, 2, 1, 1]]
    size = np.full(len(nodes), 4 if hexahedra else 3, dtype=np.int64)
    return nodes, size, compat.original_cells(mesh)[cells].astype(np.int64) * 6 + local


def _strips(space: Space, cells: Ints, local: Ints64) -> tuple[Ints64, Ints64, Ints64]:
    """Sides of plane cells as rings of nodes: there and, behind the plane, back, of which the far ones are the near ones."""
    mesh = space.mesh
    corners = np.array([compat.facet_closure_dofs(space, f)[:2] for f in range(compat.FACETS[compat.cell_name(mesh)])])
    of_cell = compat.cell_dofs(space)[cells]
    nodes = np.take_along_axis(of_cell, corners[local], axis=1).astype(np.int64)
    X = space.tabulate_dof_coordinates()
    along, outward = X[nodes[:, 1]] - X[nodes[:, 0]], X[nodes].mean(axis=1) - X[of_cell].mean(axis=1)
    clockwise = along[:, 1] * outward[:, 0] - along[:, 0] * outward[:, 1] < 0.0  # with the far side at z > 0
    nodes[clockwise] = nodes[clockwise][:, ::-1]
    size = np.full(len(nodes), 4, dtype=np.int64)
    return nodes[:, [0, 1, 1, 0]], size, compat.original_cells(mesh)[cells].astype(np.int64) * 6 + local


def whole_facets(space: Space, facets: Ints) -> tuple[Ints64, Ints64, Ints64]:
    """The same of a space of degree 2, with all nodes (nf, m) in the order of kernels/quadratic.py: corners, middles of the
    sides between them, the centre; of the sides of plane cells two ends and a middle."""
    mesh = space.mesh
    cells, _ = compat.cells_of_exterior_facets(mesh, facets)
    corners, size, key = oriented_facets(space, facets)
    cell = compat.cell_name(mesh)
    count = {"hexahedron": 4, "tetrahedron": 3}.get(cell, 2)
    of_cell, ring = compat.cell_dofs(space)[cells], corners[:, :count]
    places = np.argmax(of_cell[:, None] == ring[:, :, None], axis=2)  # of the corners in their cells
    sides = {4: [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)], 3: [(0, 1), (1, 2), (2, 0)], 2: [(0, 1)]}[count]
    middles = _middles(cell)[places[:, [i for i, _ in sides]], places[:, [j for _, j in sides]]]
    nodes = np.column_stack([ring, np.take_along_axis(of_cell, middles, axis=1)]).astype(np.int64)
    return nodes, np.full_like(size, count + len(sides)), key


def _middles(cell: str) -> Ints64:
    """Number (corners, corners) of the node of a cell of degree 2 that lies in the middle between two of its corners."""
    x, corners = compat.basix_element(cell, 2).points, len(compat.basix_element(cell, 1).points)
    between = 0.5 * (x[:corners, None] + x[:corners])
    return np.argmin(np.linalg.norm(between[:, :, None] - x, axis=3), axis=2)


def area_vectors(corners: Floats) -> Floats:
    """Normal times area (nf, 3) of facets with corners (nf, 4, 3); a triangle repeats its third corner."""
    return 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])


class FacetSurface:
    """Facets (nodes (nf, m), size (nf,)) and the reference positions X (nm, 3) of their nodes [length].

    edge, longest: median and largest length of the facets' edges; corners: flat facets (nodes (nf, 4), size (nf,)) of the
    corners, the first `count` nodes, of triangles the third twice, of sides of plane cells both; whole: they are of degree
    2, with all their nodes; straight: so are the cells as drawn.
    """

    straight = True
    index = -1  # row of a tool in the state's q

    def __init__(self, facets: Surface, X: Floats, count: int = 4) -> None:
        self.facets: Surface = np.ascontiguousarray(facets[0]), facets[1]
        self.X, self.whole = X, facets[0].shape[1] != MAX_NODES
        ring = facets[0][:, :count]
        edges = np.linalg.norm(X[ring] - np.roll(X[ring], 1, axis=1), axis=2)
        edges = edges[edges > 0.0]
        self.edge, self.longest = (float(f(edges)) if edges.size else 0.0 for f in (np.median, np.max))
        flat = ring if count == 4 else ring[:, [0, 1, 2, 2] if count == 3 else [0, 1, 1, 0]]
        self.corners: Surface = np.ascontiguousarray(flat), np.minimum(facets[1], count)

    @cached_property
    def cut_off(self) -> Floats:
        """Mean distances (nf,) [length] of a round surface from its facets, positive outside; of curved cells none."""
        return cut_off(self) if self.straight else np.zeros(len(self.facets[0]))

    @cached_property
    def arches(self) -> Floats:
        """The same at the nodes (nm,) of facets of degree 2."""
        return arches(self) if self.straight else np.zeros(len(self.X))

    def degenerate(self) -> Floats:
        """Reference positions of the centres of facets without area (n, 3)."""
        nodes, size = self.corners
        corners = self.X[nodes]
        area = np.linalg.norm(area_vectors(corners), axis=1)
        length = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)  # of the sides of plane cells
        small = np.where(size == 2, length < 1e-12 * self.longest, area < 1e-12 * self.longest**2)
        return corners[small].mean(axis=1)


class MasterSurface(FacetSurface):
    """All facets of a master group on every rank, in an order that no partition changes.

    facets number the surface's nodes 0 ... nm - 1, each once; blocks (nm,): their global block numbers; moving: these, each
    once and rising; keys (nm,): their numbers that no partition changes; named: its local facets of the mesh. The exchange
    is one gather of owned positions to all ranks per evaluation: a surface is small against its volume.

    section: what the curves of a plane mesh stand for. They are strips here, as deep as their sides are long on average:
    behind all their nodes come as many far ones, of the same displacements and forces. whole: facets of degree 2 with all
    their nodes; of a plane mesh without a section those are sides of 3 nodes.
    """

    def __init__(self, space: Space, facets: Ints, section: Section | None = None, whole: bool = False) -> None:
        self.space, self.named = space, facets
        self.comm, self.size = space.mesh.comm, space.dofmap.index_map.size_global  # of the System, in blocks
        self.straight = geometry_degree(space.mesh) == 1
        nodes, size, key = whole_facets(space, facets) if whole else oriented_facets(space, facets)
        to_global = compat.global_blocks(space)
        rows = np.column_stack([key, size, to_global[nodes]]).astype(np.int64)
        rows = np.concatenate(self.comm.allgather(rows))
        rows = rows[np.argsort(rows[:, 0])]
        self.moving, numbered = np.unique(rows[:, 2:], return_inverse=True)
        everywhere = (np.ascontiguousarray(numbered.reshape(-1, nodes.shape[1])), np.ascontiguousarray(rows[:, 1]))
        # blocks of one rank are consecutive, so the sorted blocks are the ranks' parts one after the other
        first, end = space.dofmap.index_map.local_range
        self.mine = slice(*np.searchsorted(self.moving, [first, end]))
        self.owned = (self.moving[self.mine] - first).astype(np.int64)
        self._counts = 3 * np.array(self.comm.allgather(len(self.owned)))
        self.keys = np.concatenate(self.comm.allgather(node_keys(space)[self.owned]))
        self.blocks = self.moving
        X, self.section = self.gathered(space.tabulate_dof_coordinates()[self.owned]), section
        if section is not None:
            ends = everywhere[0][:, :2]
            half = 0.5 * np.linalg.norm(X[ends[:, 1]] - X[ends[:, 0]], axis=1).mean() if len(ends) else 0.0
            X = np.concatenate([X - [0.0, 0.0, half], X + [0.0, 0.0, half]])
            if whole:
                everywhere = (everywhere[0][:, [0, 1, 1, 0, 2, 2]], np.full_like(everywhere[1], STRIP))
            everywhere[0][:, [2, 3, 5] if whole else [2, 3]] += len(self.moving)
            self.blocks, self.keys = np.tile(self.moving, 2), np.concatenate([2 * self.keys, 2 * self.keys + 1])
        count = {LINE: 2, TRIANGLE: 3}.get(int(everywhere[1].max(initial=0)), 4) if whole else 4
        super().__init__(everywhere, X, count)

    def gathered(self, owned: Floats) -> Floats:
        """Values (n, 3) of all nodes, of strips the near ones, from those of this rank's own. Collective."""
        everything = np.empty((self._counts.sum() // 3, 3))
        self.comm.Allgatherv(np.ascontiguousarray(owned), [everything, self._counts])
        return everything

    def positions(self, state: State) -> Floats:
        """Current positions (nm, 3) [length] on every rank. Collective."""
        u = self.gathered(state.u.x.array.reshape(-1, 3)[self.owned])
        return self.X + (u if self.section is None else np.tile(u, (2, 1)))

    def each(self, x: Floats, forces: Floats) -> tuple[Floats, Floats]:
        """Of all nodes (nx, 3) their places and forces, of those of strips each once, in the plane and of all the depth."""
        if self.section is None:
            return x, forces
        (near, far), (front, back) = np.split(x, 2), np.split(forces, 2)
        return 0.5 * (near + far), front + back

    def directed(self, along: Vector) -> Floats:
        """Parts (nf, m) of the facets' nodes in vectors of their directions of friction: `along`, of length one, as it lies
        in a facet of the undeformed body, turns and shears with that; zeros where it is normal to the facet."""
        nodes, size = self.corners
        count = int(size[0]) if len(size) else 4
        tangents = CENTRE[count]
        R = np.einsum("ai,fic->fac", tangents, self.X[nodes])
        metric = np.einsum("fac,fbc->fab", R, R)
        parts = np.einsum("fab,fbc,c->fa", np.linalg.pinv(metric, hermitian=True), R, along)
        length = np.linalg.norm(np.einsum("fa,fac->fc", parts, R), axis=1, keepdims=True)
        parts = np.where(length > NORMAL, parts / np.maximum(length, NORMAL), 0.0) @ tangents
        out = np.zeros(self.facets[0].shape)
        out[:, :count] = parts[:, :count]
        return out

    def pose(self, state: State) -> None:
        """None: a body is no tool."""

    def point(self, state: State) -> None:
        """None: a body has no point of its own."""

    def add_forces(self, forces: Floats, residual: Floats) -> None:
        """Add nodal forces (nm, 3), summed over all ranks, to the owned dofs of a local array. Collective."""
        total = np.empty_like(forces)
        self.comm.Allreduce(forces, total, op=MPI.SUM)
        if self.section is not None:
            near, far = np.split(total, 2)
            total = near + far
        residual.reshape(-1, 3)[self.owned] += total[self.mine]

    def react(self, feet: "Meeting", forces: Floats, residual: Floats, tool_residual: Floats) -> None:
        """Add what acts on this surface of the forces (nx, 3) at the `coords` of feet: the last ones. Collective."""
        self.add_forces(forces[len(forces) - len(self.X) :], residual)


class ToolSurface(FacetSurface):
    """The meshed surface of a rigid tool, the same on every rank: it moves as a whole and has no dofs.

    tool: MeshedTool; index: its row in the state's q.
    """

    def __init__(self, tool: MeshedTool, index: int) -> None:
        super().__init__((tool.nodes, tool.size), tool.X)
        self.index = index
        self.blocks = np.full(len(tool.X), -1, dtype=np.int64)  # no node of the System
        self.keys = np.arange(len(tool.X))
        self.owned = np.empty(0, dtype=np.int64)

    def positions(self, state: State) -> Floats:
        """Current positions (nm, 3) [length]."""
        return self.pose(state).placed(self.X)

    def directed(self, along: Vector) -> Floats:
        """None (0, m): directions of friction turn with a tool as a whole."""
        return np.empty((0, self.facets[0].shape[1]))

    def pose(self, state: State) -> Pose:
        """Where the tool is."""
        return state.pose(self.index)

    def point(self, state: State) -> Floats:
        """The tool's reference point (3,) [length]."""
        return self.pose(state).place

    def react(self, feet: "Meeting", forces: Floats, residual: Floats, tool_residual: Floats) -> None:
        """Take the opposite of the forces on the slave's nodes, the first ones of (nx, 3) at the `coords` of feet: what acts
        on slave and tool together is in balance."""
        slave = len(forces) - len(self.X)
        if feet.pose is not None:
            tool_residual[self.index] -= feet.pose.wrench(feet.coords[:slave], forces[:slave])

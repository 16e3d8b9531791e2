"""Contact of a slave surface with a meshed rigid tool: the contact of two bodies, whose master has a travel for dofs."""

import numpy as np

from fenics_contact.contact.deformable import DeformableContact
from fenics_contact.contact.master import ToolSurface, area_vectors
from fenics_contact.contact.pair_pattern import PairPattern

# A slave point and the facet nearest to it say on which side of the tool the body is if their normals are this parallel.
DECISIVE = 0.5
SAMPLES = 300  # slave points of a rank that are asked for it


class MeshedToolContact(DeformableContact):
    """DeformableContact whose master's forces, rows and columns are summed to those of the tool's travel."""

    grounded = True
    slid_off = (
        "the tool has slid past the end of the slave surface: end the path before, keep the tool over it, or, where the "
        "tool itself ends there, make its surface larger"
    )

    def __init__(self, name, surface, facets, tool, index, friction, normal_penalty, tangential_penalty, space):
        master = ToolSurface(tool, index)
        super().__init__(name, tool.name, surface, facets, master, friction, normal_penalty, tangential_penalty, space)
        self.edge = f"meshed, {len(tool.nodes)} facets"

        # the tool's nodes travel as one: behind this rank's slave nodes they are one node of the pattern
        tool = len(self._local)
        blocks = np.concatenate([np.arange(tool), np.full(len(master.X), tool)])
        self._pattern = PairPattern(self._slaves[0], self._facets[0], blocks, tool + 1)
        nodes = np.column_stack([self._slaves[0], np.full(len(self._slaves[0]), tool)])
        self._pattern.set(np.unique(nodes[:, :, None] * (tool + 1) + nodes[:, None, :]))

    def add_tangent(self, state, matrix, border):
        rows, columns, values = self._tangent_blocks(state)
        tool = len(self._local)
        inside = (rows < tool) & (columns < tool)
        starts = np.flatnonzero(np.diff(rows[inside], prepend=-1))
        offsets = np.append(starts, inside.sum()).astype(np.int32)
        at, along = (self._local[part[inside]].astype(np.int32) for part in (rows, columns))
        matrix.setValuesBlockedLocalIJV(offsets, along, values[inside], addv=True, rowmap=at[starts])
        if border is None:
            return
        mine = slice(3 * self.master.index, 3 * self.master.index + 3)
        for c in range(3):
            here = (rows < tool) & (columns == tool)
            border.columns[mine][:, 3 * self._local[rows[here]] + c] += values[here, c].T
            here = (rows == tool) & (columns < tool)
            border.rows[mine][:, 3 * self._local[columns[here]] + c] += values[here, :, c].T
        border.corner[mine, mine] += values[(rows == tool) & (columns == tool)].sum(axis=0)

    def couplings(self, state):
        """None: a tool has no dofs, and nodes of one facet are coupled by the solid."""

    def back_share(self, state, comm):
        """Share of the slave points that see the nearest facet of the tool from behind. Collective."""
        coords, points, normals = self._positions(state)
        if self.surface.gradients is not None:  # nodal normals are means of facets of degree 1
            s = self.surface
            x = s.X + state.u.x.array.reshape(-1, 3)[s.nodes]
            tangents = np.einsum("eqtk,ekc->eqtc", s.gradients, x).reshape(-1, 2, 3)
            normals = _unit(np.cross(tangents[:, 0], tangents[:, 1]))
        some = slice(None, None, max(len(points) // SAMPLES, 1))
        corners = coords[self._facets[0]]
        centres, outward = corners.mean(axis=1), _unit(area_vectors(corners))
        nearest = np.array([np.argmin(((centres - x) ** 2).sum(axis=1)) for x in points[some]], dtype=np.int64)
        toward = np.einsum("pc,pc->p", points[some] - centres[nearest], outward[nearest])
        facing = -np.einsum("pc,pc->p", normals[some], outward[nearest])
        touch = self.surface.cell_height  # so near to it, only the normals decide
        behind = (facing < -DECISIVE) & (toward < touch)
        before = (facing > DECISIVE) & (toward > -touch)
        behind, before = comm.allreduce(np.array([behind.sum(), before.sum()]))
        return behind / max(behind + before, 1)


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)

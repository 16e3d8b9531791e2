"""Contact of a slave surface with a meshed rigid tool: the contact of two bodies, whose master has a travel for dofs."""

import numpy as np

from fenics_contact.contact.deformable import DeformableContact
from fenics_contact.contact.master import ToolSurface, area_vectors

# A slave point and the facet nearest to it say on which side of the tool the body is if their normals are this parallel.
DECISIVE = 0.5
SAMPLES = 300  # slave points of a rank that are asked for it


class MeshedToolContact(DeformableContact):
    """DeformableContact whose master's forces, rows and columns are summed to those of the tool's travel."""

    def __init__(self, name, surface, facets, tool, index, friction, normal_penalty, tangential_penalty, space):
        master = ToolSurface(tool, index)
        super().__init__(name, tool.name, surface, facets, master, friction, normal_penalty, tangential_penalty, space)
        self.edge = f"meshed, {len(tool.nodes)} facets"

    def add_tangent(self, state, matrix, border):
        _, _, tangent, nodes = self.evaluate(state, True)
        if not len(nodes):
            return
        k = nodes.shape[1] - 8
        local = self._local[nodes[:, :k]].astype(np.int32)
        matrix.setValuesBlockedLocalRCV(local, local, np.ascontiguousarray(tangent[:, : 3 * k, : 3 * k]), addv=True)
        if border is None:
            return
        # (n, node, axis, node, axis); anchors have no rows, for T acts at the projection, but they travel with the tool
        blocks = tangent.reshape(len(nodes), k + 8, 3, k + 8, 3)
        mine = slice(3 * self.master.index, 3 * self.master.index + 3)
        columns, rows = (np.zeros((len(border.columns[0]) // 3, 3, 3)) for _ in range(2))
        np.add.at(columns, local, blocks[:, :k, :, k:].sum(axis=3))
        np.add.at(rows, local, blocks[:, k : k + 4, :, :k].sum(axis=1).transpose(0, 2, 1, 3))
        border.columns[mine] += columns.transpose(2, 0, 1).reshape(3, -1)
        border.rows[mine] += rows.transpose(1, 0, 2).reshape(3, -1)
        border.corner[mine, mine] += blocks[:, k : k + 4, :, k:].sum(axis=(0, 1, 3))

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

"""Which facet speaks for a foot near an edge, where what each facet has of its own would jump from solve to solve."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.contact.friction import Friction
from fenics_contact.contact.master import MasterSurface, ToolSurface
from fenics_contact.kernels.closest_point import Projection
from fenics_contact.kernels.facets import MAX_NODES
from fenics_contact.types import Array, Floats, Ints64
from fenics_contact.values import SceneError

NEAR = 1e-3  # of the facets' coordinates: feet nearer to an edge have one facet for both sides
SIDES = {3: ((0, 1), (1, 2), (2, 0)), 4: ((0, 1), (1, 2), (2, 3), (3, 0))}


class Directions:
    """The directions of friction that a master's facets carry along.

    friction: with one at the start, see `MasterSurface.directed`; parts (nf, m): of the facets' nodes in vectors of their
    directions, (0, m) of a tool, which has one for all. SceneError where the direction is normal to all facets.
    """

    def __init__(self, master: MasterSurface | ToolSurface, friction: Friction) -> None:
        nodes, size = master.facets
        self.friction, self.parts = friction, master.directed(friction.along)
        if len(self.parts) and not self.parts.any():
            way = "({:g}, {:g}, {:g})".format(*friction.along)
            raise SceneError(f"friction: along={way} is normal to the whole master, on which it says no direction")
        straight = len(self.parts) and nodes.shape[1] == MAX_NODES
        self._joints = Joints(nodes, size, master.X, friction.along) if straight else None

    def leading(self, projection: Projection) -> Ints64:
        """The facets (np,) whose directions hold at feet: those met, but for feet on an edge."""
        return projection[0] if self._joints is None else self._joints.speaking(projection[0], projection[3])


class Joints:
    """Of the facets that meet in an edge, or in a node, the one that comes first in an order of its own.

    nodes (nf, 4), size (nf,): of facets with three or four corners; X (nx, 3): places of the nodes; way (3,): direction of
    friction. The order goes by the facets' places along the direction and across it: it is the same on all ranks, and
    turns with the scene.
    """

    def __init__(self, nodes: Array, size: Array, X: Floats, way: Sequence[float]) -> None:
        self._size = size
        order = self._order(nodes, size, X, np.asarray(way))
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        at_node = np.full(len(X), len(order), dtype=np.int64)
        self._across = np.empty((len(nodes), 4), dtype=np.int64)
        ends, of = [], []
        for corners, sides in SIDES.items():
            mine = np.flatnonzero(size == corners)
            for side, (a, b) in enumerate(sides):
                np.minimum.at(at_node, nodes[mine, a], rank[mine])
                ends.append(np.sort(nodes[mine][:, [a, b]], axis=1))
                of.append(np.column_stack([mine, np.full(len(mine), side)]))
        edges, facets = np.concatenate(ends), np.concatenate(of)
        _, number = np.unique(edges, axis=0, return_inverse=True)
        first = np.full(number.max(initial=-1) + 1, len(order), dtype=np.int64)
        np.minimum.at(first, number, rank[facets[:, 0]])
        self._across[facets[:, 0], facets[:, 1]] = order[first[number]]
        self._around = order[np.minimum(at_node[nodes], len(order) - 1)]

    @staticmethod
    def _order(nodes: Array, size: Array, X: Floats, way: Floats) -> Ints64:
        """Facets by their places: (nf,) their numbers."""
        last = np.where(size == 3, nodes[:, 0], nodes[:, 3])
        middle = (X[nodes[:, 0]] + X[nodes[:, 1]] + X[nodes[:, 2]] + np.where((size == 4)[:, None], X[last], 0.0)) / size[
            :, None
        ]
        normal = np.cross(X[nodes[:, 1]] - X[nodes[:, 0]], X[nodes[:, 2]] - X[nodes[:, 0]]).sum(axis=0)
        normal = normal / max(np.linalg.norm(normal), 1e-300)
        return np.argsort((middle - X.mean(axis=0)) @ (way + np.sqrt(2.0) * np.cross(normal, way) + np.pi * normal))

    def speaking(self, facet: Ints64, xi: Floats) -> Ints64:
        """The facet (np,) that speaks for feet (np,) at xi (np, 2) on theirs, -1 without one."""
        s, t, three = xi[:, 0], xi[:, 1], self._size[facet] == 3
        low = np.where(three, 0.0, -1.0) + NEAR
        near = np.column_stack([
            t < low,
            np.where(three, s + t, s) > 1.0 - NEAR,
            np.where(three, s < low, t > 1.0 - NEAR),
            ~three & (s < low),
        ])  # fmt: skip
        out = facet.copy()
        for side in range(4):
            alone = near[:, side] & (near.sum(axis=1) == 1)
            out[alone] = self._across[facet[alone], side]
        for corner in range(4):  # between the side before it and its own
            before = np.where(three, (corner - 1) % 3, (corner - 1) % 4)
            both = near[np.arange(len(near)), before] & near[:, corner] & (facet >= 0)
            out[both] = self._around[facet[both], corner]
        return np.where(facet >= 0, out, facet)

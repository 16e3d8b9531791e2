"""Nodes tied to rigid bodies: their dofs follow a body's pose, and what holds them there acts on the body."""

from collections.abc import Iterator, Sequence

import numpy as np

from fenics_contact.assembly.border import Border
from fenics_contact.assembly.pose import Pose, Poses, skew
from fenics_contact.types import Bools, Floats, Ints64, Mat


class Ties:
    """Groups of nodes that move as parts of rigid bodies: u = pose(X) - X.

    tied: (body, nodes, X) of each: a row of the bodies' coordinates q (bodies, 6), local nodes (n,), ghosts included, and
    their reference positions (n, 3) [length]; owned: number of this rank's own nodes. The dofs are supports, whose values
    come from q; du, forces are local arrays. With B the nodes' motions per coordinate, of nodes s and others f, the body's
    unknowns see K_fs B, B^T K_sf, B^T K_ss B and the rate of B^T r_s with B.
    """

    def __init__(self, tied: Sequence[tuple[int, Ints64, Floats]] = (), owned: int = 0) -> None:
        self._tied, self._owned = tied, owned

    def __bool__(self) -> bool:
        return bool(self._tied)

    def of(self, body: int) -> Ints64:
        """Local nodes (n,) that follow one body."""
        return np.concatenate([nodes for one, nodes, _ in self._tied if one == body] or [np.empty(0, dtype=np.int64)])

    @property
    def nodes(self) -> Ints64:
        """All local nodes (n,) that follow."""
        return np.concatenate([nodes for _, nodes, _ in self._tied] or [np.empty(0, dtype=np.int64)])

    def off(self, nodes: Ints64, direction: Floats, values: Floats, poses: Poses, q: Floats) -> Floats:
        """How far from displacements `values` (n,) along a unit direction those of these nodes (n,) are that bodies carry
        whose coordinates are q (bodies, 6): (bodies,) [length], zero of bodies that carry none."""
        found = np.zeros(len(q))
        for body, tied, X in self._tied:
            _, here, at = np.intersect1d(nodes, tied, return_indices=True)
            way = (poses.at(body, q[body]).placed(X[at]) - X[at]) @ direction
            found[body] = np.abs(way - values[here]).max(initial=0.0)
        return found

    @property
    def dofs(self) -> Ints64:
        """All dofs (n,) that follow."""
        return np.concatenate([_dofs(nodes) for _, nodes, _ in self._tied] or [np.empty(0, dtype=np.int64)])

    def place(self, poses: Poses, q: Floats, u: Floats) -> None:
        """Put the nodes of a displacement where the bodies carry them."""
        for body, nodes, X in self._tied:
            u.reshape(-1, 3)[nodes] = poses.at(body, q[body]).placed(X) - X

    def follow(self, poses: Poses, q: Floats, dq: Floats, du: Floats) -> None:
        """Add to du the nodes' motion when the bodies move by dq (bodies, 6), to first order."""
        for (body, nodes, _), pose, motions in self._moving(poses, q):
            du.reshape(-1, 3)[nodes] += pose.by_coordinates(motions) @ dq[body]

    def add_wrenches(self, poses: Poses, q: Floats, forces: Floats, wrenches: Floats) -> None:
        """Add what forces on the nodes do to the bodies to wrenches (bodies, 6): this rank's part."""
        for body, nodes, X in self._tied:
            mine, pose = nodes < self._owned, poses.at(body, q[body])
            wrenches[body] += pose.wrench(pose.placed(X[mine]), forces.reshape(-1, 3)[nodes[mine]])

    def extend(self, border: Border, matrix: Mat, poses: Poses, q: Floats, free: Bools, forces: Floats) -> None:
        """Let the border's parts of free components (bodies, 6) carry the nodes along: this rank's part of it.

        matrix: supports not eliminated; forces: on the nodes, whose wrenches turn with them. Collective.
        """
        bodies = sorted({body for body, _, _ in self._tied})
        moving = [6 * body + c for body in bodies for c in np.flatnonzero(free[body])]
        ahead, pull = (np.zeros((border.columns.shape[0], border.columns.shape[1])) for _ in range(2))
        for (body, nodes, _), pose, motions in self._moving(poses, q):
            mine, dofs = slice(6 * body, 6 * body + 6), _dofs(nodes)
            ahead[mine, dofs] += pose.by_coordinates(motions).reshape(-1, 6).T
            pull[mine, dofs] += motions.reshape(-1, 6).T / np.repeat([1.0, pose.lever], 3)[:, None]
            border.add(self._turned(pose, nodes, forces, motions), mine, mine)
        border.add(border.rows @ ahead[moving].T, columns=moving)
        border.add(pull[moving] @ border.columns.T, moving)
        way, force = matrix.createVecs()
        owned = way.getLocalSize()
        for c in moving:
            way.array[:] = ahead[c, :owned]
            matrix.mult(way, force)
            border.add_column(c, force.array_r)
            border.add(pull[moving, :owned] @ force.array_r, moving, c)
            force.array[:] = pull[c, :owned]
            matrix.multTranspose(force, way)
            border.add_row(c, way.array_r)

    def _turned(self, pose: Pose, nodes: Ints64, forces: Floats, motions: Floats) -> Floats:
        """Rate (6, 6) of the wrench of forces that stay as they are while their places turn."""
        mine, rate = nodes < self._owned, np.zeros((6, 6))
        turned = skew(forces.reshape(-1, 3)[nodes[mine]])
        rate[3:, 3:] = -np.einsum("nab,nbc->ac", turned, motions[mine][..., 3:]) / pose.lever
        return pose.by_coordinates(rate)

    def _moving(self, poses: Poses, q: Floats) -> Iterator[tuple[tuple[int, Ints64, Floats], Pose, Floats]]:
        """Each tie with the pose of its body and the nodes' motions (n, 3, 6) with travel and spin."""
        for body, nodes, X in self._tied:
            pose = poses.at(body, q[body])
            yield (body, nodes, X), pose, pose.motions(pose.placed(X))


def _dofs(nodes: Ints64) -> Ints64:
    return (3 * nodes[:, None] + np.arange(3)).ravel()

"""Nodes of paired faces: where one goes, the other one goes too, turned or farther on by a given way."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.assembly.change import Change, node_rows
from fenics_contact.assembly.exchange import lasting
from fenics_contact.kernels.sets import join
from fenics_contact.types import Floats, Ints64, Space


@dataclass(frozen=True)
class Follower:
    """How nodes follow leading ones, u = turn u_lead + ahead . g: turn (n, 3, 3); ahead (n, 3, pairs, 3), of the ways g
    (pairs, 3) [length] of the pairs."""

    turn: Floats
    ahead: Floats

    def offset(self, ways: Floats) -> Floats:
        """ahead . g (n, 3) [length]."""
        return np.einsum("ncpd,pd->nc", self.ahead, ways)

    def of(self, rows: Ints64) -> "Follower":
        """Of some of the nodes."""
        return Follower(self.turn[rows], self.ahead[rows])


ALIKE = 1e-6  # what two images may differ by, turns or over their offset, that are one


class Image(NamedTuple):
    """Where pairs of faces put a neighbour of what lies at x: turn x + offset, (3, 3) and (3,) [length]."""

    turn: Floats
    offset: Floats

    def of(self, x: Floats) -> Floats:
        """Of places (..., 3) [length]."""
        return x @ self.turn.T + self.offset

    def then(self, other: "Image") -> "Image":
        """One after the other."""
        return Image(other.turn @ self.turn, other.of(self.offset))

    def like(self, other: "Image") -> bool:
        """Whether both put places of this size alike, but for rounding."""
        differ = np.abs(self.turn - other.turn).max(), np.abs(self.offset - other.offset).max()
        return differ[0] < ALIKE and bool(differ[1] <= ALIKE * np.abs(self.offset).max())

    @property
    def back(self) -> "Image":
        return Image(self.turn.T, -self.turn.T @ self.offset)


HERE = Image(np.eye(3), np.zeros(3))


class Pairs:
    """The nodes of this rank that follow others, which may be other ranks'; relative displacements u - turn u_lead are what
    supports prescribe there.

    nodes (n,): local numbers, ghosts included, rising; leads (n,): global numbers of the nodes that lead them, which follow
    none; follower: Follower; ways: t -> (pairs, 3) [length], called on all ranks; across: of each pair the Image that puts
    its first face on the second at rest. All is collective.
    """

    def __init__(
        self,
        space: Space,
        nodes: tuple[Ints64, Ints64],
        follower: Follower,
        ways: Callable[[float], Floats],
        across: Sequence[Image],
    ) -> None:
        """nodes: those that follow, and those that lead them."""
        (self.nodes, self._leads), self.follower, self.ways, self._across = nodes, follower, ways, across
        index_map, self._comm = space.dofmap.index_map, lasting(space.mesh.comm)
        self._owned = int(np.searchsorted(self.nodes, index_map.size_local))
        size = 3 * index_map.size_local, 3 * index_map.size_global
        led = np.unique(np.concatenate(self._comm.allgather(self._leads)))
        self.on_faces = np.isin(compat.global_blocks(space), led)  # of all local nodes, those of either face
        self.on_faces[self.nodes] = True
        self._vector = PETSc.Vec().createMPI(size, comm=self._comm)
        self._met = PETSc.Vec().createSeq(3 * len(self.nodes))
        numbers = (3 * self._leads[:, None] + np.arange(3)).ravel().astype(PETSc.IntType)
        to = PETSc.IS().createGeneral(numbers, comm=PETSc.COMM_SELF)
        self._scatter = PETSc.Scatter().create(self._vector, to, self._met, None)

    @property
    def dofs(self) -> Ints64:
        return (3 * self.nodes[:, None] + np.arange(3)).ravel()

    def images(self, t: float) -> list[Image]:
        """All neighbours at t that share a face, an edge or a corner with what is modelled; of pairs that stand for the same
        step, as those of several bodies, the first one's way counts."""
        known: list[Image] = []
        once: list[Image] = []
        for one, way in zip(self._across, self.ways(t), strict=True):
            if not any(one.like(other) or one.back.like(other) for other in known):
                known.append(one)
                once.append(Image(one.turn, one.offset + way))
        found = []
        for steps in product((0, 1, -1), repeat=len(once)):
            image = HERE
            for step, one in zip(steps, once, strict=True):
                image = image.then(one if step > 0 else one.back) if step else image
            found.append(image)
        return found[1:]

    def change(self, space: Space) -> Change:
        """From relative displacements to displacements."""
        nodes, leads = self.nodes[: self._owned], self._leads[: self._owned, None]
        turn, own = self.follower.turn[: self._owned, None], np.tile(np.eye(3), (self._owned, 1, 1))
        return Change(space, *(node_rows(space, nodes, leads, sign * turn, own) for sign in (1.0, -1.0)))

    def values(self, t: float) -> Floats:
        """Relative displacements (3 n,) at t [length]."""
        return self.follower.offset(self.ways(t)).ravel()

    def led(self, array: Floats) -> Floats:
        """Vectors (n, 3) at the leading nodes of owned dofs' values."""
        self._vector.array_w[:] = array[: len(self._vector.array_r)]
        self._scatter.scatter(self._vector, self._met, addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        return self._met.array_r.reshape(-1, 3).copy()

    # -- local arrays, of owned dofs or with the ghosts behind them -----------------------------------------------
    def count(self, array: Floats) -> int:
        """How many of the nodes an array holds."""
        return int(np.searchsorted(self.nodes, len(array) // 3))

    def relative(self, u: Floats) -> Floats:
        """Of a displacement, u - turn u_lead of as many nodes (n, 3) as it holds."""
        count = self.count(u)
        return u.reshape(-1, 3)[self.nodes[:count]] - self._carried(u)[:count]

    def place(self, u: Floats, relative: Floats) -> None:
        """Put the nodes where those that lead them carry them, and these relative displacements (n, 3) further."""
        count = self.count(u)
        u.reshape(-1, 3)[self.nodes[:count]] = self._carried(u)[:count] + relative[:count]

    def _carried(self, u: Floats) -> Floats:
        return np.einsum("nab,nb->na", self.follower.turn, self.led(u))

    def fold(self, forces: Floats, sign: float = 1.0) -> None:
        """Add the forces on the nodes, turned back, times the sign to the owned leading nodes' ones."""
        met, mine = np.zeros((len(self.nodes), 3)), slice(self._owned)
        own = forces.reshape(-1, 3)[self.nodes[mine]]
        met[mine] = sign * np.einsum("nab,na->nb", self.follower.turn[mine], own)
        self._met.array_w[:] = met.ravel()
        self._vector.array_w[:] = 0.0
        self._scatter.scatter(self._met, self._vector, addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        forces[: len(self._vector.array_r)] += self._vector.array_r

    def joined(self, part: Ints64, count: int) -> tuple[Ints64, int]:
        """Parts (all local nodes,) of `count` ones with those as one that a pair joins."""
        lead = self.led(np.repeat(part, 3).astype(float))[:, 0].astype(np.int64)
        joins = np.unique(np.column_stack([part[self.nodes], lead]), axis=0)
        root = np.arange(count)
        join(np.concatenate(self._comm.allgather(joins)), root)
        known, number = np.unique(root, return_inverse=True)
        return number[part], len(known)

    def on_ways(self, forces: Floats) -> Floats:
        """What forces (n, 3) on the nodes do on the ways (pairs, 3): the owned nodes' part."""
        mine = slice(self._owned)
        return np.einsum("nc,ncpd->pd", forces[mine], self.follower.ahead[mine])

    def spanned(self, nodes: Ints64) -> Floats:
        """Sum (3, 3) of d d^T over the directions d along which the turns hold these nodes, being no translations."""
        differ = self.follower.turn[np.isin(self.nodes, nodes)] - np.eye(3)
        size = np.linalg.norm(differ, axis=(1, 2))
        differ = differ[size > 1e-9] / size[size > 1e-9, None, None]
        return np.einsum("nca,ncb->ab", differ, differ)

"""What holds each body: its supports along some axes, contacts along the others, and nothing where these have opened."""

from collections.abc import Callable, Sequence

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.supports import Supports
from fenics_contact.types import Bools, Floats, Ints, Ints64

AXES = "xyz"
SPANS = 1e-9  # of the most that supports hold: less is rounding
ALLOWED = 1e-7  # of the largest force: a contact that presses less holds nothing, a spring that pulls less has let go


class Holds:
    """Bodies, what their supports hold, and the contacts between them and with tools.

    bodies: (name, local nodes) of each group of bonded bodies; supports: Supports; contacts: terms that say whether they are
    `grounded`, held by no body, and which nodes they touch; grounds: (local nodes, sum (3, 3) of d d^T over the directions)
    of what else holds them, as springs to the ground. Construction is collective.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        bodies: list[tuple[str, Ints64]],
        supports: Supports,
        contacts: Sequence[ContactTerm],
        grounds: Sequence[tuple[Ints, Floats]] = (),
    ) -> None:
        self.bodies, self.supports, self.contacts, self._grounds = bodies, supports, contacts, grounds
        self._comm = comm
        self._supported: list[set[str]] = []  # letters of the axes along which supports and grounds hold each body
        self.everywhere: list[Floats] = []  # the same sum (3, 3) of the grounds that hold all nodes of each body
        self._ties: list[tuple[ContactTerm, Ints64]] = []  # contacts, and the numbers of the bodies that each touches
        for _, blocks in bodies:
            spanned, everywhere = supports.spanned(blocks), np.zeros((3, 3))
            for nodes, directions in grounds:
                held = np.isin(blocks, nodes)
                spanned = spanned + held.sum() * directions
                everywhere += directions * comm.allreduce(bool(held.all()), op=MPI.LAND)
            self.everywhere.append(everywhere)
            self._supported.append(_letters(comm.allreduce(spanned)))
        for contact in contacts:
            met = comm.allreduce(np.array([np.isin(contact.partner.nodes, blocks).sum() for _, blocks in bodies]))
            self._ties.append((contact, np.flatnonzero(met)))

    @property
    def reliant(self) -> list[int]:
        """Numbers of the bodies that supports alone do not hold along all axes."""
        return [i for i, axes in enumerate(self._supported) if len(axes) < len(AXES)]

    def free(self, body: int) -> Bools:
        """Along which axes (3,) supports alone do not hold a body of this number."""
        return np.array([axis not in self._supported[body] for axis in AXES])

    def contacts_of(self, body: int) -> list[ContactTerm]:
        """Contacts of a body of this number."""
        return [contact for contact, met in self._ties if body in met]

    def loose(self, axes_of: Callable[[ContactTerm], set[str]]) -> dict[int, str]:
        """{number of a body: letters of the axes along which nothing holds it}, where there are such.

        axes_of(contact) -> letters of the axes along which it holds. A contact of two bodies holds one of them only as far
        as the other is held itself.
        """
        held = [set(axes) for axes in self._supported]
        axes = [axes_of(contact) for contact, _ in self._ties]
        for _ in self.bodies:  # a chain is no longer than the bodies are many
            for (contact, met), along in zip(self._ties, axes, strict=True):
                for i in met:
                    others = (held[j] for j in met if j != i)
                    held[i] |= along if contact.partner.grounded else along & set().union(*others)
        return {i: "".join(sorted(set(AXES) - axes)) for i, axes in enumerate(held) if len(axes) < len(AXES)}

    def turning(self, axis: Floats, point: Floats, X: Floats) -> list[int]:
        """Numbers of the bodies without a contact that neither supports nor grounds keep from turning about the unit axis
        (3,) through a point (3,). X (n, 3): the nodes' positions. Collective."""
        found = []
        for i, (_, blocks) in enumerate(self.bodies):
            if self.contacts_of(i):
                continue
            way = np.cross(axis, X[blocks] - point)
            along = np.einsum("nki,ni->nk", self.supports.free(blocks), way)
            stopped = (way**2).sum() - (along**2).sum()
            for nodes, directions in self._grounds:
                on = way[np.isin(blocks, nodes)]
                stopped += np.sum(on @ directions * on)
            stopped, all_ways = self._comm.allreduce(np.array([stopped, (way**2).sum()]))
            if stopped <= SPANS * all_ways:
                found.append(i)
        return found


def _letters(spanned: Floats) -> set[str]:
    """As many axes as the directions span of which this is the sum of d d^T, such that the other axes hold the rest."""
    size, vectors = np.linalg.eigh(spanned)
    basis, letters = vectors[:, size > SPANS * max(size.max(), 1.0)], set()
    for _ in range(basis.shape[1]):
        axis = int(np.linalg.norm(basis, axis=1).argmax())
        letters.add(AXES[axis])
        row = basis[axis] / np.linalg.norm(basis[axis])
        basis = basis - np.outer(basis @ row, row)
    return letters

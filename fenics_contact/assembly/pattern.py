"""A matrix with the pattern of the bodies' cells and the couplings of contact pairs, preallocated exactly."""

import numpy as np
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.assembly.exchange import lasting
from fenics_contact.assembly.term import FormTerm, State, Term
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Form, Ints64, Mat, Space


class MatrixPattern:
    """Block pattern of a bilinear form, to which couplings between any two nodes can be added. Built once per mesh."""

    def __init__(self, form: Form, space: Space) -> None:
        self.comm, self._map = lasting(space.mesh.comm), space.dofmap.index_map
        offsets, columns = compat.block_pattern(form, space)
        first, end = self._map.local_range
        self._keys = np.repeat(np.arange(first, end), np.diff(offsets)) * self._map.size_global + columns
        self._blocks = compat.global_blocks(space)

    def matrix(self, keys: Ints64) -> Mat:
        """New matrix of zeros in all its places: assembled. Collective.

        keys (n,): row * N + column of global block numbers, N their total; rows may belong to any rank.
        """
        first, end = self._map.local_range
        total = self._map.size_global
        keys = self._sent_to_owners(keys)
        places = np.searchsorted(self._keys, keys)
        new = np.take(np.append(self._keys, -1), places) != keys
        rows, columns = np.divmod(np.insert(self._keys, places[new], keys[new]), total)
        offsets = np.searchsorted(rows, np.arange(first, end + 1))
        csr = offsets.astype(PETSc.IntType), columns.astype(PETSc.IntType)
        size = (3 * (end - first), 3 * total)
        # blocks of three: a cell's matrix goes in eight times as fast as by scalars (docs/speed.md)
        matrix = PETSc.Mat().createBAIJ((size, size), 3, csr=csr, comm=self.comm)
        local = PETSc.LGMap().create(self._blocks.astype(PETSc.IntType), bsize=3, comm=self.comm)
        matrix.setLGMap(local, local)
        return matrix

    def _sent_to_owners(self, keys: Ints64) -> Ints64:
        """Unique keys of this rank's rows, from all ranks."""
        starts = np.array(self.comm.allgather(self._map.local_range[0])) * self._map.size_global
        keys = np.unique(keys)
        parts = np.split(keys, np.searchsorted(keys, starts[1:]))
        return np.unique(np.concatenate(self.comm.alltoall(parts)))


class Couplings:
    """The keys that each term has asked for last, see `Term.couplings`, and matrices with the pattern of them all.

    terms: the first one is the solid, whose cells couple the dofs of the space; symmetric: is their tangent so. patterns:
    number of matrices made so far.
    """

    def __init__(self, terms: tuple[FormTerm, *tuple[Term, ...]], space: Space, symmetric: bool) -> None:
        self._terms, self._comm, self._symmetric = terms, lasting(space.mesh.comm), symmetric
        self._pattern = MatrixPattern(terms[0].tangent_form, space)
        self._keys: list[Ints64] = [np.empty(0, dtype=np.int64)] * len(terms)
        self.patterns = 0

    def matrix(self) -> Mat:
        """New matrix of zeros for the couplings known so far. Collective."""
        matrix = self._pattern.matrix(np.concatenate(self._keys))
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
        if self._symmetric:
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.patterns += 1
        return matrix

    def suited(self, matrix: Mat, state: State, trials: Trials | None = None) -> Mat:
        """The matrix as it is, or a new one where a term, on any rank, asks for others at this state, with these trials.
        Collective."""
        changed = False
        for i, term in enumerate(self._terms):
            keys = term.couplings(state, trials)
            if keys is not None:
                self._keys[i], changed = keys, True
        return self.matrix() if self._comm.allreduce(int(changed)) else matrix

"""What terms couple on top of the bodies' own cells, and the matrices that have room for it."""

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.exchange import lasting
from fenics_contact.assembly.pattern import MatrixPattern
from fenics_contact.assembly.term import FormTerm, State, Term
from fenics_contact.types import Ints64, Mat, Space


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
        """New matrix for the couplings known so far, not yet assembled. Collective."""
        matrix = self._pattern.matrix(np.concatenate(self._keys))
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
        if self._symmetric:
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.patterns += 1
        return matrix

    def cleared(self, matrix: Mat, state: State) -> Mat:
        """The matrix with zeros in it, or a new one where a term, on any rank, asks for others at this state. Collective."""
        changed = False
        for i, term in enumerate(self._terms):
            keys = term.couplings(state)
            if keys is not None:
                self._keys[i], changed = keys, True
        if self._comm.allreduce(int(changed)):
            return self.matrix()
        if matrix.assembled:
            matrix.zeroEntries()
        return matrix

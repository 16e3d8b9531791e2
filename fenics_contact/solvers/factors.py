"""Factorisations: MUMPS', or PETSc's own of matrices so small that MUMPS' calls take longer than its arithmetic."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

# MUMPS' INFOG(1) where the workspace foreseen is too small: pivots are delayed, and ranks' messages arrive as they may
SHORT_OF_SPACE = (-8, -9)
WORKSPACE = (20, 100, 500)  # per cent more than foreseen, one after another; the first is MUMPS' own
# MUMPS' scaling of rows and columns is a sixth of a factorisation in the plane. Without it residuals are the same, 1e-12 to
# 1e-16 with mixed elements of K/mu = 500 and 1515, penalties of 1e4 E/h, multipliers, bodies 1e4 times as stiff as others
UNSCALED = {"mat_mumps_icntl_8": 0}
# MUMPS' ordering in the plane, minimum degree: with 6 000 ... 110 000 unknowns of either degree factors are as large, -4 ...
# +6 %, and as fast as by its own choice, and an analysis, due whenever contact couples other nodes, takes a third of the
# time. In space they are 7 % larger and take 16 % longer
ORDERING, MINIMUM_DEGREE = "mat_mumps_icntl_7", 0
# Entries of a matrix up to which PETSc's own factorisation serves, on one process. In the plane with 1 000, 2 000 and 3 100
# unknowns it takes 0.1 ... 0.9 of MUMPS' time, a solve with it 0.07 ... 0.4; of 1.4e5 entries and more in space, both longer
PLAIN = 100_000
# Iterations that count for a factorisation.
# PETSc's own: at 3 ... 7 runs are the fastest, 15 costs a third more.
# MUMPS': a base, and more for each operation per entry of the factors, which a solve reads once: 3.4 and 4.5 iterations in
# the plane with 2e3 and 5e3 unknowns, 12 in space with 3e3. With the 31 that it is of 3.5e4 in space, solves that lost their
# way go on for too long: there it counts as DEAREST.
PLAIN_COST, AT_LEAST, PER_OPERATION, DEAREST = 5.0, 2.5, 0.03, 15.0
OWN = "pc_type", "pc_factor_mat_solver_type", "pc_factor_mat_ordering_type"  # options by which a user chooses


class Factors:
    """The factorisation of a PC: it is set up within `chosen`; the rest is what it tells then.

    prefix: of PETSc's options, by which users may choose; plane: whether cells that couple the rows lie in a plane. PETSc's
    own does not exchange rows for larger pivots: where it fails, or a solve shows that a pivot was too small, `fall_back`
    has MUMPS take over for good.
    """

    def __init__(self, comm: MPI.Comm, prefix: str, symmetric: bool, plane: bool) -> None:
        self._prefix, self._symmetric, self._plane = prefix, symmetric, plane
        options = PETSc.Options()
        self._may_be_plain = comm.size == 1 and not any(options.hasName(prefix + name) for name in OWN)
        self._space = 0
        self.plain: bool | None = None  # whether it is PETSc's own; None before the first choice
        self._pc: Any = None

    def attach(self, pc: Any) -> None:
        """Factorise with this PC from now on, which has done nothing yet."""
        self._pc, self.plain = pc, None

    @contextmanager
    def chosen(self, entries: int) -> Iterator[None]:
        """Within it a matrix of so many entries is factorised.

        PETSc hands MUMPS over to a new object whenever the pattern has changed, which knows what options say at that time.
        """
        plain = self._may_be_plain and entries <= PLAIN
        if plain != self.plain:
            self._set_up_for(plain)
        own = {"mat_mumps_icntl_14": WORKSPACE[self._space]} | ({ORDERING: MINIMUM_DEGREE} if self._plane else {})
        options = PETSc.Options()
        ours = [self._prefix + key for key in own if not options.hasName(self._prefix + key)]
        unless_given(self._prefix, own)
        try:
            yield
        finally:
            for key in ours:
                options.delValue(key)

    def _set_up_for(self, plain: bool) -> None:
        self.plain = plain
        self._pc.setType("none")  # forgets another factorisation, but not the matrix
        self._pc.setType("lu" if plain or not self._symmetric else "cholesky")
        self._pc.setFactorSolverType("petsc" if plain else "mumps")
        if plain:
            self._pc.setFactorOrdering("amd")
        else:
            unless_given(self._prefix, UNSCALED)
            if not self._symmetric:
                PETSc.Options()[self._prefix + "mat_mumps_icntl_33"] = 1  # the determinant
        self._pc.setFromOptions()

    def _by_mumps(self) -> bool:
        """Whether MUMPS factorises: PETSc's options can ask for another solver."""
        kind = self._pc.getType(), self._pc.getFactorSolverType()
        return kind == ("cholesky" if self._symmetric else "lu", "mumps")

    def fall_back(self) -> bool:
        """After a failure: whether another try with a new PC may succeed, by MUMPS in place of PETSc's own, or with more
        workspace."""
        if self.plain:
            self._may_be_plain = False
            return True
        if self._space + 1 < len(WORKSPACE) and self.code() in SHORT_OF_SPACE:
            self._space += 1
            return True
        return False

    def code(self) -> int:
        """MUMPS' INFOG(1), 0 where it has none."""
        return int(self._pc.getFactorMatrix().getMumpsInfog(1)) if self._by_mumps() else 0

    def cost(self) -> float:
        """Iterations that count for the factorisation at hand."""
        if not self._by_mumps():
            return PLAIN_COST if self.plain else DEAREST
        factors = self._pc.getFactorMatrix()
        entries = factors.getMumpsInfog(29)
        return factorisation_cost(factors.getMumpsRinfog(3), entries) if entries else DEAREST

    def negative(self) -> int | None:
        """Of the factorisation at hand the negative pivots where the matrix is symmetric, else whether they are odd, 1, or
        even, 0; None: not known."""
        factors = self._pc.getFactorMatrix()
        if self.plain:  # rows and columns in the same order, without exchanges: the pivots have the signs of the eigenvalues
            negative = int(np.count_nonzero(factors.getDiagonal().array_r < 0.0))
            return negative if self._symmetric else negative % 2
        if not self._by_mumps():
            return None
        return int(factors.getMumpsInfog(12)) if self._symmetric else int(factors.getMumpsRinfog(12) < 0.0)


def factorisation_cost(operations: float, entries: int) -> float:
    """Iterations that count for a factorisation of so many operations. entries: of its factors, below zero in millions, as
    MUMPS tells them."""
    per_entry = operations / (entries if entries > 0 else -1e6 * entries)
    return min(AT_LEAST + PER_OPERATION * per_entry, DEAREST)


def unless_given(prefix: str, settings: Mapping[str, Any]) -> None:
    """PETSc options that a user's own, with the same prefix, override."""
    options = PETSc.Options()
    for key, value in settings.items():
        if not options.hasName(prefix + key):
            options[prefix + key] = value

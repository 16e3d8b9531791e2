"""PETSc solver for a sequence of similar matrices: an old factorisation or hierarchy preconditions while it pays."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.block_operator import BlockOperator, raise_stopped
from fenics_contact.assembly.gauss_seidel import GaussSeidel
from fenics_contact.solvers.choice import Choice
from fenics_contact.solvers.factors import Factors, unless_given
from fenics_contact.solvers.free_rows import FreeRows, Rows
from fenics_contact.solvers.multigrid import hierarchy_of, multigrid
from fenics_contact.solvers.softest import Softest
from fenics_contact.timing import Timers
from fenics_contact.types import Mat, Solver, Vec

PREFIX = "fc_"  # every choice below can be overridden by PETSc options with this prefix
TIGHTEST = 1e-8  # relative residual of an iterative solve where nothing looser will do
NOT_FINITE = 72  # PETSC_ERR_FP, PETSc's code of a floating-point exception
HIERARCHY_COST = 35.0  # iterations that cost as much as a new hierarchy, measured at 8e3 and 6e4 unknowns
# A row whose diagonal has grown or shrunk by this factor is one that an old preconditioner no longer knows: a contact that
# closed, opened, stuck or slipped. Each costs Krylov's method about an iteration.
CHANGED = 2.0
# Below this many unknowns a factorisation costs no more than the handful of iterations it would save.
REUSE_ABOVE = 3_000
AGGREGATION = {
    # No coupling is too weak to aggregate along: without the weakest, those across stretched cells, aggregates on graded
    # meshes are so small that coarse matrices become dense, and setting up takes minutes
    "pc_gamg_threshold": 0.0,
    "pc_gamg_aggressive_coarsening": 1,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
}
LONGEST = 400  # iterations of a solve with a new preconditioner
# PETSc's reasons where a symmetric tangent, or the cycle made of it, does not resist every motion, as on Newton's way at a
# kink: conjugate gradients end there, and GMRES takes an iteration or two more for each such motion
INDEFINITE = (PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT, PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_PC)


def digits_of(tolerance: float) -> float:
    """Digits of accuracy of a solve to a relative residual."""
    return float(max(-np.log10(tolerance), 1.0))


class Reuse:
    """Says when a new preconditioner pays: once a solve cost more per digit than all since the last, that one included."""

    def __init__(self, build_cost: float) -> None:
        self.build_cost = build_cost
        self.built()

    def built(self) -> None:
        self.stale, self._digits = False, 0.0
        self._work: float = self.build_cost
        self._fresh: float | None = None

    def solved(self, iterations: int, tolerance: float) -> None:
        """Count a solve to a relative residual."""
        digits = digits_of(tolerance)
        rate = iterations / digits
        self._fresh = rate if self._fresh is None else self._fresh
        self._work, self._digits = self._work + iterations, self._digits + digits
        self.stale = self.stale or rate > self._work / self._digits

    def limit(self, tolerance: float) -> int:
        """Iterations after which an old preconditioner is given up in the middle of a solve."""
        return int(np.ceil(self.build_cost - 2.0 * np.log10(tolerance) * (self._fresh or 0.0)))


class ReusingSolver:
    """Solves with a matrix that changes little from one solve to the next.

    method: "direct" (see Factors) or "iterative" (CG or GMRES with smoothed aggregation), or
    the Choice that is asked for the method of each new preconditioner;
    near_null_space: function of the matrix to PETSc's NullSpace, for the latter. The matrix is one of blocks; what is
    factorised or coarsened is a copy by scalars, made when it is due; multigrid's finest level smooths with the matrix
    itself, which may have changed since. builds, iterations: counts of factorisations (or hierarchies) and of Krylov
    iterations so far; longest: most iterations of a solve with a new preconditioner; afresh: reuse nothing.
    """

    def __init__(
        self,
        rows: Rows,
        symmetric: bool,
        method: str | Choice,
        near_null_space: Callable[[Mat], Any] | None,
        timers: Timers,
        afresh: bool = False,
    ) -> None:
        self.comm, self.symmetric, self.timers = rows.comm, symmetric, timers
        self.choice = method if isinstance(method, Choice) else None
        self._all, self._near_null_space, size = rows, near_null_space, rows.size
        self.builds = self.iterations = 0
        self.mumps_code = 0  # INFOG(1) of the solve that failed last, 0 where there is none
        self.anew = size <= REUSE_ABOVE or afresh  # for each tangent
        self.longest = LONGEST
        self._copy: Mat = None  # what is coarsened
        self._rows: FreeRows | None = None  # what is factorised, and by what
        self._factors = Factors(rows.comm, PREFIX, symmetric, rows.plane)
        self._blocks: BlockOperator | None = None  # multigrid's matrix by our own products, and its smoother
        self._relaxation: GaussSeidel | None = None
        self._pattern: int | None = None
        self._reuse: Reuse | None = None
        self._objects: tuple[Any, ...] = ()
        self.use(method.first if isinstance(method, Choice) else method)

    @property
    def plain(self) -> bool:
        """Whether PETSc's own factorisation serves."""
        return self._rows is not None and bool(self._factors.plain)

    def use(self, method: str) -> None:
        """Change to a method; drops what is kept."""
        self.method, self._copy, self._rows, self._reuse = method, None, None, None
        self._drop()
        if method == "direct":
            self._factorised()

    def go_by(self, choice: Choice | None) -> None:
        """Ask a choice for the method of each new preconditioner, or none: that in use stays."""
        self.choice = choice

    def give_up_after(self, iterations: int) -> None:
        """At most so many in a solve with a new preconditioner."""
        self.longest = iterations

    def _drop(self) -> None:
        """Free PETSc's objects at once, for Python alone never frees what several ranks share."""
        for thing in self._objects:
            thing.destroy()
        self._objects, self._blocks, self._relaxation = (), None, None
        PETSc.garbage_cleanup(self.comm)

    def _ksp(self, pc: Any, kind: str) -> Solver:
        ksp = PETSc.KSP().create(self.comm)
        ksp.setOptionsPrefix(PREFIX)
        ksp.setPC(pc)
        ksp.setType(kind)
        # PETSc would measure the preconditioned residual, in which an old preconditioner hides where it is wrong
        if kind != "preonly":
            ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        if kind in ("gmres", "fgmres"):
            # without it an ill-conditioned solve loses the basis' orthogonality, and PETSc gives up at the restart
            unless_given(PREFIX, {"ksp_gmres_cgs_refinement_type": "refine_ifneeded"})
            ksp.setGMRESRestart(100)
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setFromOptions()
        return ksp

    def _factorised(self) -> None:
        """Make what factorises."""
        self._rows = FreeRows(self._all, PREFIX)
        self._factors.attach(self._rows.inner)
        # flexible GMRES keeps what a factorisation makes of its vectors; the plain one applies it once more in the end
        self._krylov, self._fresh = (
            self._ksp(self._rows.pc, kind) for kind in ("cg" if self.symmetric else "fgmres", "preonly")
        )
        self._objects = (self._krylov, self._fresh, self._rows)

    def _coarsened(self, matrix: Mat) -> None:
        """A new hierarchy of a matrix."""
        unless_given(PREFIX, AGGREGATION)
        options = PETSc.Options()
        # a third of a set-up saved on one process; PETSc reads this one without a prefix
        if self.comm.size == 1 and not options.hasName("matptap_via"):
            options["matptap_via"] = "rap"
        self._drop()
        scalars = matrix.convert("aij", out=PETSc.Mat())
        scalars.setOption(PETSc.Mat.Option.SYMMETRIC, self.symmetric)
        scalars.setOption(PETSc.Mat.Option.USE_INODES, False)  # products by them take thrice as long
        if self._near_null_space is not None:
            scalars.setNearNullSpace(self._near_null_space(scalars))
        hierarchy = hierarchy_of(scalars, PREFIX)
        self._blocks = BlockOperator(matrix)  # after what takes the most memory
        self._objects = (self._blocks,)
        pc, self._relaxation = multigrid(hierarchy, self._blocks, PREFIX)
        self._general = self._ksp(pc, "gmres")
        self._krylov = self._fresh = self._ksp(pc, "cg") if self.symmetric else self._general
        self._copy = pc.getOperators()[1]
        self._objects = (self._krylov, self._general, pc, self._blocks)
        self._fresh.setOperators(self._blocks.mat, self._copy)
        self._fresh.setUp()
        scalars.destroy()

    def solve(self, matrix: Mat, pattern: int, rhs: Vec, out: Vec, tolerance: float) -> int:
        """out = matrix^-1 rhs to a relative residual; returns PETSc's reason, negative on failure, the same on all ranks.

        pattern: number that changes with the matrix's nonzero pattern. After a failure nothing is kept: MUMPS goes on
        reporting the singular matrix that it met last. A solution that is not finite is a failure, whatever PETSc says. A
        factorisation that fails is made again in another way where one is left, see Factors; later ones keep to that way.
        """
        self._mark = time.perf_counter()
        reason = self._tried(matrix, pattern, rhs, out, tolerance)
        while reason < 0 and self._rows is not None and self._factors.fall_back():
            self.use(self.method)
            reason = self._tried(matrix, pattern, rhs, out, tolerance)
        self._lap(digits_of(tolerance))
        if reason >= 0 and not np.isfinite(out.norm()):
            reason = -NOT_FINITE
        if reason < 0:
            self.mumps_code = self._factors.code() if self._rows is not None else 0
            self.use(self.method)
        return reason

    def _tried(self, matrix: Mat, pattern: int, rhs: Vec, out: Vec, tolerance: float) -> int:
        reason = -1
        change = self.choice is not None and (self.choice.lost(self.method) or self.choice.due(self.method))
        if not self.anew and self._reuse is not None and not change and self._worth_trying(matrix, self._reuse):
            reason = self._run(self._krylov, matrix, pattern, rhs, out, (tolerance, self._reuse.limit(tolerance)))
        if reason < 0:
            # PETSc counts the changes of each matrix by itself: another one may have as many behind it
            kept = self._reuse is not None and pattern == self._pattern and self._state == matrix.stateGet()
            if not kept and (error := self._build(matrix, pattern)):
                return error
            longest = self.choice.longest(self.method) if self.choice else None
            reason = self._run(self._fresh, matrix, pattern, rhs, out, (tolerance, longest or self.longest))
            if reason >= 0 and self._rows is not None and self._factors.plain and not _solved(matrix, rhs, out):
                reason = PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED
        return reason

    def _worth_trying(self, matrix: Mat, reuse: Reuse) -> bool:
        """Whether what is kept should still serve.

        A hierarchy does until it grows dear: its smoother knows the new rows, and the plate without contact coarsens much as
        the pressed one does. A factorisation knows none of the rows that have changed.
        """
        if reuse.stale:
            return False
        if self.method == "iterative":
            return True
        growth = np.abs(matrix.getDiagonal().array_r / self._diagonal)
        changed = self.comm.allreduce(int(((growth > CHANGED) | (growth < 1 / CHANGED)).sum()))
        return 2 * changed < reuse.build_cost

    def _build(self, matrix: Mat, pattern: int) -> int:
        """New factorisation or hierarchy of a matrix; returns zero or PETSc's error as a negative reason."""
        if self.choice:
            self._lap()
            if (method := self.choice.next(self.method)) != self.method:
                self.use(method)
        with self.timers("factorisation"):
            error = _code(lambda: self._prepare(matrix, pattern))
            self._diagonal = matrix.getDiagonal().array_r.copy()
            self._pattern, self._state = pattern, matrix.stateGet()
            self._reuse = Reuse(HIERARCHY_COST if self._rows is None else self._factors.cost())
            self.builds += 1
        self._lap()
        return error

    def _prepare(self, matrix: Mat, pattern: int) -> int:
        """Factorise or coarsen a matrix; returns zero or PETSc's reason. PETSc.Error where that fails."""
        if self._rows is None:
            self._coarsened(matrix)
            return 0
        self._rows.use(matrix, pattern == self._pattern, self.symmetric)
        with self._factors.chosen(self._rows.entries):
            return self._rows.set_up()

    def _lap(self, digits: float = 0.0) -> None:
        """Have the choice know of the time since the last lap, and of a solve by its digits."""
        if self.choice:
            now = time.perf_counter()
            self.choice.spent(now - self._mark, digits)
            self._mark = now

    def _run(self, ksp: Solver, matrix: Mat, pattern: int, rhs: Vec, out: Vec, until: tuple[float, int]) -> int:
        """until: the relative residual, and after how many iterations it is given up."""
        tolerance, most = until
        with self.timers("solve"):
            if self._blocks is not None:
                self._blocks.use(matrix, pattern)
            if self._relaxation is not None:
                self._relaxation.renew()  # an old one of a row that has become stiff would have the smoother diverge
            ksp.setOperators(self._blocks.mat if self._blocks else matrix, self._copy)
            ksp.setTolerances(rtol=tolerance, max_it=most)
            if error := _code(lambda: ksp.solve(rhs, out)):
                return error
        iterations, reason = ksp.getIterationNumber(), ksp.getConvergedReason()
        self.iterations += iterations
        if self.method == "iterative" and ksp is not self._general and reason in INDEFINITE:
            return self._run(self._general, matrix, pattern, rhs, out, until)
        if self._reuse is not None:
            self._reuse.solved(iterations, tolerance)
        return reason

    def negative_pivots(self) -> int | None:
        """Of the factorisation at hand, see Factors; None: there is none, or it does not tell."""
        return self._factors.negative() if self._rows is not None and self._reuse is not None else None

    def substituted(self, right: Vec, out: Vec) -> int:
        """out from `right` by the factorisation at hand, whichever matrix it is of; returns 0, negative on failure."""
        error = _code(lambda: self._krylov.getPC().apply(right, out))
        return error if error or np.isfinite(out.norm()) else -NOT_FINITE

    def resists(self, softest: Softest, matrix: Mat) -> bool | None:
        """What `softest` finds in the matrix of the last solve; None where nothing is kept that preconditions it."""
        if self._reuse is None or self.anew:
            return None
        with self.timers("solve"):
            product = self._blocks.mat if self._blocks else matrix
            found = softest.resists(product, self._krylov.getPC(), self.symmetric)
        raise_stopped()
        return found


def _solved(matrix: Mat, rhs: Vec, out: Vec) -> bool:
    """Whether out solves a system as well as an iterative solver has to. False of what is no number."""
    rest = rhs.duplicate()
    matrix.mult(out, rest)
    rest.axpy(-1.0, rhs)
    return bool(rest.norm() <= TIGHTEST * rhs.norm())


def _code(call: Callable[[], int | None]) -> int:
    """What it returns, negative where that failed, or PETSc's error code as a negative number: the same on all ranks."""
    code = 0
    try:
        code = call() or 0
    except PETSc.Error as error:
        code = -abs(error.ierr)
    raise_stopped()
    return code

"""Linear solves with a System's tangent: elimination of supports, direct or iterative solver, the tools' border."""

import numpy as np
from petsc4py import PETSc

PREFIX = "fc_"  # every choice below can be overridden by PETSc options with this prefix
# Above this many unknowns smoothed aggregation beats factorisation (README, speed).
ITERATIVE_ABOVE = 30_000

TIGHTEST = 1e-8  # relative residual of an iterative solve where nothing looser will do


class LinearFailure(RuntimeError):
    """The linear solver could not solve the tangent system; the message says why."""


class LinearSolver:
    """Solves K du + C dq = -R with prescribed du and dq.

    system: System; method: "direct" (MUMPS: Cholesky where the tangent is symmetric, else LU), "iterative" (CG or GMRES with
    smoothed aggregation and the rigid-body modes), or "auto" by size.
    """

    def __init__(self, system, method="auto"):
        if method not in ("auto", "direct", "iterative"):
            raise ValueError(f"linear solver '{method}' is not known; choose auto, direct or iterative")
        self.system = system
        size = system.vector.getSize()
        self.method = method if method != "auto" else ("iterative" if size > ITERATIVE_ABOVE else "direct")
        self._forced = method == "iterative"
        self.iterations = 0
        self.fallbacks = []  # what the log and the summary say of a change of solver
        self._pivot = self._modes = None
        self.ksp = PETSc.KSP().create(system.comm)
        self.ksp.setOptionsPrefix(PREFIX)
        self.ksp.setOperators(system.matrix)
        (self._use_iterative if self.method == "iterative" else self._use_direct)()
        self.ksp.setFromOptions()

    def _use_direct(self):
        self.ksp.setType("preonly")
        pc = self.ksp.getPC()
        pc.setType("cholesky" if self.system.symmetric else "lu")
        pc.setFactorSolverType("mumps")

    def _use_iterative(self):
        self.ksp.setType("cg" if self.system.symmetric else "gmres")
        self.ksp.setTolerances(rtol=TIGHTEST, max_it=400)
        if not self.system.symmetric:
            self.ksp.setGMRESRestart(100)
        self._modes = _rigid_body_modes(self.system)
        options = PETSc.Options()
        for key, value in (
            ("pc_gamg_threshold", 0.01),
            ("pc_gamg_aggressive_coarsening", 1),
            ("pc_gamg_reuse_interpolation", True),
            ("mg_levels_ksp_type", "chebyshev"),
            ("mg_levels_pc_type", "jacobi"),
            ("mg_levels_ksp_max_it", 3),
        ):
            if not options.hasName(PREFIX + key):
                options[PREFIX + key] = value
        self.ksp.getPC().setType("gamg")

    def solve(self, du_supports, dq, tolerance=TIGHTEST):
        """Increment (du Vec, dq (tools, 3)) of the assembled tangent and residual.

        du_supports: increments of the supports' local dofs; dq (tools, 3): increments of prescribed tools, zero where free.
        tolerance: relative residual at which an iterative solver may stop; the direct one does not look at it.
        Raises LinearFailure, on all ranks, if the solver fails.
        """
        system = self.system
        return self.solve_sides([(system.residual_vector, system.tool_residual, du_supports, dq)], tolerance)[0]

    def solve_sides(self, sides, tolerance=TIGHTEST):
        """Increments (du, dq) for several sides with one factorisation and one set of the tools' responses.

        sides: (residual Vec, tool residual (tools, 3), du_supports, dq) each. Raises LinearFailure as `solve` does.
        """
        self.ksp.setTolerances(rtol=tolerance)
        system, free = self.system, np.flatnonzero(self.system.tools.free.ravel())
        rights = []
        for residual, _, _, dq in sides:
            rhs = residual.copy()
            rhs.scale(-1.0)
            self._add_prescribed_travel(rhs, dq)
            rights.append(rhs)
        increments = self._eliminate(rights, [du_supports for _, _, du_supports, _ in sides])
        for rhs, du in zip(rights, increments, strict=True):
            self._solve(rhs, du)
        if not free.size:
            return [(du, dq) for du, (_, _, _, dq) in zip(increments, sides, strict=True)]
        columns = [self._response(c) for c in free]
        rows = [system.border_vector(system.border.rows[c]) for c in free]
        schur = system.border.corner[np.ix_(free, free)].copy()
        for i, row in enumerate(rows):
            schur[i] += [row.dot(column) for column in columns]
        return [
            self._with_free_travel(du, dq, tool_residual, free, schur, rows, columns)
            for du, (_, tool_residual, _, dq) in zip(increments, sides, strict=True)
        ]

    def _with_free_travel(self, du, dq, tool_residual, free, schur, rows, columns):
        """The pushed tools' share of an increment: the border's Schur complement."""
        right = -tool_residual.ravel()[free] - self.system.border.corner[free] @ dq.ravel()
        right -= [row.dot(du) for row in rows]
        try:
            travel = np.linalg.solve(schur, right)
        except np.linalg.LinAlgError:
            raise LinearFailure("a pushed tool meets no resistance: bring it into contact before the force acts") from None
        for amount, column in zip(travel, columns, strict=True):
            du.axpy(amount, column)
        total = dq.ravel().copy()
        total[free] += travel
        return du, total.reshape(-1, 3)

    def _add_prescribed_travel(self, rhs, dq):
        if self.system.border is None:
            return
        for c in np.flatnonzero(dq.ravel()):
            rhs.axpy(-dq.ravel()[c], self.system.border_vector(self.system.border.columns[c]))

    def _eliminate(self, rights, du_supports):
        """Put the supports' increments into the right-hand sides and the matrix, keeping its symmetry and pattern.

        Returns, for each side, a vector that holds the supports' increments.
        """
        system = self.system
        if self._pivot is None:  # a diagonal of the matrix's own size keeps the multigrid's smoother bounds sane
            self._pivot = max(system.matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY), 1e-300)
        increments = []
        for rhs, values in zip(rights, du_supports, strict=True):
            du = system.vector.duplicate()
            with du.localForm() as local:
                local.set(0.0)
                local.array_w[system.supports.dofs] = values
            rhs.axpy(-1.0, system.matrix * du)
            rhs.array_w[system.supports.owned] = self._pivot * du.array_r[system.supports.owned]
            increments.append(du)
        system.matrix.zeroRowsColumnsLocal(system.supports.owned, self._pivot)
        return increments

    def _response(self, component):
        """du/dq of one free travel component: K^-1 (-C)."""
        values = -self.system.border.columns[component]
        column = self.system.border_vector(values)
        with column.localForm() as local:
            local.array_w[self.system.supports.dofs] = 0.0
        out = column.duplicate()
        self._solve(column, out)
        return out

    def _solve(self, rhs, out):
        """Solve with the eliminated matrix; an iterative solver that stalls hands over to the direct one for good."""
        reason = self._attempt(rhs, out)
        if reason < 0 and self.method == "iterative" and not self._forced:
            self.method = "direct"
            self.fallbacks.append(f"iterative solver stopped with reason {reason}; the direct one took over")
            self.ksp.reset()
            self._use_direct()
            reason = self._attempt(rhs, out)
        if reason < 0:
            raise LinearFailure(
                f"the {self.method} linear solver failed (reason {reason}): the tangent is singular (is a body free to "
                "move?) or memory ran out"
            )

    def _attempt(self, rhs, out):
        """One solve; returns PETSc's converged reason, negative where it failed."""
        guess = out.copy() if self.method == "iterative" else None
        with self.system.timers("factorisation"):
            if self._modes is not None:  # the matrix is another one when contacts couple other nodes
                self.system.matrix.setNearNullSpace(self._modes)
            self.ksp.setOperators(self.system.matrix)
            try:
                self.ksp.setUp()
            except PETSc.Error as error:
                return -abs(error.ierr)
        with self.system.timers("linear solve"):
            self.ksp.solve(rhs, out)
        self.iterations += self.ksp.getIterationNumber()
        reason = self.ksp.getConvergedReason()
        if reason < 0 and guess is not None:
            guess.copy(out)
        return reason


def _rigid_body_modes(system):
    """Six rigid-body motions of the reference mesh: the near-null space of the tangent."""
    X = system.space.tabulate_dof_coordinates()
    owned = system.space.dofmap.index_map.size_local
    X = X[:owned] - X[:owned].mean(axis=0) if owned else X[:0]
    modes = np.zeros((6, owned, 3))
    for i in range(3):
        modes[i, :, i] = 1.0
        j, k = (i + 1) % 3, (i + 2) % 3
        modes[3 + i, :, j], modes[3 + i, :, k] = -X[:, k], X[:, j]
    vectors = [PETSc.Vec().createWithArray(mode.ravel().copy(), comm=system.comm) for mode in modes]
    for i, vector in enumerate(vectors):
        for other in vectors[:i]:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
    return PETSc.NullSpace().create(vectors=vectors, comm=system.comm)

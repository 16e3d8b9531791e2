"""Linear solves with a System's tangent: elimination of supports, choice of solver, the tools' border."""

import numpy as np
from petsc4py import PETSc

from fenics_contact.solvers.reuse import TIGHTEST, ReusingSolver

# Above this many unknowns smoothed aggregation beats factorisation (README, speed).
ITERATIVE_ABOVE = 6_000


class LinearFailure(RuntimeError):
    """The linear solver could not solve the tangent system; the message says why."""


class LinearSolver:
    """Solves K du + C dq = -R with prescribed du and dq.

    system: System; method: "direct" (MUMPS: Cholesky where the tangent is symmetric, else LU), "iterative" (CG or GMRES with
    smoothed aggregation and the rigid-body modes), or "auto" by size. Either is kept from tangent to tangent while it pays.
    """

    def __init__(self, system, method="auto"):
        if method not in ("auto", "direct", "iterative"):
            raise ValueError(f"linear solver '{method}' is not known; choose auto, direct or iterative")
        self.system = system
        size = system.vector.getSize()
        self._forced = method == "iterative"
        method = method if method != "auto" else ("iterative" if size > ITERATIVE_ABOVE else "direct")
        self.fallbacks = []  # what the log and the summary say of a change of solver
        self._pivot = None
        self._solver = ReusingSolver(
            system.comm, size, system.symmetric, method, lambda matrix: _soft_modes(system, matrix), system.timers
        )

    @property
    def method(self):
        return self._solver.method

    @property
    def iterations(self):
        """Krylov iterations so far."""
        return self._solver.iterations

    @property
    def builds(self):
        """Factorisations or multigrid hierarchies made so far."""
        return self._solver.builds

    def solve(self, du_supports, dq, tolerance=TIGHTEST):
        """Increment (du Vec, dq (tools, 3)) of the assembled tangent and residual.

        du_supports: increments of the supports' local dofs; dq (tools, 3): increments of prescribed tools, zero where free.
        tolerance: relative residual at which an iterative solver may stop; the direct one does not look at it.
        Raises LinearFailure, on all ranks, if the solver fails.
        """
        self._tolerance = tolerance
        system, free = self.system, np.flatnonzero(self.system.tools.free.ravel())
        rhs = system.residual_vector.copy()
        rhs.scale(-1.0)
        self._add_prescribed_travel(rhs, dq)
        du = self._eliminate(rhs, du_supports)
        self._solve(rhs, du)
        with du.localForm() as local:
            local.array_w[system.supports.dofs] = du_supports
        if not free.size:
            return du, dq
        columns = [self._response(c) for c in free]
        rows = [system.border_vector(system.border.rows[c]) for c in free]
        schur = system.border.corner[np.ix_(free, free)].copy()
        right = -system.tool_residual.ravel()[free] - system.border.corner[free] @ dq.ravel()
        for i, row in enumerate(rows):
            right[i] -= row.dot(du)
            schur[i] += [row.dot(column) for column in columns]
        try:
            travel = np.linalg.solve(schur, right)
        except np.linalg.LinAlgError:
            raise LinearFailure("a pushed tool meets no resistance: bring it into contact before the force acts") from None
        for amount, column in zip(travel, columns, strict=False):
            du.axpy(amount, column)
        total = dq.ravel().copy()
        total[free] += travel
        return du, total.reshape(-1, 3)

    def _add_prescribed_travel(self, rhs, dq):
        if self.system.border is None:
            return
        for c in np.flatnonzero(dq.ravel()):
            rhs.axpy(-dq.ravel()[c], self.system.border_vector(self.system.border.columns[c]))

    def _eliminate(self, rhs, du_supports):
        """Put the supports' increments into the right-hand side and unit rows into the matrix, keeping symmetry and pattern.

        The rows' own right-hand side stays zero, so that norms are those of the unknown part. Returns a vector for it.
        """
        system = self.system
        du = system.vector.duplicate()
        if self._pivot is None:  # a diagonal of the matrix's own size keeps the multigrid's smoother bounds sane
            self._pivot = max(system.matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY), 1e-300)
        with du.localForm() as local:
            local.set(0.0)
            local.array_w[system.supports.dofs] = du_supports
        system.matrix.zeroRowsColumnsLocal(system.supports.owned, self._pivot, du, rhs)
        rhs.array_w[system.supports.owned] = 0.0
        return du

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
        system, solver = self.system, self._solver
        reason = solver.solve(system.matrix, system.patterns, rhs, out, self._tolerance)
        if reason < 0 and self.method == "iterative" and not self._forced:
            self.fallbacks.append(f"iterative solver stopped with reason {reason}; the direct one took over")
            solver.use("direct")
            reason = solver.solve(system.matrix, system.patterns, rhs, out, self._tolerance)
        if reason < 0:
            raise LinearFailure(
                f"the {self.method} linear solver failed (reason {reason}): the tangent is singular (is a body free to "
                "move?) or memory ran out"
            )


def _soft_modes(system, matrix):
    """Near-null space of the tangent: rigid-body motions of the deformed mesh that fade out where something holds them.

    Where a penalty or a support holds a node the motions cost energy, and a coarse grid made from them can correct nothing
    around it: a frictional punch then takes hundreds of iterations, or fails. Two sweeps of Jacobi's relaxation take
    them away there and leave them alone elsewhere, where the tangent hardly resists them (measured; more sweeps, or none
    of the damping, do worse).
    """
    owned = system.space.dofmap.index_map.size_local
    X = system.space.tabulate_dof_coordinates()[:owned] + system.vector.array_r.reshape(-1, 3)
    X = X - X.mean(axis=0) if owned else X
    modes = np.zeros((6, owned, 3))
    for i in range(3):
        modes[i, :, i] = 1.0
        j, k = (i + 1) % 3, (i + 2) % 3
        modes[3 + i, :, j], modes[3 + i, :, k] = -X[:, k], X[:, j]
    vectors = [PETSc.Vec().createWithArray(mode.ravel().copy(), comm=system.comm) for mode in modes]
    step = matrix.getDiagonal()
    step.reciprocal()
    step.scale(0.9)
    force = step.duplicate()
    for i, vector in enumerate(vectors):
        for _ in range(2):
            matrix.mult(vector, force)
            force.pointwiseMult(force, step)
            vector.axpy(-1.0, force)
        for other in vectors[:i]:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
    return PETSc.NullSpace().create(vectors=vectors, comm=system.comm)

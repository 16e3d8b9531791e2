"""PETSc SNES on a System: its vector holds the displacement and the tools' coordinates, its tangent is the bordered one."""

from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.solvers.gripping import first_solve
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.out_of_balance import relative_residual
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Floats, Mat, Vec

PREFIX = "fc_snes_"


class Snes:
    """A load step by SNES (newtonls, overridable with options prefixed fc_snes_), after the same predictor as Newton."""

    def __init__(self, linear: LinearSolver, tolerance: float = TOLERANCE, limit: int = 20) -> None:
        self.linear, self.tolerance, self.limit = linear, tolerance, limit

    def settle(self, system: System, t: float) -> StepReport:
        """Into balance at t from the present state, after its multipliers have changed: SNES always starts from there."""
        return self._solve(system, t, again=True)

    settle_near = settle

    def step(self, system: System, t: float) -> StepReport:
        """Carry the system from its committed state to t; StepFailed if SNES does not converge."""
        return self._solve(system, t, again=False)

    def _solve(self, system: System, t: float, again: bool) -> StepReport:
        du, dq = system.begin_step(t)
        system.assemble_residual()
        first_solve(system, self.linear, du, dq)
        system.foresight.release()
        if not again:
            system.foresight.resample(system.state)
        report = StepReport(1, [relative_residual(system)])
        problem = _Problem(system, self.linear, np.zeros_like(du), np.zeros_like(dq))
        snes = problem.solver(max(self.tolerance * system.scales.balance, system.scales.noise), self.limit)
        x = problem.start()
        snes.solve(None, x)
        problem.put(x)
        report.iterations += snes.getLinearSolveIterations() or snes.getIterationNumber()
        report.residuals.append(relative_residual(system))
        reason = snes.getConvergedReason()
        snes.destroy()
        if reason < 0:
            raise StepFailed(f"SNES stopped with reason {reason} at {report.residuals[-1]:.1e} of the force")
        return report


class _Problem:
    """SNES callbacks. The coordinates of the tools ride on the last rank behind its displacements."""

    def __init__(self, system: System, linear: LinearSolver, du: Floats, dq: Floats) -> None:
        self.system, self.linear, self.du, self.dq = system, linear, du, dq
        self.owned = system.vector.getLocalSize()
        self.free = np.flatnonzero(system.tools.free.ravel())
        comm = system.comm
        self.tail = self.free.size if comm.rank == comm.size - 1 else 0
        self.root = comm.size - 1

    def solver(self, absolute: float, limit: int) -> Any:
        snes = PETSc.SNES().create(self.system.comm)
        snes.setOptionsPrefix(PREFIX)
        residual = self._vector()
        snes.setFunction(self._function, residual)
        size = (residual.getLocalSize(), residual.getSize())
        jacobian = PETSc.Mat().createPython((size, size), context=self, comm=self.system.comm)
        jacobian.setUp()
        snes.setJacobian(self._jacobian, jacobian)
        snes.setType("newtonls")
        # a full step: contact tangents are exact, and the residual norm need not fall while points change status
        PETSc.Options()[PREFIX + "snes_linesearch_type"] = "basic"
        snes.setTolerances(rtol=0.0, atol=absolute, stol=0.0, max_it=limit)
        ksp = snes.getKSP()
        ksp.setType("preonly")
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(self)
        snes.setFromOptions()
        return snes

    def _vector(self) -> Vec:
        return PETSc.Vec().createMPI((self.owned + self.tail, None), comm=self.system.comm)

    def start(self) -> Vec:
        x = self._vector()
        x.array[: self.owned] = self.system.vector.array_r
        x.array[self.owned :] = self.system.state.q.ravel()[self.free][: self.tail]
        return x

    def put(self, x: Vec) -> None:
        """State <- SNES vector."""
        system = self.system
        du = system.new_vector()
        du.array[:] = x.array_r[: self.owned] - system.vector.array_r
        moved = system.comm.bcast(x.array_r[self.owned :].copy(), root=self.root)
        dq = np.zeros(system.state.q.size)
        dq[self.free] = moved - system.state.q.ravel()[self.free]
        system.update(du, dq.reshape(-1, 6))

    def _function(self, snes: Any, x: Vec, f: Vec) -> None:
        self.put(x)
        self.system.assemble_residual()
        f.array[: self.owned] = self.system.residual_vector.array_r
        f.array[self.owned :] = self.system.tool_residual.ravel()[self.free][: self.tail]

    def _jacobian(self, snes: Any, x: Vec, jacobian: Mat, preconditioner: Mat) -> None:
        self.put(x)
        self.system.assemble_residual()
        self.system.assemble_tangent()

    def apply(self, pc: Any, b: Vec, y: Vec) -> None:
        """Preconditioner of the one-iteration KSP: the exact bordered solve. SNES solves J y = F, y is subtracted."""
        du, dq = self.linear.solve(self.du, self.dq)
        y.array[: self.owned] = -du.array_r
        y.array[self.owned :] = -dq.ravel()[self.free][: self.tail]

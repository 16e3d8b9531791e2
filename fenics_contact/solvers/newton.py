"""Steppers from one load parameter to the next: full Newton, and the paper's incremental scheme."""

from dataclasses import dataclass, field

import numpy as np
from petsc4py import PETSc

from fenics_contact.solvers.cycles import StatusWatch
from fenics_contact.solvers.linear import LinearFailure
from fenics_contact.solvers.reuse import TIGHTEST
from fenics_contact.solvers.verdict import StepFailed

FARTHEST = 1e3  # sizes of the bodies; a tangent that moves a node by more than that is singular to round-off
SHORTEST = 1 / 64  # of a Newton step; shorter ones stall rather than converge


@dataclass
class StepReport:
    """What a step took: tangent solves, the out-of-balance norm over the force scale after each, what was resolved."""

    iterations: int = 0
    residuals: list = field(default_factory=list)
    notes: list = field(default_factory=list)


class Newton:
    """Newton's method within a load step.

    The first solve is a predictor: the tangent of the last accepted state carries supports and tools to their new places.
    tolerance: out-of-balance force over the largest force seen (1e-8: below it the penalty's own error rules by far and
    the last quadratic iteration usually lands near round-off); limit: largest number of tangent solves.
    """

    def __init__(self, linear, tolerance=1e-8, limit=20):
        self.linear, self.tolerance, self.limit = linear, tolerance, limit

    def step(self, system, t):
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        du, dq = system.begin_step(t)
        system.assemble_residual()
        report = StepReport()
        watch = StatusWatch(system, report.notes)
        before = np.inf  # the predictor carries supports and tools, so it is taken whole
        while True:
            du, dq = solve_once(system, self.linear, du, dq, _forcing(before))
            report.iterations += 1
            before = (
                relative_residual(system, followed=True)
                if before == np.inf
                else self._shorten(system, du, dq, before, watch.cycling)
            )
            size = relative_residual(system) if system.condensed else before  # assembled last: the next right-hand side
            report.residuals.append(size)
            if size <= self.tolerance:
                return report
            if report.iterations >= self.limit:
                watch.blame()
                raise StepFailed(f"{self.limit} Newton iterations left {size:.1e} of the force out of balance")
            watch.look(report.residuals)
            du, dq = np.zeros(len(system.supports.dofs)), np.zeros_like(dq)

    def _shorten(self, system, du, dq, before, strict):
        """Where a full step does not lower the out-of-balance force, halve it while that helps; returns the share left.

        Condensed unknowns follow the tangent here. strict: halve it until it does lower it. A residual costs about a
        hundredth of a tangent solve.
        """
        share, size = 1.0, _finite_residual(system)
        while size > before and share > (SHORTEST / 16 if strict else SHORTEST):
            shorter = _move(system, du, dq, share, 0.5 * share)
            if shorter >= size and not strict:
                _move(system, du, dq, 0.5 * share, share)
                break
            share, size = 0.5 * share, shorter
        if not np.isfinite(size):
            raise StepFailed("an element turned inside out")
        return size


def _move(system, du, dq, start, end):
    """Move from one share of an increment to another; returns the out-of-balance share there."""
    step = du.copy()
    step.scale(end - start)
    system.update(step, (end - start) * dq, end)
    return _finite_residual(system)


def _finite_residual(system):
    """Out-of-balance share, infinite where an element is inside out."""
    try:
        return relative_residual(system, followed=True)
    except StepFailed:
        return np.inf


class Incremental:
    """The paper's step equation: one linear solve per step, the out-of-balance force carried into the next."""

    def __init__(self, linear):
        self.linear = linear

    def step(self, system, t):
        du, dq = system.begin_step(t)
        system.assemble_residual()
        solve_once(system, self.linear, du, dq)
        return StepReport(1, [relative_residual(system)])


def _forcing(residual):
    """How far an iterative solve must go: a tenth of what Newton's quadratic convergence can gain from this residual.

    (Dembo, Eisenstat & Steihaug 1982, doi:10.1137/0719025.) The predictor, which has no residual yet, gets 1e-4.
    """
    return 1e-4 if residual == np.inf else float(np.clip(0.1 * residual, TIGHTEST, 1e-4))


def solve_once(system, linear, du, dq, tolerance=TIGHTEST):
    """One tangent solve with the assembled residual, and the update of the state."""
    system.assemble_tangent()
    try:
        increment = linear.solve(du, dq, tolerance)
    except LinearFailure as failure:
        raise StepFailed(*failure.args) from None
    if not increment[0].norm(PETSc.NormType.NORM_INFINITY) <= FARTHEST * system.extent + np.abs(du).max(initial=0.0):
        raise StepFailed("the tangent is singular: an increment is not finite or far larger than the bodies")
    system.update(*increment)
    return increment


def relative_residual(system, followed=False):
    """Out-of-balance norm over the largest force of any term, now or before; StepFailed where it is not a number."""
    size = system.assemble_residual(followed)
    if not np.isfinite(size):
        raise StepFailed("an element turned inside out")
    scale = max(system.forces, system.force_scale, system.rounding)
    return size / scale if scale > 0.0 else size

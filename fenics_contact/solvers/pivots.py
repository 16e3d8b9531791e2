"""Negative pivots of the tangent along load steps: a bifurcation passed is said, Newton's method goes on."""

from fenics_contact.assembly.system import System
from fenics_contact.solvers.control import OnStep
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.verdict import Verdict

NEAR = 1e-3  # of the force out of balance where the last tangent of a step was made: then its pivots are the state's


class PivotWatch:
    """Looks at every accepted step before the hook `on_step`: whether pivots have changed their sign, which are all positive
    on the stable path from rest."""

    def __init__(self, system: System, linear: LinearSolver, verdict: Verdict, on_step: OnStep) -> None:
        self.system, self.linear, self.verdict, self.on_step = system, linear, verdict, on_step
        self.negative = 0 if system.force_scale == 0.0 else None  # not known of a run that is resumed
        self._builds = linear.builds

    def __call__(self, report: StepReport, seconds: float, on_schedule: bool) -> None:
        fresh, self._builds = self.linear.builds > self._builds, self.linear.builds
        near = len(report.residuals) > 1 and report.residuals[-2] <= NEAR
        if fresh and near and self.linear.negative is not None:
            self._look(self.linear.negative)
        self.on_step(report, seconds, on_schedule)

    def forget(self) -> None:
        """The path has been followed by arc length meanwhile: what its pivots are is not known until they are seen."""
        self.negative = None

    def _look(self, now: int) -> None:
        if self.negative is not None and now > self.negative:
            number = f"{now}" if self.system.symmetric else "an odd number"
            self.verdict.notes.append(
                f"step {len(self.verdict.residuals)} to t = {self.system.state.t:.6g}: {number} of the tangent's pivots are "
                f"negative, before {self.negative}: a bifurcation has been passed, and this path may be unstable; follow "
                'it by method="arc_length", and a branch by ArcSteps(branch=Branch(...))'
            )
        self.negative = now

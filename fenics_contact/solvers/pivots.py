"""Negative pivots of the tangent along load steps: a bifurcation passed is said, Newton's method goes on."""

from fenics_contact.assembly.system import System
from fenics_contact.solvers.control import OnStep
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.solvers.out_of_balance import LOOSEST
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.softness import rolling, unresisted
from fenics_contact.solvers.verdict import Verdict

UNRESISTED = "the tangent no longer resists every motion, as it did in the step before"


class PivotWatch:
    """Looks at every accepted step before the hook `on_step`: whether pivots have changed their sign, which are all positive
    on the stable path from rest. arcs: whether arc length may follow the path, which not every run can have."""

    def __init__(self, system: System, linear: LinearSolver, verdict: Verdict, on_step: OnStep, arcs: bool) -> None:
        self.system, self.linear, self.verdict, self.on_step, self.arcs = system, linear, verdict, on_step, arcs
        self.negative = 0 if system.scales.accepted == 0.0 else None  # not known of a run that is resumed
        linear.stalls.resume(verdict)
        self._counted = True  # else one motion was found that is not resisted, and there may be more

    def __call__(self, report: StepReport, seconds: float, on_schedule: bool) -> None:
        now, counted = self._seen()
        if report.iterations == 1 and now == self.negative:  # of the state before this step
            now, counted = self._seen_in_the_end()
        # of an iterate, or hidden by those of an older factorisation
        doubtful = bool(self.linear.negative) if now is None else now != self.negative
        if doubtful:
            self.linear.forget()
            now, counted = self._seen_in_the_end()
        if now is not None:
            self._look(now, counted)
        self.linear.stalls.accepted(self.verdict)
        self.on_step(report, seconds, on_schedule)

    def _seen(self) -> tuple[int | None, bool]:
        """Negative pivots of the last tangent, and whether they were counted. Collective."""
        if self.linear.fresh and self.linear.negative is not None:
            now = self.linear.count_negative(self.negative)
            return now, now == self.linear.negative
        resists = self.linear.resists()  # an older factorisation, or a hierarchy, served
        if resists is None:
            return None, False
        # over that one: what it does not resist itself, the tangent does not either
        return (self.linear.negative or 0) if resists else max(1, self.negative or 0), False

    def _seen_in_the_end(self) -> tuple[int | None, bool]:
        """The same of the tangent in the state that was accepted; what is solved with it is not needed. Collective."""
        system = self.system
        system.assemble_residual()
        system.assemble_tangent()
        try:
            self.linear.solve(*system.still(), LOOSEST)
        except LinearFailure:
            return None, False
        return self._seen()

    def _all_rounding(self) -> bool:
        """Whether pivots are negative by round-off alone, those of rigid motions that nothing resists. Collective."""
        if not unresisted(self.system):
            return False
        linear = LinearSolver(self.system, "direct", afresh=True)
        try:
            linear.solve(*self.system.still())
        except LinearFailure:
            return False
        now = linear.count_negative(self.negative)
        return now is not None and now <= (self.negative or 0)

    def forget(self) -> None:
        """The path has been followed by arc length meanwhile: what its pivots are is not known until they are seen."""
        self.negative = None

    def _look(self, now: int, counted: bool = True) -> None:
        if self.negative is not None and now > self.negative and (self._counted or not self.negative):
            if self._all_rounding():
                return
            why = "a bifurcation has been passed, and this path may be unstable"
            if not self.system.symmetric:  # with friction a determinant below zero is no proof of another path
                found = "the determinant of the tangent has become negative" if now % 2 else UNRESISTED
                why = (
                    "a bifurcation may have been passed, or a body has let go and moved far within this step; look at this "
                )
                why += "step's motion"
            elif counted:
                found = f"the tangent has {now} negative pivots, {self.negative or 'none'} in the step before"
            else:
                found = UNRESISTED
            remedy = (
                "follow the path by steps=ArcSteps(until=...), and a branch by its branch=Branch(...)"
                if self.arcs
                else "compare with shorter steps here (arc length, which follows a path, does not go with stabilise= and "
                'where="open")'
            )
            if now == (self.negative or 0) + 1 and (loose := rolling(self.system)):
                why = f"{loose} nearly as a rigid one, which no support holds and what touches it does not resist: "
                if self.system.symmetric:
                    why += "it topples, or it is round and may rest as well a little farther on"
                    remedy = f"hold it by a support or by friction, or {remedy}"
                else:
                    why += (
                        "all of it slides, as where no node lies in the middle of what spreads, or it topples, or is round"
                    )
                    remedy = f"hold it by a support or a plane of symmetry, take finer cells of the slave, or {remedy}"
            self.verdict.note(f"{found}: {why}; {remedy}", found)
        self._counted = counted or (self._counted and now == self.negative)
        self.negative = now

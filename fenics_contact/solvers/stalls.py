"""The direct solver in the place of an iterative one that stalls: until that step is over, or for the rest of the run."""

from fenics_contact.assembly.trail import Trail
from fenics_contact.solvers.choice import OTHER
from fenics_contact.solvers.reuse import ReusingSolver
from fenics_contact.solvers.verdict import Verdict

TRIES = 2  # of one step that have stalled: then the direct solver stays until a step is accepted
STEPS = 3  # accepted with the direct solver standing in, beyond those accepted without: then it stays for the run


class Stalls:
    """Has the direct solver stand in where the iterative one stalls, and that one come back.

    What stalls it is mostly the singular tangent of a step that is tried too long, and is then taken back: once it is, or is
    accepted, the iterative one serves again, and its measured costs count as before. Where it would stall again and again
    the direct one stays. solver: what solves; trail: of its system; lasts: whether the first stall is one for good, as
    along a continuation, whose tangents stay singular beyond its limit points.
    """

    def __init__(self, solver: ReusingSolver, trail: Trail, lasts: bool) -> None:
        self._solver, self._trail, self._lasts = solver, trail, lasts
        self.choice = solver.choice
        self.count, self._reason = 0, 0  # stalls so far, and PETSc's reason for the last one
        self._tries = self._returns = 0  # of the present step that have stalled; returns of the trail before the last one
        self.standing, self.stays = False, False  # whether the direct one stands in, and for good
        self._news: list[str] = []

    def stalled(self, reason: int) -> None:
        """The iterative solver has stopped for PETSc's `reason`: the direct one stands in. A trial is lost by that."""
        self.count, self._reason = self.count + 1, reason
        self._tries, self._returns = self._tries + 1, self._trail.returns
        on_trial = self._solver.choice is not None and self._solver.choice.longest(self._solver.method) is not None
        if self._lasts or on_trial:
            self._stay()
        self._stand_in()

    def renew(self) -> None:
        """Call before each new tangent: the iterative solver serves again where the step that stalled it is over."""
        if self.standing and self._over and not self.stays:
            self.standing = False
            self._solver.go_by(self.choice)
            self._solver.use(OTHER["direct"])
            if self.choice:
                self.choice.count_anew()

    def accepted(self, verdict: Verdict) -> None:
        """Call with each step accepted: counts those that the direct solver stood in for, and logs a change that stays."""
        if not (self.stays or self._lasts):
            stood_in = self.standing and not self._over
            verdict.stood_in = max(verdict.stood_in + (1 if stood_in else -1), 0)
            self._tries = 0
            if verdict.stood_in >= STEPS:
                self._stay()
        for words in self._news:
            verdict.log(words)
        self._news.clear()

    def resume(self, verdict: Verdict) -> None:
        """Go on as a run did that has come to `verdict`. Collective."""
        if verdict.stood_in >= STEPS and self._solver.method == "iterative" and not self._lasts:
            self.stays = True
            self._stand_in()

    @property
    def words(self) -> list[str]:
        """What the summary says of changes of the solver."""
        if not self.count:
            return ["the direct solver stays, as before the run was resumed"] if self.stays else []
        until = "for good" if self.stays else "until each such step was taken back or accepted"
        times = "once" if self.count == 1 else f"{self.count} times"
        return [f"the iterative solver stalled {times} (PETSc's reason {self._reason}); the direct one took over {until}"]

    @property
    def _over(self) -> bool:
        """Whether the step that stalled last has been accepted, or taken back and not too often."""
        return self._tries == 0 or (self._tries < TRIES and self._trail.returns != self._returns)

    def _stand_in(self) -> None:
        self.standing = True
        self._solver.go_by(None)
        self._solver.use("direct")

    def _stay(self) -> None:
        self.stays = True
        self._news.append(
            f"the iterative linear solver stalls (PETSc's reason {self._reason}): from here on the direct one serves, which "
            "may take more memory and time"
        )

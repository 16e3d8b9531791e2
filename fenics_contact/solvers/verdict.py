"""How a run ended: converged, or what stopped it, where, and the change to try."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from fenics_contact.assembly.finding import CONVERGED, CYCLING, MEMORY, TOO_STIFF, UNKNOWN, Finding
from fenics_contact.assembly.system import System
from fenics_contact.solvers.report import StepReport

NO_HELP = (MEMORY, TOO_STIFF)  # kinds of failure that springs, multipliers or another way to the solution do not mend
PIVOTS = "pivots of the tangent"  # by which the steps are remembered in which they have changed their signs
SHORTENED = ": increments shortened"  # how the notes on such steps end
MANY = 12  # steps that a note names
LEFT = re.compile(r"\S+ of the force")  # the figure in a reason, another one at each failure


class StepFailed(RuntimeError):
    """A step did not converge; the message says why, and `finding` what is known of the cause."""

    def __init__(self, reason: str, kind: str = UNKNOWN, place: str = "", remedy: str = "") -> None:
        super().__init__(reason)
        self.finding = Finding(kind, reason, place, remedy)

    @classmethod
    def of(cls, finding: Finding) -> "StepFailed":
        return cls(finding.reason, finding.kind, finding.place, finding.remedy)


@dataclass
class Verdict:
    """How a run ended.

    kind, reason, place, remedy: what stopped it, in words; t: load parameter reached; step: number of the step that failed,
    0 if none did; cuts, iterations, corrections, augmentations: cut-backs, tangents, solves with an old one's
    factorisation, and updates of multipliers; residuals: per accepted step, the out-of-balance share after each solve;
    notes: what was resolved on the way; causes: number of cut-backs by what failed; said: a line for each that the log has
    not had yet; remarked: kinds of what has been said of terms and bodies, by name or place; resumed: numbers of the last
    steps before the run was killed and gone on with; shortened: steps in which increments were, as the first one notes;
    smallest: step [t] below which none is tried; longest: largest step [t] to try next, endless while no step failed.
    """

    converged: bool = True
    t: float = 0.0
    kind: str = CONVERGED
    reason: str = CONVERGED
    place: str = ""
    remedy: str = ""
    step: int = 0
    cuts: int = 0
    iterations: int = 0
    corrections: int = 0
    augmentations: int = 0
    residuals: list[list[float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    causes: dict[str, int] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    remarked: dict[str, list[str]] = field(default_factory=dict)
    resumed: list[int] = field(default_factory=list)
    shortened: int = 0
    smallest: float = 0.0
    longest: float = math.inf

    def cut(self, failure: StepFailed, what: str) -> None:
        """A step or an arc, `what`, has failed and is tried shorter."""
        kind, reason, place, _ = failure.finding
        cause = LEFT.sub("part of the force", reason) if kind == UNKNOWN else kind
        self.cuts += 1
        self.causes[cause] = self.causes.get(cause, 0) + 1
        line = f"{what} cut back: {reason}, {place}" if place else f"{what} cut back: {reason}"
        if kind == CYCLING and not any(" cut back: " in note and note.endswith(place) for note in self.notes):
            self.notes.append(line)  # of each place once: the log has the others
        else:
            self.said.append(line)

    def cut_notes(self) -> list[str]:
        """Notes on why steps were cut back, on how many had increments shortened, and where pivots have changed their signs
        more than once, if any were."""
        more = self.shortened - 1
        notes = [f"increments were shortened so in {more} later step{'s' * (more > 1)}"] if more > 0 else []
        if again := self.remarked.get(PIVOTS, [])[1:]:
            notes.append(
                f"the {PIVOTS} have changed their signs so in {len(again)} later step{'s' * (len(again) > 1)}, too: "
            )
            notes[-1] += ", ".join(again[:MANY]) + ", ..." * (len(again) > MANY)
        if not self.causes:
            return notes
        most = sorted(self.causes.items(), key=lambda cause: -cause[1])
        times = "cut-back, which leaves" if self.cuts == 1 else "cut-backs, which leave"
        why = ", ".join(f"{cause} ({count} of {self.cuts})" for cause, count in most)
        return [*notes, f"{self.cuts} {times} nothing in the result: {why}"]

    def accept(self, report: StepReport, system: System) -> None:
        """A step has been accepted, which took what its report says; terms may remark on the state. Collective."""
        self.t = system.state.t
        self.iterations += report.iterations
        self.corrections += report.corrections
        self.augmentations += report.augmentations
        self.residuals.append(report.residuals)
        notes = report.said
        for term in system.terms:
            said = self.remarked.setdefault(term.name, [])
            remarks = term.findings.remarks(system.state, said, system.scales.noise)
            notes += remarks.values()
            said += remarks
        for note in notes:
            line = f"step {len(self.residuals)} to t = {self.t:.6g}: {note}"
            again = note.endswith(SHORTENED) and self.shortened
            self.shortened += note.endswith(SHORTENED)
            (self.said if again else self.notes).append(line)

    def remark(self, words: Mapping[str, str], system: System) -> None:
        """Note what is found at places, {place: note}, in the step accepted last."""
        for place, note in words.items():
            self.remarked[place] = [note]
            self.notes.append(f"step {len(self.residuals)} to t = {system.state.t:.6g}: {note}")

    def remark_again(self, key: str, note: str, short: str, system: System) -> None:
        """Note what is found in the step accepted last, the first time with the note; later ones are counted, and the log
        has them in short."""
        steps = self.remarked.setdefault(key, [])
        steps.append(str(len(self.residuals)))
        line = f"step {steps[-1]} to t = {system.state.t:.6g}: "
        if len(steps) == 1:
            self.notes.append(line + note)
        else:
            self.said.append(line + short)

    def stop(self, finding: Finding, t: float, step: int | None = None) -> None:
        """Not converged: the step to t failed for good; step: its number, by default that after the accepted ones."""
        self.converged, self.step = False, step or len(self.residuals) + 1
        self.kind, reason, self.place, self.remedy = finding
        where = f", {self.place}" if self.place else ""
        self.reason = f"step {self.step} to t = {t:.6g}: {self.kind}{where}: {reason}"
        self.reason += f"; {self.remedy}" if self.remedy else ""

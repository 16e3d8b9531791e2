"""How a run ended: converged, or what stopped it, where, and the change to try."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from fenics_contact.assembly.finding import COMES_IN, CONVERGED, CYCLING, MEMORY, TOO_STIFF, UNKNOWN, Finding, Remark
from fenics_contact.assembly.system import System
from fenics_contact.solvers.report import StepReport

NO_HELP = (MEMORY, TOO_STIFF)  # kinds of failure that springs, multipliers or another way to the solution do not mend
SHORTENED, JUMPED, SPRUNG = "increments shortened", "with loads and drives held", "soft springs did"  # words of notes
# Kinds of notes that steps have in common, by words of theirs: the first is a note, and how many more there are another one
ALIKE = {SHORTENED: SHORTENED, JUMPED: "the state jumped", SPRUNG: "soft springs held what nothing else did"}
# Words of notes on what was overcome, of which nothing is in the result: they come last
OVERCOME = (" cut back: ", " nothing in the result: ", "to which the result belongs", SHORTENED)
OVERLAPS = "bodies in bodies"  # by which is remembered what has been said of bodies that lie in each other
APART = "state the contact without which bodies lie in each other, as the note on that says,"  # before anything else
GREW = 1.5  # times what was said of a term first: what is worse later is worth a note at the end
# Kinds of failure in the words of cut-backs, where what they name may yet be in the result, found in shorter steps
ON_THE_WAY = {COMES_IN: "a fluid came further in than one step could follow"}
LEFT = re.compile(r"\S+ of the force")  # the figure in a reason, another one at each failure


class StepFailed(RuntimeError):
    """A step did not converge; the message says why, and `finding` what is known of the cause; left: share of the force out
    of balance in the end, where that is known, else all of it."""

    def __init__(self, reason: str, kind: str = UNKNOWN, place: str = "", remedy: str = "", *, left: float = 1.0) -> None:
        super().__init__(reason)
        self.finding, self.left = Finding(kind, reason, place, remedy), left

    @classmethod
    def of(cls, finding: Finding) -> "StepFailed":
        return cls(finding.reason, finding.kind, finding.place, finding.remedy)


def _overcome(note: str) -> bool:
    return any(words in note for words in OVERCOME)


@dataclass
class Verdict:
    """How a run ended.

    kind, reason, place, remedy: what stopped it, in words; t: load parameter reached; step: number of the step that failed,
    0 if none did; cuts, iterations, corrections, augmentations: cut-backs, tangents, solves with an old one's
    factorisation, and updates of multipliers; residuals: per accepted step, the out-of-balance share after each solve;
    notes: what was resolved on the way; causes: number of cut-backs by what failed; said: a line for each that the log has
    not had yet; remarked: by name or place of terms and bodies and by kind what has been said of them: its size, the
    greatest one since, and the note on that; common: by kind of notes that steps have in common, how many, the last of
    them, and size and step of the greatest; resumed: numbers of the last steps before the run was killed and gone on with;
    smallest: step [t] below which none is tried; longest: largest step [t] to try next, endless while no step failed;
    stood_in: steps accepted in which the direct linear solver stood in for one that stalls, less those without, see Stalls.
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
    said: list[str] = field(default_factory=list, repr=False)
    remarked: dict[str, dict[str, tuple[float, float, str]]] = field(default_factory=dict, repr=False)
    common: dict[str, tuple[int, str, float, str]] = field(default_factory=dict, repr=False)
    resumed: list[int] = field(default_factory=list, repr=False)
    smallest: float = field(default=0.0, repr=False)
    stood_in: int = field(default=0, repr=False)
    longest: float = field(default=math.inf, repr=False)

    def __str__(self) -> str:
        """How the run ended, what it took, and its notes, a line each."""
        took = [(len(self.residuals), "step"), (self.iterations, "tangent"), (self.corrections, "correction")]
        took += [(self.augmentations, "multiplier update"), (self.cuts, "cut-back")]
        counts = [f"{count} {what}{'s' * (count != 1)}" for count, what in took if count or what in ("step", "tangent")]
        lines = [f"{self.reason} (t = {self.t:.6g}: {', '.join(counts)})", *(f"note: {note}" for note in self.notes)]
        return "\n".join(lines)

    def cut(self, failure: StepFailed, what: str) -> None:
        """A step or an arc, `what`, has failed and is tried shorter."""
        kind, reason, place, _ = failure.finding
        cause = LEFT.sub("part of the force", reason) if kind == UNKNOWN else kind
        self.cuts += 1
        self.causes[cause] = self.causes.get(cause, 0) + 1
        line = f"{what} cut back: {reason}, {place}" if place else f"{what} cut back: {reason}"
        if kind == CYCLING and not any(" cut back: " in note for note in self.notes):
            self.notes.append(line)  # the first one: the log has the others
        else:
            self.said.append(line)

    def last_notes(self) -> list[str]:
        """Notes at a run's end: on where it was worse than a note had said, on how many steps were like one that a note is
        on, and on why steps were cut back."""
        remarks = [one for kinds in self.remarked.values() for one in kinds.values()]
        notes = [worse for first, most, worse in remarks if most > GREW * first]
        for kind, (count, step, size, where) in self.common.items():
            if more := count - 1:
                worst = f", by {size:.3g} at most in {where}" if size > 0.0 else ""
                notes.append(f"{more} more step{'s' * (more > 1)}, the last one {step}: {kind}{worst}")
        if not self.causes:
            return notes
        most = sorted(self.causes.items(), key=lambda cause: -cause[1])
        times = "cut-back, which leaves" if self.cuts == 1 else "cut-backs, which leave"
        why = ", ".join(f"{ON_THE_WAY.get(cause, cause)} ({count} of {self.cuts})" for cause, count in most)
        return [*notes, f"{self.cuts} {times} nothing in the result: {why}"]

    def order(self) -> None:
        """Put the notes on what changes the result before those on what was overcome."""
        self.notes.sort(key=_overcome)

    @property
    def doubts(self) -> list[str]:
        """The notes on what changes the result, without those on what was overcome."""
        return [note for note in self.notes if not _overcome(note)]

    def accept(self, report: StepReport, system: System) -> None:
        """A step has been accepted, which took what its report says; terms may remark on the state. Collective."""
        self.t = system.state.t
        self.iterations += report.iterations
        self.corrections += report.corrections
        self.augmentations += report.augmentations
        self.residuals.append(report.residuals)
        for note in report.done:
            self.note(note, next((kind for words, kind in ALIKE.items() if words in note), ""), report.way)
        for note, (kind, size) in report.left.items():
            self.note(note, kind, size)
        for term in system.terms:
            self.remark_on(term.name, term.findings.remarks(system.state, system.scales.noise))

    def remark_on(self, name: str, remarks: Mapping[str, Remark]) -> None:
        """Note what is to be said of a term, or of all bodies, by kind, in the step accepted last: of each kind the first
        time; where it is worst is noted at the end."""
        said = self.remarked.setdefault(name, {})
        for kind, (size, text) in remarks.items():
            first, most, worse = said.get(kind, (0.0, 0.0, ""))
            if kind not in said:
                self.note(text)
                first = most = float(size)
            elif size > most:
                most, worse = float(size), f"{self._step}, where this is worst: {text}"
            said[kind] = first, most, worse

    @property
    def _step(self) -> str:
        """The step accepted last, in words."""
        return f"step {len(self.residuals)} to t = {self.t:.6g}"

    def note(self, words: str, kind: str = "", size: float = 0.0) -> None:
        """Note what was found in the step accepted last; of a kind once: what is more of it is counted, and in the log.
        size: of it [length], to tell where it is greatest."""
        count, _, most, where = self.common.get(kind, (0, "", 0.0, ""))
        if kind:
            most, where = (size, self._step) if size > most else (most, where)
            self.common[kind] = count + 1, self._step, most, where
        (self.said if count else self.notes).append(f"{self._step}: {words}")

    def log(self, words: str) -> None:
        """A line of the log, and no note, on the step accepted last."""
        self.said.append(f"{self._step}: {words}")

    def remark(self, words: Mapping[str, str]) -> None:
        """Note what is found at places, {place: note}, in the step accepted last."""
        for place, note in words.items():
            self.remarked[place] = {}
            self.note(note)

    def stop(self, finding: Finding, t: float, step: int | None = None) -> None:
        """Not converged: the step to t failed for good; step: its number, by default that after the accepted ones."""
        self.converged, self.step = False, step or len(self.residuals) + 1
        self.kind, reason, self.place, self.remedy = finding
        if self.remarked.get(OVERLAPS) and self.kind in (CYCLING, UNKNOWN):  # no step is short enough for that
            self.remedy = " or ".join(filter(None, [APART, self.remedy]))
        where = f", {self.place}" if self.place else ""
        self.reason = f"step {self.step} to t = {t:.6g}: {self.kind}{where}: {reason}"
        self.reason += f"; {self.remedy}" if self.remedy else ""

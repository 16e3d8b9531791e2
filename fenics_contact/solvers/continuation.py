"""Continuation along an equilibrium path: length of the arcs, limit points located, legs that end on targets."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.exchange import copy_to_ghosts
from fenics_contact.assembly.finding import LIMIT_POINT, OUT_OF_STEPS, Finding
from fenics_contact.assembly.system import System
from fenics_contact.solvers.arc_length import Arc, ArcLength, ArcReport, Increment, OffThePath
from fenics_contact.solvers.control import OnStep
from fenics_contact.solvers.course import ArcSteps, Fork, Leg, Route
from fenics_contact.solvers.diagnosis import diagnose
from fenics_contact.solvers.locating import Arrival, Sought, located
from fenics_contact.solvers.motions import Drift, resistance, softest
from fenics_contact.solvers.report import StepperTo
from fenics_contact.solvers.retraced import Retraced
from fenics_contact.solvers.verdict import StepFailed, Verdict
from fenics_contact.types import Floats

# Of the longest way so far: how far along the arc a located limit point may lie from the extremum. The load alone would not
# do: it is stationary there, so that displacements a thousand times farther off have the same one.
LIMIT_TOLERANCE = 1e-6
FLAT = 1e-2  # of the load's change per arc before: beyond a kink it falls by more, and arcs may end elsewhere on the path
TARGET_TOLERANCE = 1e-6  # of the largest distance to the target seen: how close the run must land on it

# Of the stiffest node's resistance (the root of round-off), and times what the softest motion may still resist where a
# bifurcation counts as located: motions that differ by far less are as soft, and round-off alone tells them apart
ALIKE, WITHIN = 1e-8, 100.0
AWAY = 1e-2  # of the bodies' size: the first arc on another path, where that is no longer lost in round-off
BACK = 0.99  # cosine of the angle to straight back, from which on a step is on the path so far
TURNED = "the load has turned within this step, where points close or let go and the path leads nearly straight back: "
TURNED += "its limit is not located, arcs keep on from here"
LEAVES = 0.5  # of the first arc on another path: less along the null vector, and it leads on or back on the path so far


class Path:
    """Continuation of a system: accepted steps, limit points located, each leg's end on one of its targets.

    arc: ArcLength; stepper: it, with what corrects its states; steps: ArcSteps; course: where to.
    """

    def __init__(
        self,
        system: System,
        arc: ArcLength,
        stepper: StepperTo[Arc, ArcReport],
        steps: ArcSteps,
        course: Route,
    ) -> None:
        self.system, self.arc, self.stepper, self.steps = system, arc, stepper, steps
        self.legs, self.stations, self.fork = course
        # negative pivots at the last accepted state that is no limit point, and the sign of the load's change there
        self.negative, self.side = np.nan, 0.0
        self.bifurcations = 0  # passed so far
        self.branched = False  # whether one lies in the last step
        self.curve = Retraced(system)  # where this leg has been
        self.failures: list[StepFailed] = []  # of the step that is on
        self.reached: list[str] = []  # the targets that ended the legs so far, in words
        self.begun = False  # whether a step of the present leg has been accepted
        self.highest = self.furthest = 0.0  # largest load [t] and way [length] from the start of the path accepted
        self.taken = 0  # steps accepted
        # increment of the last accepted step, unit rate of the path at its end
        self.last: Increment | None = None
        self.rate: Increment | None = None
        self.gone: Increment | None = None  # the way from the start of the path
        self.slope = 0.0  # change of t along the path there; its sign counts
        self.first = self.length = 0.0  # arcs [length]: the leg's first one, the one to try next
        self.spans: dict[str, float] = {}  # largest distance seen in this leg from each of its targets

    def follow(self, on_step: OnStep, verdict: Verdict) -> None:
        """Continue from the accepted state until the last leg has reached a target; the verdict says whether it did.

        on_step(report, seconds, True): called after each accepted step, on all ranks.
        """
        self.verdict, verdict.converged = verdict, False
        try:
            while not self.ended:
                self._follow_leg(on_step)
        except StepFailed as failure:
            found, t = cause(self.system, failure, self.failures), self.system.state.t
            # neither springs nor damping go with arcs: where a remedy is one of them it is to be taken in load steps
            verdict.stop(found._replace(remedy=found.remedy.replace("solve(...", "solve(..., steps=20")), t)
        else:
            verdict.converged, verdict.reason = True, "reached " + ", then ".join(self.reached)
            if self.fork and self.bifurcations < self.fork.number:
                met = f"bifurcation {self.fork.number} has not been met, but {self.bifurcations}"
                verdict.note(f"the branch has not been taken: {met}; go farther, or keep the arcs shorter, largest=")

    def _follow_leg(self, on_step: OnStep) -> None:
        """Continue, after a first leg turning round, until a target is reached. StepFailed where there is no way."""
        if not self.begun:
            self.rate = self.arc.start(self.system, self.last)
            self.slope, self.spans = self.rate.dt, {}
            self.negative, self.side = self._pivots(), self.rate.dt
            first = self.steps.first * self.system.stages.duration
            self.first = self.length = min(first / abs(self.rate.dt), self.steps.largest)
        leg = self.legs[len(self.reached)]
        self._measure(leg)
        while self.taken < self.steps.most:
            start = time.perf_counter()
            arrival, reached = self._take(self.steps.smallest * self.first)
            self._accept(arrival, leg, reached)
            on_step(arrival.report, time.perf_counter() - start, True)
            if reached in leg:
                return
        why = f"{self.taken} steps reached none of: {', '.join(leg)}"
        raise StepFailed(why, OUT_OF_STEPS, remedy="allow more steps, ArcSteps(most=...), or longer ones")

    # -- what a checkpoint holds beside the accepted state ----------------------------------------------------------
    def memory(self) -> tuple[dict[str, Floats], dict[str, Any]]:
        """(fields, numbers) of the way so far: last increment, the path's rate, lengths, the place among the legs."""
        kept = ("last", self.last), ("rate", self.rate), ("gone", self.gone)
        parts = {name: part for name, part in kept if part is not None}
        names = "reached begun highest furthest taken slope first length spans negative side bifurcations branched".split()
        numbers = {name: getattr(self, name) for name in names} | {"per_load": self.arc.per_load, "curve": self.curve.points}
        numbers |= {name: [part.dq.tolist(), part.dt] for name, part in parts.items()}
        return {name: part.du.array_r for name, part in parts.items()}, numbers

    def recall(self, fields: dict[str, Floats], numbers: dict[str, Any]) -> None:
        """Go on from there. A leg that has ended goes on where its target is another one now, unless the next has begun.

        ValueError, on all ranks, where the legs now stated cannot lead there.
        """
        numbers = dict(numbers)
        self.arc.per_load, self.curve.points = numbers.pop("per_load"), numbers.pop("curve", [])
        for name, values in fields.items():
            du, (dq, dt) = self.system.new_vector(), numbers.pop(name)
            du.array[:] = values[: len(du.array_r)]
            copy_to_ghosts(du)
            setattr(self, name, Increment(du, np.array(dq).reshape(-1, 6), dt))
        vars(self).update(numbers)
        self.length = min(self.length, self.steps.largest)
        known = [name in leg for name, leg in zip(self.reached, self.legs, strict=False)]
        if known and not known[-1] and not self.begun and len(known) == len(self.reached):
            self.reached.pop()
            self.begun = known[-1] = True
        if not all(known) or len(self.reached) + self.begun > len(self.legs):
            raise ValueError(f"it has gone beyond {', then '.join(self.reached)}, which until and back do not name so")
        self.system.assemble_tangent()  # a term may predict from the last one

    @property
    def ended(self) -> bool:
        """Whether the last leg has reached a target."""
        return len(self.reached) == len(self.legs)

    @property
    def _load(self) -> float:
        """How far [t] the load is from where the path began."""
        return abs(self.system.state.t - self.system.stages.start.t)

    @property
    def _going(self) -> Increment:
        """The path's rate, which a leg has from its beginning."""
        if self.rate is None:
            raise ValueError("this path has not begun")
        return self.rate

    def _take(self, smallest: float) -> tuple[Arrival, str | None]:
        """A step of the length that is due or, where that fails, of a half of it, and so on."""
        self.failures = []
        while True:
            try:
                return self._step(self.length, self._going)
            except StepFailed as failure:
                self._back()
                self.failures.append(failure)
                if self.length / 2 < smallest:
                    raise
                self.verdict.cut(failure, f"arc of {self.length:.3g}")
                self.length /= 2

    def _back(self) -> None:
        """To the accepted state, tangent included: a term may predict from its last tangent."""
        self.system.trail.rollback()
        self.system.assemble_tangent()

    def _step(self, length: float, rate: Increment) -> tuple[Arrival, str | None]:
        """The next state, not yet accepted, and the name of the target reached, if any; StepFailed if there is none."""
        arrival = self._arrive(length, rate)
        turned = arrival.rate.dt * self.slope < 0.0 and self.slope * self.side < 0.0
        if turned and (arrival.report.negative - self.negative) % 2 == 1.0:
            # a limit point begins this step, and a kink may hide it from angles: behind it pivots have turned, and the load
            arrival.rate = arrival.rate.times(-1.0)
        self._refuse_back(arrival, rate)
        if self.fork and self.bifurcations + 1 == self.fork.number and self._passed(arrival):
            arrival = self._bifurcation(arrival, rate, self.fork)
            if all(gap() * self.gaps[name] > 0.0 for name, gap in self.targets.items()):
                return arrival, None  # no target lies before it
        self._onward = arrival.rate.dt
        if arrival.rate.dt * self.slope < 0.0:
            side, bound = self.slope, LIMIT_TOLERANCE * max(self.furthest, arrival.length)
            ends = lambda dt, left: left <= bound and dt / side > -FLAT  # noqa: E731
            arrival = self._locate(rate, arrival, side, Sought(lambda a: a.rate.dt, ends, 0.5 * bound))
            arrival.report.limit_point = int(np.sign(side))
        reached = None
        for name, gap in self.targets.items():
            before, now = self.gaps[name], gap()
            if now * before < 0.0 or now == 0.0:
                near = TARGET_TOLERANCE * max(self.spans[name], abs(now))
                arrival = self._locate(rate, arrival, before, Sought(_on_arrival(gap), _within(near)))
                reached = name
        arrival.report.station = 1 + list(self.stations).index(reached) if reached in self.stations else 0
        return arrival, reached

    def _refuse_back(self, arrival: Arrival, rate: Increment) -> None:
        """StepFailed where an arc from a bifurcation, along its null vector, does not leave the path so far, or where one
        goes back on that: against the last step, with a load that turns, and with no pivot for that, or straight back,
        unless pivots have turned with the load in both steps: at a kink a path may do so. The curve so far tells the rest.
        """
        if self.begun and self.slope == 0.0:
            if self.arc.dot(arrival.increment, rate) < LEAVES * self.arc.norm(arrival.increment):
                raise OffThePath("the arc does not lead along the branch")
            return
        if not (self.begun and self.last):
            return
        onwards = self.arc.dot(arrival.increment, self.last) / (self.arc.norm(arrival.increment) * self.arc.norm(self.last))
        known, passed = not np.isnan(arrival.report.negative - self.negative), self._passed(arrival)
        turns = passed and arrival.rate.dt * self.side < 0.0
        if (onwards < -BACK and (passed or self.branched or not known)) or (turns and onwards < 0.0):
            raise OffThePath("the arc leads back along the path")
        if ago := self.curve.led_back(arrival.report.negative, self.arc.per_load or 0.0, self.steps.turn):
            raise OffThePath(f"the arc leads back along the path, to where it was {ago} steps ago")

    def _accept(self, arrival: Arrival, leg: Leg, reached: str | None) -> None:
        """Commit the arrival; direction and length of the next step follow from it."""
        self.system.trail.commit()
        if _load_turned(self, arrival):
            arrival.rate = arrival.rate.times(-1.0)
            arrival.report.notes.append(TURNED)
        self.curve.add(arrival.report.negative, not self.begun)
        # a located limit point lies a hair before or behind the extremum: its own sign says nothing
        self.slope = self._onward if arrival.report.limit_point else arrival.rate.dt
        self._look(arrival)
        if self.gone is None:
            self.gone = arrival.increment.times(0.0)
        self.gone.add(arrival.increment)
        self.highest = max(self.highest, self._load)
        self.furthest = max(self.furthest, self.system.length(self.gone.du, self.gone.dq))
        self.taken += 1
        self._measure(leg)
        self.verdict.accept(arrival.report, self.system)
        self.arc.linear.stalls.accepted(self.verdict)
        turned = np.arccos(np.clip(self.arc.dot(self._going, arrival.rate), -1.0, 1.0))
        length = min(self.length * _growth(self.steps, arrival.solves, turned), self.steps.largest)
        self.arc.weigh(self.furthest, self.highest)
        size = self.arc.norm(arrival.rate)  # 1 in the lengths before
        self.length, self.rate, self.last = length * size, arrival.rate.times(1.0 / size), arrival.increment
        if arrival.fork:
            self.rate, self.slope, self.negative = arrival.fork, 0.0, np.nan
            self.length = min(AWAY * self.system.extent, self.steps.largest)
            self.rate = self.rate.times(1.0 / self.arc.norm(self.rate))
        self.begun = reached not in leg
        self.reached += [] if self.begun or reached is None else [reached]

    def _measure(self, leg: Leg) -> None:
        self.targets = self.stations | leg  # where both name one place the leg ends there
        self.gaps = {name: gap() for name, gap in self.targets.items()}
        self.spans = {name: max(self.spans.get(name, 0.0), abs(gap)) for name, gap in self.gaps.items()}
        for name, gap in self.gaps.items():  # a step has landed there: the next one only leaves it
            self.gaps[name] = 0.0 if abs(gap) <= TARGET_TOLERANCE * self.spans[name] else gap

    def _arrive(self, length: float, rate: Increment, near: Increment | None = None) -> Arrival:
        arc = Arc(length, rate, self.negative, self.side, near)
        report = self.stepper.step(self.system, arc)
        if wrong := self.system.acceptance.objection():
            raise StepFailed.of(wrong)
        solves = len(report.residuals) / (1 + report.augmentations + report.raises)
        arrival = Arrival(length, self.arc.made(self.system), self.arc.rate_along(self.system, arc), report, solves)
        report.negative = self._pivots()
        return arrival

    def _locate(self, rate: Increment, arrival: Arrival, first: float, sought: Sought) -> Arrival:
        """The arrival within this step where a value vanishes, see `located`."""

        def arrive(length: float, near: Increment | None) -> Arrival:
            self._back()
            return self._arrive(length, rate, near)

        if self.system.condensed:  # its unknowns follow the accepted state's tangent
            sought = sought._replace(afresh=True)
        return located(arrive, arrival, (first, rate), sought, self.arc.dot)

    # -- bifurcations -----------------------------------------------------------------------------------------------
    def _pivots(self) -> float:
        """Negative pivots of the last tangent, see `LinearSolver.count_negative`; NaN: not known. Collective."""
        found = self.arc.linear.count_negative(self.negative)
        return np.nan if found is None else float(found)

    def _passed(self, arrival: Arrival) -> bool:
        """Whether a bifurcation lies between the last accepted state and an arrival: pivots that change their sign, beyond
        the one which a limit point takes along as the load turns."""
        change = abs(arrival.report.negative - self.negative)
        turns = arrival.rate.dt * self.side < 0.0
        return not np.isnan(change) and change != float(turns)

    def _look(self, arrival: Arrival) -> None:
        """Note a bifurcation that the accepted arrival has passed or is on."""
        report = arrival.report
        if report.limit_point:
            return  # a hair before or behind it: its pivots say nothing
        self.branched = bool(arrival.fork) or self._passed(arrival)
        if self.branched:
            self.bifurcations += 1
            report.bifurcation, t = 1, self.system.state.t
            if arrival.fork:
                report.notes.append(f"a bifurcation at t = {t:.6g}, from which the path is to go on along another branch")
            else:
                before = f"{self.negative:g}" if self.negative else "none"
                report.notes.append(
                    f"a bifurcation within this step, where other paths branch off: the tangent has {report.negative:g} "
                    f"negative pivots, {before} in the step before; follow a branch by ArcSteps(branch=Branch(...))"
                )
        self.negative, self.side = report.negative, arrival.rate.dt

    def _bifurcation(self, arrival: Arrival, rate: Increment, fork: Fork) -> Arrival:
        """The arrival at a bifurcation that lies within this step, with the null vector on which the path is to go on."""

        def soft(alike: float = 0.0) -> Drift:
            self.system.assemble_tangent()
            mode = softest(self.system, fork.dofs, alike)
            if mode is None:
                raise StepFailed("no motion is softest at a bifurcation")
            return mode

        def stiffness(at: Arrival) -> float:
            """What the softest motion resists, below zero behind the bifurcation."""
            mode = soft()
            resists = abs(mode.dot(resistance(self.system, mode, self.system.matrix)))
            return -resists if self._passed(at) else resists

        far = abs(stiffness(arrival))
        found = Sought(stiffness, lambda left, _: abs(left) <= LIMIT_TOLERANCE * far, afresh=True)
        arrival = self._locate(rate, arrival, far, found)
        largest = self.system.matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY)
        mode = soft(max(ALIKE * largest, WITHIN * LIMIT_TOLERANCE * far))
        along = self.system.comm.allreduce(float(mode.du.array_r[fork.dofs].sum()))
        arrival.fork = Increment(mode.du, mode.dq, 0.0).times(np.copysign(1.0, along * fork.towards))
        return arrival


def _load_turned(path: Path, arrival: Arrival) -> bool:
    """Whether the load has turned within a step, just accepted, that seems to go on past a bifurcation. Collective.

    Where a point closes or lets go a path may turn straight back, and at its smaller angle it then seems to go on. So an arc
    as long as the step is led against that: behind a bifurcation it comes to where the step began, to the pivots from
    before; behind a kink these are beyond it, and pivots stay.
    """
    now, before = arrival.report.negative, (path.negative, path.side)
    if arrival.fork or arrival.report.limit_point or not path._passed(arrival) or (now - path.negative) % 2 == 0.0:
        return False
    rate = arrival.rate.times(-1.0)
    path.negative, path.side = now, rate.dt
    try:
        there = path._arrive(arrival.length, rate).report.negative
    except StepFailed:
        there = np.nan
    path.negative, path.side = before
    path._back()
    path.system.assemble_residual()  # whose reactions are those of the step
    return bool((there - now) % 2 == 0.0)


def cause(system: System, failure: StepFailed, failures: list[StepFailed]) -> Finding:
    """What has stopped a continuation: the last one of the failures of a step. Collective.

    A limit point is no news to it: where arcs have missed the path they were too long for its turn. Where none has, what
    kept them from their balance is the cause.
    """
    found = diagnose(system, failure)
    if found.kind != LIMIT_POINT:
        return found
    if not system.contact_terms or any(isinstance(one, OffThePath) for one in failures):
        return found._replace(remedy="keep the arcs shorter: ArcSteps(first=..., largest=...)")
    known, ways = failure.finding, []
    for contact in system.contact_terms:
        most = max(system.comm.allgather(contact.trial.law.eps_n.max(initial=0.0)))
        ways.append(f"penalty= of contact '{contact.name}' far below {most:.3g}")
    softer = f"let points open and close more smoothly: {', '.join(ways)}"
    place = known.place or found.place
    return Finding(known.kind, f"{known.reason}; {found.reason}", place, known.remedy or softer)


def _growth(steps: ArcSteps, solves: float, turned: float) -> float:
    """Change of the arc length: longer after few tangent solves (Ramm 1981), shorter where the path turns, in bounds."""
    ratio = min(steps.iterations / solves, steps.turn / max(turned, 1e-12))
    return float(np.clip(np.sqrt(ratio), 0.5, 2.0))


def _on_arrival(gap: Callable[[], float]) -> Callable[[Arrival], float]:
    """The distance from a target, asked for in the state of an arrival."""
    return lambda arrival: gap()


def _within(near: float) -> Callable[[float, float], bool]:
    """Whether a distance is small, whatever the arc left."""
    return lambda distance, width: abs(distance) <= near

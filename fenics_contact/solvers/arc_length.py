"""One step of arc length: the load parameter t is an unknown too, so that a path can pass its limit points.

The step keeps a length ds of the increment (du, dq, dt) of displacements, tools' coordinates and load fixed:

    ds^2 = |du|^2 / nodes + |dq|^2 + (L dt)^2

the spherical constraint of Crisfield (1981, doi:10.1016/0045-7949(81)90108-5). L, the largest displacement over the largest
load so far and at first their rate, makes the path's extent in load and in displacement the same: an arc meets limit points
of either kind, and corners of the load-displacement diagram show.
"""

from dataclasses import dataclass

import numpy as np

from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.solvers.linear import LinearSolver, Side
from fenics_contact.solvers.out_of_balance import (
    HELD,
    balanced,
    finite_residual,
    forcing,
    relative_residual,
    upright,
)
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.reuse import TIGHTEST
from fenics_contact.solvers.shortening import SHORTEST
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Floats, Vec

# Change of t over which loads are differenced: exact for ramps at any size, for other functions good to Newton's need.
LOAD_PROBE = 1e-4
BEYOND = 5  # solves of an arc from which on pivots alone say whether the load turns
FINITE = float(np.finfo(float).max)  # an out-of-balance force that any other is less than, but that of elements inside out


class OffThePath(StepFailed):
    """An arc has met no state on the way onward: the path turns by more than so long an arc can follow."""


@dataclass
class ArcReport(StepReport):
    """A step's tangent solves and residuals; limit_point: 1 where it ends on a maximum of t, -1 on a minimum, else 0;
    station: number, from 1, of the station that it ends on, else 0; negative: pivots of the tangent at its end, see
    LinearSolver, NaN where they are not known; bifurcation: 1 where one was passed in it or it ends on one, else 0."""

    limit_point: int = 0
    station: int = 0
    negative: float = np.nan
    bifurcation: int = 0


@dataclass
class Increment:
    """Part of a path: du (PETSc Vec, owned part) and dq (tools, 6) [length], dt."""

    du: Vec
    dq: Floats
    dt: float

    def add(self, other: "Increment", share: float = 1.0) -> None:
        self.du.axpy(share, other.du)
        self.dq = self.dq + share * other.dq
        self.dt += share * other.dt

    def times(self, share: float) -> "Increment":
        out = Increment(self.du.copy(), share * self.dq, share * self.dt)
        out.du.scale(share)
        return out


@dataclass(frozen=True)
class Arc:
    """Where a step is to end: at this length from the last accepted state, first along the unit rate of the path there, or
    as far as `near`, where a state near its end is known; negative: pivots of the tangent there, NaN: not known, and side:
    the sign of the load's change."""

    length: float
    rate: Increment
    negative: float = np.nan
    side: float = 0.0
    near: Increment | None = None


class ArcLength:
    """Newton's method on the equilibrium and the arc together.

    tolerance: out-of-balance force over the largest force seen, as in Newton; limit: largest number of tangent solves.
    """

    def __init__(self, linear: LinearSolver, tolerance: float = TOLERANCE, limit: int = 15) -> None:
        self.linear, self.tolerance, self.limit = linear, tolerance, limit
        self.per_load: float | None = None  # L [length]

    # -- lengths --------------------------------------------------------------------------------------------------
    def dot(self, a: Increment, b: Increment) -> float:
        """Inner product of two increments [length^2]."""
        nodes = a.du.getSize() / 3
        return a.du.dot(b.du) / nodes + float(np.sum(a.dq * b.dq)) + (self.per_load or 0.0) ** 2 * a.dt * b.dt

    def norm(self, a: Increment) -> float:
        return float(np.sqrt(self.dot(a, a)))

    def weigh(self, moved: float, load: float) -> None:
        """Give load and displacement the same extent: `moved` [length] stands for a change of the load by `load`."""
        self.per_load = moved / abs(load)

    # -- the path's rate ------------------------------------------------------------------------------------------
    def start(self, system: System, last: Increment | None = None) -> Increment:
        """Unit rate of the path at an accepted state: t growing, or, where a last increment is given, back along it."""
        rate = self._raw_rate(system, self._load_side(system)[0])
        if self.per_load is None:
            self.per_load = 0.0
            if not (moved := self.norm(rate)) > 0.0:
                raise StepFailed("the load moves nothing at the start of the path")
            self.weigh(moved, 1.0)
        onward = 1.0 if last is None else -np.sign(self.dot(rate, last))
        return rate.times(onward / self.norm(rate))

    def _raw_rate(self, system: System, side: Side) -> Increment:
        system.assemble_tangent()
        ((du, dq),) = self.linear.solve_sides([side], TIGHTEST)
        return Increment(du, dq, 1.0)

    def _load_side(self, system: System) -> tuple[Side, float]:
        """Right-hand side of the load's rate (dR/dt and the rates of supports and tools), and the out-of-balance share.

        Leaves the residual of the state itself assembled.
        """
        t = system.state.t
        system.begin_step(t + LOAD_PROBE)
        system.assemble_residual()
        rate, tool_rate = system.residual_vector.copy(), system.tool_residual
        system.begin_step(t)
        size = relative_residual(system)
        rate.axpy(-1.0, system.residual_vector)
        rate.scale(1.0 / LOAD_PROBE)
        tool_rate = np.divide(tool_rate - system.tool_residual, LOAD_PROBE)
        supports, moved = (
            np.divide(values(t + LOAD_PROBE) - values(t - LOAD_PROBE), 2 * LOAD_PROBE)
            for values in (system.places, system.tools.prescribed)
        )
        return (rate, tool_rate, supports, moved), size

    # -- one step -------------------------------------------------------------------------------------------------
    def step(self, system: System, arc: Arc) -> ArcReport:
        """Carry the system from its committed state along an Arc; ArcReport, or StepFailed if it does not get there."""
        _advance(system, arc.near.times(1.0) if arc.near else arc.rate.times(arc.length))
        return self._balance(system, arc, True)

    def settle(self, system: System, arc: Arc) -> ArcReport:
        """Into balance on the Arc from the present state, e.g. after its multipliers have changed: with the arc held there
        is a balance also where a given load has none."""
        return self._balance(system, arc, False)

    settle_near = settle

    def _balance(self, system: System, arc: Arc, resample: bool) -> ArcReport:
        """resample: have samples follow the surfaces once. While the out-of-balance force is large, contact pressures are
        foreseen as in Newton's steps: straight on along its rate, a path beside a curved tool touches nothing."""
        # at least once what points are held by is let go, and what a state nearby left out of balance
        report, foresight, least = ArcReport(), system.foresight, 1 if resample and not arc.near else 2
        before = relative_residual(system, followed=True)
        while True:
            side, size = self._load_side(system)
            report.iterations += 1
            report.residuals.append(size)
            if foreseen := size > HELD:
                foresight.foresee(system.state)
            anew, resample = resample and foresight.resample(system.state), False
            if balanced(system, size, self.tolerance) and not anew and report.iterations >= least:
                return report
            if report.iterations >= self.limit:
                raise StepFailed(f"{self.limit} iterations left {size:.1e} of the force out of balance")
            if foreseen or anew:
                system.assemble_residual()
            late = report.iterations > BEYOND
            made = _advance(system, self._correction(system, side, arc, forcing(size, self.tolerance), late))
            foresight.release()
            before = _shorten(system, made, FINITE if foresight.settles else before)

    def made(self, system: System) -> Increment:
        """Increment from the last accepted state to the present one."""
        last, state, du = system.trail.last, system.state, system.new_vector()
        du.array[:] = (state.u.x.array - last.u)[: du.getLocalSize()]
        return Increment(du, state.q - last.q, state.t - last.t)

    def rate_along(self, system: System, arc: Arc) -> Increment:
        """Unit rate of the path at a converged state, pointing the way it was reached along an Arc."""
        rate = self._raw_rate(system, self._load_side(system)[0])
        return rate.times(np.copysign(1.0 / self.norm(rate), self._onward(rate, self.made(system), arc)))

    def _onward(self, rate: Increment, made: Increment, arc: Arc) -> float:
        """Whether a path made so far goes on along its rate, t growing, or against it: a number of that sign.

        It goes on at the smaller angle. Where a part slips over an edge the load falls at once by more than the way goes on,
        and the angle with the load is another one than without it: then the tangent decides, one of whose pivots changes
        its sign where the load turns (Crisfield 1981).
        """
        angle, moved = self.dot(rate, made), self.dot(rate, Increment(made.du, made.dq, 0.0))
        return angle if angle * moved >= 0.0 else self._by_pivots(arc) or angle

    def _by_pivots(self, arc: Arc) -> float:
        """The load's change, a number of that sign, by the tangent's pivots; 0 where they are not known.

        Where a point closes or lets go the path may turn sharply, by more than a right angle: beyond such a kink the load
        turns if and only if a pivot has changed its sign (orientation of piecewise linear paths; Eaves & Scarf 1976,
        doi:10.1287/moor.1.1.1).
        """
        now = self.linear.negative
        if now is None or np.isnan(arc.negative):
            return 0.0
        return -arc.side if (now - arc.negative) % 2 else arc.side

    def _correction(self, system: System, side: Side, arc: Arc, tolerance: float, late: bool) -> Increment:
        """Newton's correction of the equilibrium that stays on the arc: a dt^2 + 2 b dt + c = 0. late: no point of the arc
        has been found where the path goes on at the smaller angle."""
        system.assemble_tangent()
        total = self.made(system)
        balance = (system.residual_vector, system.tool_residual, *system.still())
        (du, dq), (du_t, dq_t) = self.linear.solve_sides([balance, side], tolerance)
        rate = Increment(du_t, dq_t, 1.0)
        step = Increment(du, dq, 0.0)
        reached = total.times(1.0)
        reached.add(step)
        a, b, c = self.dot(rate, rate), self.dot(rate, reached), self.dot(reached, reached) - arc.length**2
        inside = b * b - a * c
        if not inside >= 0.0:
            raise OffThePath("the path does not meet the arc")
        # of both points on the arc the one further onward: the other turns back
        roots = (-b + np.sqrt(inside)) / a, (-b - np.sqrt(inside)) / a
        onward = (self._by_pivots(arc) if late else 0.0) or self._onward(rate, total, arc)
        step.add(rate, max(roots, key=lambda dt: dt * onward))
        return step


def _advance(system: System, increment: Increment, share: float = 1.0) -> Increment:
    """Move the state; supports and moved tools go exactly to their places at the new t. Returns the increment made.

    share: how much of the last correction the state then holds.
    """
    owed, moved = system.begin_step(system.state.t + increment.dt)
    with increment.du.localForm() as local:
        system.supports.put(local.array_w, owed)
    increment.dq = np.where(system.tools.free, increment.dq, moved)
    system.update(increment.du, increment.dq, share)
    return increment


def _shorten(system: System, made: Increment, before: float) -> float:
    """Where a correction does not lower the out-of-balance force, halve it while that helps, as in a load step.

    The next correction leads back onto the arc. Returns the share of the force left.
    """
    share, size = 1.0, finite_residual(system)
    while size > before and share > SHORTEST:
        half = _advance(system, made.times(-0.5), 0.5 * share)
        shorter = finite_residual(system)
        if shorter >= size:
            _advance(system, half.times(-1.0), share)
            break
        made.add(half)
        share, size = 0.5 * share, shorter
    return upright(size)


def depends_on_load(system: System) -> bool:
    """Whether anything changes with t in the stage that is on. Collective; leaves the system at the t where that begins."""
    t, seen = system.stages.start.t, False
    system.begin_step(t)
    system.assemble_residual()
    rest, tools = system.residual_vector.copy(), system.tool_residual
    places = system.supports.values(t), system.tools.prescribed(t)
    for other in (system.stages.time(0.5), system.stages.time(1.0)):
        system.begin_step(other)
        system.assemble_residual()
        system.residual_vector.axpy(-1.0, rest)
        change = system.residual_vector.norm() + np.abs(system.tool_residual - tools)[system.tools.free].sum()
        moved = system.supports.values(other) - places[0], system.tools.prescribed(other) - places[1]
        held = sum(float(np.abs(m).sum()) for m in moved)
        seen |= change + system.comm.allreduce(held) > 0.0
    system.begin_step(t)
    return bool(seen)

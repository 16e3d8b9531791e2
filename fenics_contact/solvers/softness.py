"""The motion that a tangent resists least, and what it says: a tool sinks in, a part is loose or topples, a path folds."""

from collections.abc import Iterator
from contextlib import nullcontext

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.blocks import insert
from fenics_contact.assembly.finding import LIMIT_POINT, RIGID_MOTION, Finding, spot
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trail import Accepted
from fenics_contact.assembly.trial import Trials
from fenics_contact.solvers.arc_length import LOAD_PROBE, ArcLength
from fenics_contact.solvers.gripping import GRIP
from fenics_contact.solvers.increment import solve_once
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.motions import Drift, resistance, rigid_motions, softest
from fenics_contact.solvers.out_of_balance import relative_residual
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Bools, Floats, Vec

LARGEST = 300_000  # unknowns up to which a factorisation for the diagnosis alone is worth its memory
# A step cut to 1e-4 of the load before a fold leaves a mode sqrt(1e-4) of its stiffness, times a factor of order one.
FOLDED = 0.1
# Lengths of the failing step, within which a fold must lie ahead to be its cause: Newton's method fails a few before it.
AHEAD = 10.0
TAKEN = 0.5  # of the bodies' largest motion: a tool that moves more takes part in it
NEAR = 1e-2  # of the load: a longer step that fails, or an iterate further out of balance, says nothing of a fold
SOLVES = 4  # within which a step that fails at a kink has crossed it
ALIKE = 0.5  # of a motion's square: what another one has of it, to count as the same with other points in contact
# Times its resistance: what stiffer penalties must make of the softest motion's, to be its cause (on balls, punches and
# blocks that sink in 30 ... 250 times)
STIFFENS = 10.0
LOOSE = 1e-9  # of what its nodes resist each alone: round-off, and what softest() adds, are a thousandth of it
RIGID = 0.99  # share of a motion's square that rigid motions of bodies make up, above which it is one
# The same of round bodies that roll on between walls: their own shape stays while the material goes round in it
ROLLS = 0.9
STILL = 1e-3  # of a motion: what moves supports by more is not one that they leave free
TAKES_PART = 0.1  # of the square of the bodies' motions: a body of less is not named
TIPPED = 1e-3  # of the bodies' size: what goes farther in a step of so little load has nothing to stop it
TOPPLES = 1e-3  # of what its nodes resist each alone: less holds no body upright


def soft_motion(system: System, goal: float | None = None) -> Finding | None:
    """A finding if the softest motion at the accepted state explains the failure, by what moves in it. Collective.

    goal: t at which the failing step was to end; None on an arc.
    """
    if (soft := _soft(system)) is None:
        return None
    mode, now, alone = soft
    if found := _sinking(system, now) or _loose(system, mode, now, alone):
        return found
    if system.grounding is None or not system.grounding.engaged:
        return limit_point(system, mode, now, goal)
    with system.grounding.away():  # what folds is the path without them
        soft = _soft(system)
        return limit_point(system, soft[0], soft[1], goal) if soft and not _moves_freely(system, *soft) else None


def rolling(system: System) -> str:
    """Words on the motion that the accepted state resists by less than nothing, where that is nearly a rigid one of bodies
    which their supports leave free, as of a round one between smooth walls; "" where it is not. Collective."""
    soft = _soft(system)
    if soft is None or not soft[1] < 0.0:
        return ""
    names, part, how = _rigid_part(system, soft[0])
    return f"{'body' if len(names) == 1 else 'bodies'} '{', '.join(names)}' {how}" if part > ROLLS else ""


def unresisted(system: System) -> bool:
    """Whether the accepted state leaves bodies free to move as rigid ones, as rings between smooth round tools are to turn:
    the sign of the pivot is round-off then. What that hides is told by the tangent which is left here, stiffened by as much
    as round-off may be. Collective."""
    soft = _soft(system)
    if soft is None or not abs(soft[1]) < LOOSE * soft[2] or _rigid_part(system, soft[0])[1] < RIGID:
        return False
    system.assemble_tangent()
    system.matrix.shift(LOOSE * system.matrix.getDiagonal().sum() / system.vector.getSize())
    return True


def slides_over(system: System, tool: int) -> bool:
    """Whether the motion that the accepted state resists least by itself is one of this tool over bodies that stay: at a
    limit point they give way with it. Collective."""
    with system.grounding.away() if system.grounding else nullcontext():
        soft = _soft(system)
    return soft is not None and bool(where(system, soft[0])[2] < TAKEN * np.linalg.norm(soft[0].dq[tool]))


def _soft(system: System, trials: Trials | None = None) -> tuple[Drift, float, float] | None:
    """The softest motion, what it resists, and what its nodes resist each alone; None where there is none to be had.
    Collective."""
    if system.vector.getSize() > LARGEST:
        return None
    system.assemble_tangent(trials=trials)
    diagonal = system.matrix.getDiagonal()
    mode = softest(system)
    if mode is None:
        return None
    now, alone = mode.dot(resistance(system, mode, system.matrix)), diagonal.copy()
    alone.pointwiseMult(diagonal, mode.du)
    return mode, now, max(abs(alone.dot(mode.du)), 1e-300)


# -- a penalty too soft -----------------------------------------------------------------------------------------------
def _sinking(system: System, now: float) -> Finding | None:
    """A finding if points lie deep, and the tangent would resist all motions if penalties under which they do not held the
    bodies in their place with the same forces: then it is the penalty that gives way. Collective.

    now: what the softest motion resists.
    """
    deep = [(contact, found) for contact in system.contact_terms if (found := contact.findings.deep(system.state))]
    if not deep:
        return None
    system.assemble_tangent(trials={contact: contact.penalties.holding_up(system.state) for contact, _ in deep})
    mode = softest(system)
    if mode is None or not mode.dot(resistance(system, mode, system.matrix)) > STIFFENS * abs(now):
        return None
    return deep[0][1]


# -- a part that is loose or topples ----------------------------------------------------------------------------------
def _loose(system: System, mode: Drift, now: float, alone: float) -> Finding | None:
    """A finding if a part that is not joined to the rest moves freely, or a body that contact alone holds topples."""
    if _moves_freely(system, mode, now, alone):
        name, place, _ = where(system, mode)
        text = f"a part around {place} moves without resistance: it is not joined to the rest of its body"
        remedy = "join it to the rest (fragment in the gmsh script), fix a surface of it, or close its gap to what holds it"
        remedy += "" if system.stabilised else ", also by solve(..., method=Method(stabilise=True))"
        return Finding(RIGID_MOTION, text, f"body '{name}' around {place}", remedy)
    if not now < TOPPLES * alone or not system.contact_terms:
        return None
    return _toppling(system, mode)


def _toppling(system: System, mode: Drift) -> Finding | None:
    """A finding if a motion that nothing resists is one of bodies as rigid ones. Collective."""
    names, part, how = _rigid_part(system, mode)
    if part < RIGID:
        return None
    place, these = (f"body '{names[0]}'", "it") if len(names) == 1 else (f"bodies '{', '.join(names)}'", "them")
    text = f"what touches {place} does not hold {these}: toppling, or a motion that {how}, meets hardly any resistance"
    return Finding(RIGID_MOTION, text, place, f"fix a surface, use a symmetry plane, or support {these} by another contact")


def topples_stuck(system: System) -> Finding | None:
    """A finding if bodies topple at the accepted state even if all points in contact stick: no friction holds them.
    Collective."""
    soft = _soft(system, {c: c.trial.with_friction(GRIP) for c in system.contact_terms if c.rough})
    return _toppling(system, soft[0]) if soft and soft[1] < TOPPLES * soft[2] else None


def topples_ahead(system: System, goal: float) -> Finding | None:
    """A finding if bodies topple at one of the first iterates of a step to `goal`, which goes far though it is short: in the
    accepted state more points touch than press once they tip, all of them before the first load. Collective."""
    if not system.holds.reliant or not system.contact_terms or goal - system.trail.last.t > NEAR:
        return None
    u, q, _ = system.trail.last
    found = None
    for _ in _iterates(system, goal):
        far = system.state.way_from(u, q) > TIPPED * system.extent
        soft = _soft(system) if far else None
        if soft and soft[1] < TOPPLES * soft[2] and (found := _toppling(system, soft[0])):
            break
    rolled_back(system)
    return found


def rolled_back(system: System) -> None:
    """Back to the accepted state, with its forces: the tangent of a tool that turns has those of what is tied to it.
    Collective."""
    system.trail.rollback()
    system.assemble_residual()


def _iterates(system: System, goal: float) -> Iterator[float]:
    """Take the system to the first iterates of a step to `goal`: of each the share of the force out of balance; ends where
    the next is none. Collective."""
    linear = LinearSolver(system, "direct", afresh=True)
    du, dq = system.begin_step(goal)
    system.assemble_residual()
    for _ in range(SOLVES):
        try:
            solve_once(system, linear, du, dq)
            left = relative_residual(system)
        except StepFailed:
            return
        yield left
        du, dq = np.zeros_like(du), np.zeros_like(dq)


def _moves_freely(system: System, mode: Drift, now: float, alone: float) -> bool:
    """Whether a motion is resisted by nothing since it strains nothing: at a limit point the softest one strains the bodies,
    and is resisted as little. Collective.

    now, alone: what it resists, and its nodes each alone. A part that has turned far is known by its rigid motions.
    """
    if not abs(now) < LOOSE * alone:
        return False
    return _rigid_part(system, mode)[1] >= RIGID or abs(_unloaded_stiffness(system, mode)) < LOOSE * alone


def _rigid_part(system: System, mode: Drift) -> tuple[list[str], float, str]:
    """(bodies, share, words): the bodies whose rigid motions, of those that their supports leave free, together make up this
    share of a motion's square. Collective."""
    found: dict[str, list[tuple[Vec, str]]] = {}
    for name, motion, words in rigid_motions(system):
        if not motion.dq.any():
            found.setdefault(name, []).append((motion.du, words))
    squares, ways = {}, []
    for name, parts in found.items():
        vectors = [du for du, _ in parts]  # of length 1, and nearly at right angles
        amounts, free = np.array([du.dot(mode.du) for du in vectors]), _left_free(system, vectors)
        amounts = free @ (free.T @ amounts)
        squares[name] = amounts @ amounts
        ways += [(name, abs(amount), words) for amount, (_, words) in zip(amounts, parts, strict=True)]
    total = sum(squares.values())
    names = [name for name, square in squares.items() if square > TAKES_PART * total]
    largest = max((amount for name, amount, _ in ways if name in names), default=0.0)
    how = ", ".join(dict.fromkeys(words for name, amount, words in ways if name in names and amount > 0.3 * largest))
    return names, float(total / max(mode.du.dot(mode.du), 1e-300)), how


def _left_free(system: System, vectors: list[Vec]) -> Floats:
    """Combinations (n, m), of length 1 and at right angles, of n motions which move no support. Collective."""
    held = np.array([system.supports.held(du.array_r) for du in vectors])
    sizes, axes = np.linalg.eigh(system.comm.allreduce(held @ held.T))
    largest = max(du.norm(PETSc.NormType.NORM_INFINITY) for du in vectors)
    return np.asarray(axes[:, sizes <= (STILL * largest) ** 2])


def where(system: System, mode: Drift) -> tuple[str, str, float]:
    """Body and reference position of the node that moves most in a motion, and how far [of its size]. Collective."""
    found = system.longest(mode.du.array_r)
    if found is None:
        return "", "", 0.0
    name = next((name for name, nodes in system.bodies if found.item in nodes), "")
    return system.comm.bcast(name, root=found.rank), spot(found.place), found.value


# -- limit point ------------------------------------------------------------------------------------------------------
def limit_point(system: System, mode: Drift, now: float, goal: float | None = None) -> Finding | None:
    """A finding if the softest motion, of stiffness `now`, has lost nearly all that it has in the unloaded bodies, and the
    path's rate says that the fold lies no further ahead than a few times the step to `goal`, or that step crosses a kink.

    A soft motion alone stops no step: sliding bodies have one, and so has a point on a fillet. Forks are found by the rate
    too, for only an imperfect one stops Newton's method, and before that the path bends. One of less stiffness than none
    lies behind a fold that a step has crossed: a driven roller that nothing keeps from rolling on has no state ahead.
    """
    unloaded = _unloaded_stiffness(system, mode)
    step = 0.0 if goal is None else abs(goal - system.trail.last.t)
    gone = goal is not None and now <= -FOLDED * unloaded  # arcs go along behind folds
    if not gone and (now >= FOLDED * unloaded or step > NEAR):
        return None
    name, place, largest = where(system, mode)
    going = np.linalg.norm(mode.dq, axis=1) > TAKEN * largest
    tools, instead = [f"tool '{system.tools.names[i]}'" for i in np.flatnonzero(going)], moved_instead(system, going)
    if gone:
        text = "its softest motion resists less than nothing: it goes on by itself, and no balance has been found ahead"
        return Finding(LIMIT_POINT, text, ", ".join(tools), " or ".join([*instead, *damping(system)])) if tools else None
    text = "the load path folds back or forks"
    if goal is not None and not fold_ahead(system) <= AHEAD * step:
        if not (now > 0.0 and _falls(system, mode, goal)):
            return None
        text += " where a contact's status changes"
    text = f"its softest motion keeps {now / unloaded:.2g} of the stiffness it has unloaded: {text}"
    ways = [*arcs(system), *instead]
    if not tools and _loaded(system):
        ways.append("prescribe a displacement in place of the load")
    ways += damping(system)
    return Finding(LIMIT_POINT, text, ", ".join([*tools, f"body '{name}' at {place}"]), " or ".join(ways))


def _falls(system: System, mode: Drift, goal: float) -> bool:
    """Whether the softest motion of the accepted state resists less than not at all at one of the first iterates of a step
    to `goal`, near balance: there a point opens or slips with which the last stiffness goes. Collective.

    At such a kink the load path folds back and no rate announces it: on its one side the tangent leads over the kink, on
    the other one back.
    """
    found = False
    for left in _iterates(system, goal):
        if not left < NEAR:
            break
        system.assemble_tangent()
        soft = softest(system)
        if soft is None:
            break
        if soft.dot(resistance(system, soft, system.matrix)) < 0.0:
            found = mode.dot(soft) ** 2 > ALIKE * mode.dot(mode) * soft.dot(soft)
            break
    rolled_back(system)
    return found


def damping(system: System) -> list[str]:
    """The advice to let damping carry the bodies on, in a list, where that has not been asked for."""
    return [] if system.damped else ["let damping carry it on: solve(..., method=Method(damping=True))"]


def arcs(system: System) -> list[str]:
    """The advice to follow the path by arc length, in a list, where the scene allows that."""
    return [] if system.stabilised or system.fluids else ["follow the path by arc length"]


def pushed(system: System) -> Bools:
    """Whether forces or moments act on tools (tools,) at the accepted state or from there on."""
    t = system.trail.last.t
    return np.any([system.tools.forces(t), system.tools.forces(t + LOAD_PROBE)], axis=(0, 2))


def moved_instead(system: System, among: Bools | bool = True) -> list[str]:
    """The advice to move those of the tools (tools,) `among` which are pushed, in a list, where there are such."""
    tools = [f"tool '{system.tools.names[i]}'" for i in np.flatnonzero(pushed(system) & among)]
    return [f"move {' and '.join(tools)} instead of pushing"] if tools else []


def _loaded(system: System) -> bool:
    """Whether forces, and not only supports and tools on their ways, grow with t at the accepted state. Collective."""
    t = system.trail.last.t
    return load_change(system, t + LOAD_PROBE, t)[0].norm() > 0.0


def load_change(system: System, start: float, end: float) -> tuple[Vec, Floats]:
    """How loads on nodes and on tools (tools, 6) change from one t to another at the state at hand [force]. Collective."""
    system.begin_step(start)
    system.assemble_residual()
    change, pushes = system.residual_vector.copy(), system.tool_residual
    system.begin_step(end)
    system.assemble_residual()
    change.aypx(-1.0, system.residual_vector)
    return change, system.tool_residual - pushes


def fold_ahead(system: System, states: list[Accepted] | None = None) -> float:
    """How far [t] ahead of the accepted state the load path folds back, as its last step and its rate tell. Collective.

    Before a fold at t_f displacements are u_f - a sqrt(t_f - t). So the rate du/dt over the mean rate of a last step of
    length h is q = (1 + sqrt((d + h) / d)) / 2, d = t_f - t: endless where the rate does not grow from step to step, zero
    where the tangent is singular. A first step, which has none before it, may have any fold ahead: zero. states: (u,
    q, t) of the last two, by default the accepted ones.
    """
    states = states or system.trail.accepted
    if len(states) < 2:
        return 0.0
    (u, tools, t), (u_now, tools_now, t_now) = states[-2:]
    step = system.new_vector()
    step.array[:] = (u_now - u)[: step.getLocalSize()]
    arc = ArcLength(LinearSolver(system, "direct", afresh=True))
    try:
        arc.start(system)
    except StepFailed:
        return 0.0
    moved = system.length(step, tools_now - tools)
    q = (arc.per_load or 0.0) * (t_now - t) / moved if moved > 0.0 else np.inf
    return (t_now - t) / (4.0 * q * (q - 1.0)) if q > 1.0 else np.inf


def _unloaded_stiffness(system: System, mode: Drift) -> float:
    """Rayleigh quotient of a motion in the undeformed bodies, contacts and loads away."""
    system.state.u.x.array[:] = 0.0
    system.matrix.zeroEntries()
    insert(system.terms[0].tangent(system.state), system.matrix, None)
    system.matrix.assemble()
    force = system.matrix.createVecLeft()
    system.matrix.mult(mode.du, force)
    system.trail.rollback()
    return mode.du.dot(force)

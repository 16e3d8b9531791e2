"""Bodies and pushed tools that nothing holds any more: free rigid motions, and those that friction alone resists."""

from collections.abc import Collection, Sequence

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import MOVES, RIGID_MOTION, SLIDES, Finding, spot, tidied
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import Term
from fenics_contact.assembly.trial import ENDLESS, Trials
from fenics_contact.solvers.motions import Drift, by_owner, relaxed, resistance, rigid_motions, turning_point
from fenics_contact.solvers.slipping import used_share
from fenics_contact.solvers.softness import LARGEST, damping
from fenics_contact.types import Floats, Mat, Vec

# A motion is free where its nodes resist it, each by itself, a million times more than all together. Squared: sums of
# products know it to 1e-16, and what holds a body least, one corner in contact among n nodes, gives 1/n.
FREE = 1e-12
# Of what it resists where all points stick: a motion that keeps less without some friction is held by that alone.
HELD = 0.1
MOSTLY = 0.25  # the same where nothing else explains a failure: held by little else, a ball in its dent or on a slope
# Share of the friction that Coulomb's law allows, above which a body that only friction holds is about to slide: steps
# cut to 1e-4 of the load before that leave 1e-4 of it, a hundred times less.
USED_UP = 0.99
# Share of the friction allowed that a contact exerts at least where it is used up: points in the middle of what turns may
# exert none.
TURNING = 0.5
# Of what it resists where all points stick: a motion that the tangent drives by more goes on by itself. Bodies that slide on
# a flat floor have none, but for round-off and what their own shape changes; wedges a tenth and more.
AWAY = 0.01
# Of the work of what pushes a tool: where bodies that give way take less, friction takes most. Cells of a tyre that spins
# take 15 % of it and give it back, a disc spring at its limit point takes 98 %.
GIVES = 0.5
THROWN = 0.1  # of the bodies' size: how far a tool that nothing pushes goes within a step only if it is thrown
PUSHED = 0.1  # of the work of the contacts on a motion: what loads do where they drive it; they do none on a body that rests

Motions = list[tuple[str, Drift, str]]  # owner, motion, words


def supported(system: System) -> Mat:
    """Copy of the tangent in which supports hold as stiffly as the stiffest node."""
    matrix, change = system.matrix.copy(), system.supports.change
    largest = matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY)
    matrix = system.supports.eliminated(matrix, largest, system.couplings.patterns)
    return matrix if change is None else change.changed_back(matrix)


def closed(system: System, contact: ContactTerm) -> bool:
    """Whether a contact has a closed point (status 0: open) at the state evaluated last. Collective."""
    return bool(system.comm.allreduce(int(contact.statuses().any())))


# -- rigid-body motion ------------------------------------------------------------------------------------------------
def rigid_motion(system: System) -> Finding | None:
    """A finding if some bodies and tools can move as rigid ones without any resistance. Collective."""
    parts = _free(system)
    return _unheld(system, parts) if parts else None


def turns_freely(system: System) -> Finding | None:
    """A finding where springs of the stabilisation alone keep a pushed tool from turning, and contacts that are all closed
    leave it free. Collective."""
    springs = system.grounding
    if springs is None or not springs.engaged:
        return None
    with springs.away():
        parts = _free(system)
    turning = all(set(how) <= set(MOVES[3:]) for _, how in parts)
    return _unheld(system, parts) if parts and turning and not _open_contacts(system, {name for name, _ in parts}) else None


def _free(system: System) -> list[tuple[str, list[str]]]:
    """(owner, words) of the bodies and tools that can move as rigid ones without any resistance. Collective."""
    system.assemble_tangent()
    matrix, motions = supported(system), rigid_motions(system)
    diagonal = matrix.getDiagonal()
    diagonal.abs()
    largest = diagonal.norm(PETSc.NormType.NORM_INFINITY)
    forces = [resistance(system, motion, matrix) for _, motion, _ in motions]
    softness = diagonal.copy()
    softness.reciprocal()
    gram = _products(forces, softness, 1.0 / largest)
    values, vectors = lowest(gram, _products([motion for _, motion, _ in motions], diagonal, largest))
    free = vectors[:, np.abs(values) < FREE]
    parts = moving_parts(motions, free) if free.size else []
    combined = [combined_motion(system, motions, way) for way in free.T]
    for i, (name, how) in enumerate(parts):
        if (point := turning_point(system, name, combined)) is not None:
            turns = ", ".join(words for words in how if words in MOVES[3:])
            parts[i] = name, [f"{turns} through {spot(tidied(point[None], system.extent)[0])}"]
    return parts


def _unheld(system: System, parts: list[tuple[str, list[str]]]) -> Finding:
    """The finding that nothing holds these (owner, words). Collective."""
    text = [f"{kind_of_owner(system, name)} '{name}' {', '.join(how)} without resistance" for name, how in parts]
    waiting = _open_contacts(system, {name for name, _ in parts})
    tools = [name for name, _ in parts if name in system.tools.names]
    remedy = "fix a surface or use a symmetry plane"
    if tools:
        which = " and ".join(f"'{name}'" for name in tools)
        remedy = f"let the Motion of {which} hold or prescribe that component, or let friction hold it before it is loaded"
    if waiting:
        crossed = "" if system.stabilised else " or cross it with prescribe or solve(..., method=Method(stabilise=True))"
        remedy = f"{remedy}, close the gap of {waiting}, which is open,{crossed}"
    owners: dict[str, list[str]] = {}
    for name, _ in parts:
        owners.setdefault(kind_of_owner(system, name), []).append(name)
    place = ", ".join(f"{kind} '{', '.join(names)}'" for kind, names in owners.items())
    return Finding(RIGID_MOTION, " and ".join(text), place, remedy)


def kind_of_owner(system: System, name: str) -> str:
    return "tool" if name in system.tools.names else "body"


def _products(vectors: Sequence[Drift], weights: Vec, on_tools: float) -> Floats:
    """Weighted products of Motions with each other. Collective."""
    out = np.zeros((len(vectors),) * 2)
    for j, one in enumerate(vectors):
        scaled = one.du.copy()
        scaled.pointwiseMult(weights, one.du)
        out[:, j] = [other.du.dot(scaled) + on_tools * float(np.sum(other.dq * one.dq)) for other in vectors]
    return out


def moving_parts(motions: Motions, combined: Floats) -> list[tuple[str, list[str]]]:
    """Of combined motions (len(motions), n): (owner, words) of each owner that moves. Collective."""
    size = np.linalg.norm(combined, axis=1) * [motion.largest for _, motion, _ in motions]
    found: dict[str, list[tuple[float, str]]] = {}
    for (name, _, words), share in zip(motions, size, strict=True):
        found.setdefault(name, []).append((share, words))
    out = []
    for name, shares in found.items():
        largest = max(share for share, _ in shares)
        if largest > 0.1 * size.max():
            out.append((name, list(dict.fromkeys(words for share, words in shares if share > 0.3 * largest))))
    return out


def _open_contacts(system: System, names: set[str]) -> str:
    """Contacts of these bodies without a closed point at the state evaluated last, in words. Collective."""
    waiting = [contact for contact in contacts_of(system, names) if not closed(system, contact)]
    return " or ".join(f"contact '{contact.name}'" for contact in waiting)


def contacts_of(system: System, names: set[str]) -> list[ContactTerm]:
    """Contacts of bodies and tools of these names."""
    bodies = [i for i, (name, _) in enumerate(system.bodies) if name in names]
    touching = [contact for i in bodies for contact in system.holds.contacts_of(i)]
    return [contact for contact in system.contact_terms if contact in touching or contact.master_name in names]


def lowest(energy: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and vectors of the symmetric part of energy against weight."""
    reduced, axes = _against(energy, weight)
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    vectors = axes @ vectors
    return values, vectors / np.linalg.norm(vectors, axis=0)


def _against(energy: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Energy in coordinates in which weight is one, and their axes."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(weight), 1e-300))
    energy, weight = (scale[:, None] * part * scale for part in (energy, weight))
    sizes, axes = np.linalg.eigh(weight)
    good = sizes > 1e-12 * sizes.max()
    whiten = axes[:, good] / np.sqrt(sizes[good])
    return whiten.T @ energy @ whiten, scale[:, None] * whiten


# -- friction used up -------------------------------------------------------------------------------------------------
def sliding(system: System, rest: float = HELD, asked: bool = False) -> Finding | None:
    """A finding if bodies or pushed tools are held along some way by friction, and no more of it can be had.

    rest: share of what resists that way with endless friction, of which less must be left without any; asked: the state is
    one in balance with endless friction, and what counts is that.
    """
    rough, near = _gripping(system, TURNING)
    if not near:
        return None
    return _sliding_rigidly(system, rough, near, rest, asked) or _sliding_softly(system, rough, near, asked)


def _sliding_rigidly(
    system: System, rough: list[ContactTerm], near: dict[ContactTerm, Floats], rest: float, asked: bool
) -> Finding | None:
    """See `sliding`: of rigid motions. near: contacts that may have used up their friction. Collective."""
    motions = rigid_motions(system)
    stuck = energies(system, rough, motions, {})
    held = _relying(system, rough, motions, stuck, rough, rest)[0]
    used = _spent(system, near, [combined_motion(system, motions, way) for way in held.T], asked)
    if not used:
        return None
    held, values = _relying(system, rough, motions, stuck, list(used), rest)
    if not held.size:
        return None
    loose = _reliant(system).union(system.tools.names)
    if not any(name in loose for name, _ in moving_parts(motions, held)):
        return None  # supports or prescribed tools hold them, though more softly than endless friction would
    how = "friction alone holds" if rest == HELD else f"friction gives all but {np.abs(values).min():.0%} of what holds"
    end = "a greater push has no balance" if rest == HELD else "it slides, and no balance has been found near"
    return _slides(system, motions, held, used, how, end)


def _sliding_softly(
    system: System, rough: list[ContactTerm], near: dict[ContactTerm, Floats], asked: bool
) -> Finding | None:
    """See `sliding`: of what pushed tools do if the bodies give way to them. A soft tyre that turned with its hub as a rigid
    body would press its flat into the road; where it spins, ever other parts of it are pressed flat. Collective."""
    used = _spent(system, near, ways := _giving_way(system, rough, rough), asked)
    if used and list(used) != rough:
        ways = _giving_way(system, rough, list(used))
    for way in ways if used else []:
        if _taken_by_friction(system, way, used):
            parts = by_owner(system, way)
            end = "a greater push has no balance"
            return _slides(system, parts, np.ones((len(parts), 1)), used, "friction alone holds", end)
    return None


def _giving_way(system: System, rough: list[ContactTerm], without: list[ContactTerm]) -> list[Drift]:
    """Motions of pushed tools, the bodies giving way as they do without the friction of some contacts, of which that leaves
    less than the share HELD of what resists them if all points stick. Collective."""
    if system.vector.getSize() > LARGEST:
        return []
    trials = {c: c.trial.with_friction(0.0 if c in without else ENDLESS) for c in rough}
    motions = [("", motion, "") for motion in relaxed(system, trials)]
    if not motions:
        return []
    held = _relying(system, rough, motions, energies(system, rough, motions, {}), without, HELD)[0]
    return [combined_motion(system, motions, way) for way in held.T]


def _taken_by_friction(system: System, way: Drift, used: Collection[ContactTerm]) -> bool:
    """Whether friction of these contacts takes most of the work of what pushes tools on a motion, and strain and all else
    little: at a limit point friction may be used up, too, but it is the bodies that give way. Collective."""
    push = float(np.sum(way.dq * system.tools.forces(system.state.t)))
    others = [term for term in system.terms if term not in used]
    return bool(abs(_works(system, others, [("", way, "")], used)[0]) < GIVES * abs(push))


def slipping_away(system: System) -> Finding | None:
    """A finding if bodies or pushed tools, whose friction is used up, would go on by themselves: along some way they press
    less and friction falls with that, as of a wedge that is drawn out, so that the tangent resists less than nothing.
    Collective."""
    rough, used = _gripping(system, USED_UP)
    if not used:
        return None
    motions = rigid_motions(system)
    now, stuck = resisted(system, motions, {}), energies(system, rough, motions, {})
    reduced, axes = _against(now, stuck)
    # of slip the tangent is not symmetric, and its symmetric part is indefinite where the eigenvalues are not
    values, vectors = np.linalg.eig(reduced)
    away = np.isreal(values) & (values.real < -AWAY)
    if not away.any():
        return None
    end = "what holds it falls as it slides: a greater push has no balance"
    return _slides(system, motions, axes @ vectors[:, away].real, used, "friction holds", end)


def _gripping(system: System, share: float) -> tuple[list[ContactTerm], dict[ContactTerm, Floats]]:
    """Closed contacts with friction, and {contact: (friction taken, the most of it)} of those that take more than a share of
    it. Collective."""
    rough = [contact for contact in system.contact_terms if contact.rough and closed(system, contact)]
    grips = {contact: system.comm.allreduce(np.array(contact.forces.grip(system.state))) for contact in rough}
    least = ALLOWED * system.scales.largest
    return rough, {contact: grip for contact, grip in grips.items() if grip[0] > share * grip[1] > share * least}


def _spent(
    system: System, grips: dict[ContactTerm, Floats], ways: Sequence[Drift], asked: bool
) -> dict[ContactTerm, Floats]:
    """Those of these contacts that can take no more friction: at all points, or against one of the combinations of these
    ways, of which the friction taken, or asked for, is then said. Collective."""
    used = {}
    for contact, (taken, most) in grips.items():
        share = taken / most
        if asked or share <= USED_UP:
            share = used_share(system, contact, ways, asked)
        if share > USED_UP:
            used[contact] = np.array([share * most, most])
    return used


def _relying(
    system: System, rough: list[ContactTerm], motions: Motions, stuck: Floats, without: list[ContactTerm], rest: float
) -> tuple[Floats, Floats]:
    """(combinations of motions, share): those of which less than the share `rest` of what resists them if all points stick
    is left without the friction of some contacts, and what is left. Collective.

    stuck: works of the motions if all points stick; without: these contacts.
    """
    values, vectors = lowest(energies(system, rough, motions, dict.fromkeys(without, 0.0)), stuck)
    return vectors[:, np.abs(values) < rest], values


def _slides(
    system: System, motions: Motions, held: Floats, used: dict[ContactTerm, Floats], how: str, end: str
) -> Finding | None:
    """The finding that friction, used up in these contacts, holds combinations of motions: in words how, and what follows
    where a load pushes; None where none does and nothing is left to try, or where these have no part in it. Collective."""
    owners = [name for name, _ in moving_parts(motions, held)]
    contacts = [contact for contact in contacts_of(system, set(owners)) if contact in used]
    if not contacts:
        return None
    taken, most = np.sum([used[contact] for contact in contacts], axis=0)
    reliant = _reliant(system)
    # a body that supports hold, if more softly than endless friction would, goes with what they do not
    loose = [name for name in owners if name in reliant or name in system.tools.names or _carried_by(system, name, owners)]
    names = ", ".join(f"{kind_of_owner(system, name)} '{name}'" for name in loose or owners)
    where = ", ".join(f"contact '{contact.name}'" for contact in contacts)
    text = f"{how} {names}, and it is used up: T / (mu N) = {taken / most:.3g}"
    if not pushed(system, motions, held):
        springs = reliant.issuperset(owners) and not (system.stabilised or system.damped)
        remedy = " or ".join((["solve(..., method=Method(stabilise=True))"] if springs else []) + damping(system))
        return Finding(SLIDES, f"{text}; no load pushes it: it slides along what moves", where, remedy) if remedy else None
    remedy = "raise friction=, fix a surface, or prescribe this motion (move= of a tool) in place of the load that drives it"
    return Finding(SLIDES, f"{text}; {end}", where, remedy)


def _reliant(system: System) -> set[str]:
    """Names of the bodies that supports alone do not hold along all axes."""
    return {system.bodies[i][0] for i in system.holds.reliant}


def _carried_by(system: System, body: str, names: Collection[str]) -> bool:
    """Whether a body is tied to one of the tools among these names. Collective."""
    nodes = np.concatenate([nodes for name, nodes in system.bodies if name == body])
    tied = [system.supports.ties.of(i) for i, name in enumerate(system.tools.names) if name in names]
    return bool(system.comm.allreduce(sum(int(np.isin(nodes, of).sum()) for of in tied)))


def combined_motion(system: System, motions: Motions, combined: Floats) -> Drift:
    """A combination of motions (len(motions),)."""
    du, dq = system.new_vector(), np.zeros_like(system.state.q)
    for share, (_, motion, _) in zip(combined, motions, strict=True):
        du.axpy(share, motion.du)
        dq += share * motion.dq
    return Drift(du, dq)


def thrown(system: System) -> Finding | None:
    """A finding of a free tool that no load pushes, and that has lost every contact in this step and gone far: Newton's
    method took it somewhere, where nothing holds it, and any place would be as good. Collective."""
    q = system.trail.last.q
    least = max(ALLOWED * system.scales.largest, TOLERANCE * system.scales.balance)
    loads = system.tools.forces(system.state.t)
    for i, name in enumerate(system.tools.names):
        free = system.tools.free[i] & (np.abs(loads[i]) <= least)
        way = np.abs(np.where(free, system.state.q[i] - q[i], 0.0))[:3].max()
        tied = system.comm.allreduce(len(system.supports.ties.of(i)))
        if tied or way < THROWN * system.extent:
            continue
        if not any(contact.forces.holding(system.state, least) for contact in contacts_of(system, {name})):
            text = f"it has lost every contact and moved by {way / system.extent:.2g} of the bodies' size within the step"
            return Finding(RIGID_MOTION, text, f"tool '{name}'", _first(damping(system)))
    return None


def _first(ways: list[str]) -> str:
    return ways[0] if ways else "hold it along that way, or end the path before"


def pushed(system: System, motions: Motions, held: Floats) -> bool:
    """Whether loads do work on these combinations of motions, and not only contacts on one another. Collective."""
    shares = [_works(system, [contact], motions) @ held for contact in system.contact_terms]
    loads = _works(system, [term for term in system.terms if term not in system.contact_terms], motions)
    forces = Drift(system.new_vector(), -system.tools.forces(system.state.t))
    loads = (loads + [motion.dot(forces) for _, motion, _ in motions]) @ held
    return bool((np.abs(loads) > PUSHED * np.sum(np.abs(shares), axis=0)).any())


def _works(system: System, terms: Sequence[Term], motions: Motions, smooth: Collection[ContactTerm] = ()) -> Floats:
    """Work (len(motions),) of the forces of terms, and of the pressures of `smooth` contacts, on motions. Collective."""
    local, tools = np.zeros_like(system.state.u.x.array), np.zeros_like(system.tool_residual)
    for term in terms:
        term.add_residual(system.state, local, tools)
    for contact in smooth:
        contact.forces.press(system.state, local, tools)
    force = Drift(system.border_vector(local), system.comm.allreduce(tools))
    return np.array([motion.dot(force) for _, motion, _ in motions])


def energies(system: System, rough: list[ContactTerm], motions: Motions, frictions: dict[ContactTerm, float]) -> Floats:
    """Work of motions with each other's resistance if rough contacts had other coefficients of friction: endless ones, but
    for those of `frictions`. Collective."""
    return resisted(system, motions, {c: c.trial.with_friction(frictions.get(c, ENDLESS)) for c in rough})


def resisted(system: System, motions: Motions, trials: Trials) -> Floats:
    """Work of motions with each other's resistance by the tangent, with these trial states of contacts. Collective."""
    system.assemble_tangent(trials=trials)
    matrix = supported(system)
    forces = [resistance(system, motion, matrix) for _, motion, _ in motions]
    return np.array([[motion.dot(force) for force in forces] for _, motion, _ in motions])

"""Bodies and pushed tools that nothing holds any more: free rigid motions, and those that friction alone resists."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.finding import MOVES, RIGID_MOTION, SLIDES, Finding
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import ContactTerm, Term
from fenics_contact.solvers.motions import Motion, resistance, rigid_motions
from fenics_contact.solvers.softness import damping
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
NEARLY = 0.97  # the same, of contacts of one body that slide one instead of the other as the steps happen to fall
PUSHED = 0.1  # of the work of the contacts on a motion: what loads do where they drive it; they do none on a body that rests
ENDLESS = 1e12  # coefficient of friction under which every point in contact sticks

Motions = list[tuple[str, Motion, str]]  # owner, motion, words


def supported(system: System) -> Mat:
    """Copy of the tangent in which supports hold as stiffly as the stiffest node."""
    matrix, change = system.matrix.copy(), system.supports.change
    largest = matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY)
    matrix = system.supports.eliminated(matrix, largest, system.patterns)
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
    springs.engaged = False
    parts = _free(system)
    springs.engaged = True
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
    values, vectors = _lowest(gram, _products([motion for _, motion, _ in motions], diagonal, largest))
    free = vectors[:, np.abs(values) < FREE]
    return _parts(motions, free) if free.size else []


def _unheld(system: System, parts: list[tuple[str, list[str]]]) -> Finding:
    """The finding that nothing holds these (owner, words). Collective."""
    text = [f"{_kind_of_owner(system, name)} '{name}' {', '.join(how)} without resistance" for name, how in parts]
    waiting = _open_contacts(system, {name for name, _ in parts})
    tools = [name for name, _ in parts if name in system.tools.names]
    remedy = "fix a surface or use a symmetry plane"
    if tools:
        which = " and ".join(f"'{name}'" for name in tools)
        remedy = f"let the Motion of {which} hold or prescribe that component, or let friction hold it before it is loaded"
    if waiting:
        crossed = "" if system.stabilised else " or cross it with prescribe or solve(..., stabilise=True)"
        remedy = f"{remedy}, close the gap of {waiting}, which is open,{crossed}"
    owners: dict[str, list[str]] = {}
    for name, _ in parts:
        owners.setdefault(_kind_of_owner(system, name), []).append(name)
    place = ", ".join(f"{kind} '{', '.join(names)}'" for kind, names in owners.items())
    return Finding(RIGID_MOTION, " and ".join(text), place, remedy)


def _kind_of_owner(system: System, name: str) -> str:
    return "tool" if name in system.tools.names else "body"


def _products(vectors: Sequence[Motion], weights: Vec, on_tools: float) -> Floats:
    """Weighted products of Motions with each other. Collective."""
    out = np.zeros((len(vectors),) * 2)
    for j, one in enumerate(vectors):
        scaled = one.du.copy()
        scaled.pointwiseMult(weights, one.du)
        out[:, j] = [other.du.dot(scaled) + on_tools * float(np.sum(other.dq * one.dq)) for other in vectors]
    return out


def _parts(motions: Motions, combined: Floats) -> list[tuple[str, list[str]]]:
    """Of combined motions (len(motions), n): (owner, words) of each owner that moves."""
    size = np.linalg.norm(combined, axis=1)
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
    return [contact for contact in system.contacts if contact in touching or contact.master_name in names]


def _lowest(energy: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and vectors of the symmetric part of energy against weight."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(weight), 1e-300))
    energy, weight = (scale[:, None] * part * scale for part in (energy, weight))
    sizes, axes = np.linalg.eigh(weight)
    good = sizes > 1e-12 * sizes.max()
    whiten = axes[:, good] / np.sqrt(sizes[good])
    values, vectors = np.linalg.eigh(whiten.T @ (0.5 * (energy + energy.T)) @ whiten)
    vectors = whiten @ vectors
    return values, vectors / np.linalg.norm(vectors, axis=0)


# -- friction used up -------------------------------------------------------------------------------------------------
def sliding(system: System, rest: float = HELD) -> Finding | None:
    """A finding if bodies or pushed tools are held along some way by friction, and no more of it can be had.

    rest: share of what resists that way with endless friction, of which less must be left without any.
    """
    rough = [contact for contact in system.contacts if contact.rough and closed(system, contact)]
    if not rough:
        return None
    grips = {contact: system.comm.allreduce(np.array(contact.grip(system.state))) for contact in rough}
    least = ALLOWED * max(system.forces, system.force_scale)
    used = [contact for contact, (taken, most) in grips.items() if taken > USED_UP * most > USED_UP * least]
    if not used:
        return None
    motions = rigid_motions(system)
    smooth, stuck = (_energies(system, rough, motions, {contact: 0.0 for contact in some}) for some in (used, []))
    values, vectors = _lowest(smooth, stuck)
    held = vectors[:, np.abs(values) < rest]
    if not held.size:
        return None
    parts = _parts(motions, held)
    contacts = [contact for contact in contacts_of(system, {name for name, _ in parts}) if contact in used]
    taken, most = np.sum([grips[contact] for contact in contacts], axis=0)
    names = ", ".join(f"{_kind_of_owner(system, name)} '{name}'" for name, _ in parts)
    where = ", ".join(f"contact '{contact.name}'" for contact in contacts)
    alone = "alone" if rest == HELD else f"gives all but {np.abs(values).min():.0%} of what"
    text = f"friction {alone} holds {names}, and it is used up: T / (mu N) = {taken / most:.3g}"
    if not _pushed(system, motions, held):
        ways = damping(system)
        return Finding(SLIDES, f"{text}; no load pushes it: it slides along what moves", where, ways[0]) if ways else None
    remedy = "raise friction=, fix a surface, or prescribe this motion (move= of a tool) in place of the load that drives it"
    end = "a greater push has no balance" if rest == HELD else "it slides, and no balance has been found near"
    return Finding(SLIDES, f"{text}; {end}", where, remedy)


def undecided(system: System, told: Collection[str]) -> dict[str, str]:
    """{place: a note} of each body that contacts alone hold, several of them, and the friction of all is all but used up: on
    the way that what moves prescribes one of them must slide, and hardly anything says which. Collective.

    told: places that have had theirs.
    """
    found = {}
    for body in system.holds.reliant:
        place = f"body '{system.bodies[body][0]}'"
        if place in told:
            continue
        contacts = [contact for contact in system.holds.contacts_of(body) if contact.rough and closed(system, contact)]
        if len(contacts) < 2:
            continue
        grips = [system.comm.allreduce(np.array(contact.grip(system.state))) for contact in contacts]
        least = ALLOWED * max(system.forces, system.force_scale)
        if all(taken > NEARLY * most > NEARLY * least for taken, most in grips):
            words = " and ".join(f"'{contact.name}'" for contact in contacts)
            shares = ", ".join(f"{taken / most:.3f}" for taken, most in grips)
            found[place] = (
                f"contacts {words} hold {place}, and the friction of all of them is all but used up, T / (mu N) = "
                f"{shares}: the path may branch here, for hardly anything says which of them slides; compare with twice the "
                "steps, hold the body along that way, or let the frictions differ"
            )
    return found


def _pushed(system: System, motions: Motions, held: Floats) -> bool:
    """Whether loads do work on these combinations of motions, and not only contacts on one another. Collective."""
    shares = [_works(system, [contact], motions) @ held for contact in system.contacts]
    loads = _works(system, [term for term in system.terms if term not in system.contacts], motions)
    forces = Motion(system.new_vector(), -system.tools.forces(system.state.t))
    loads = (loads + [motion.dot(forces) for _, motion, _ in motions]) @ held
    return bool((np.abs(loads) > PUSHED * np.sum(np.abs(shares), axis=0)).any())


def _works(system: System, terms: Sequence[Term], motions: Motions) -> Floats:
    """Work (len(motions),) of the forces of terms on motions. Collective."""
    local, tools = np.zeros_like(system.state.u.x.array), np.zeros_like(system.tool_residual)
    for term in terms:
        term.add_residual(system.state, local, tools)
    force = Motion(system.border_vector(local), system.comm.allreduce(tools))
    return np.array([motion.dot(force) for _, motion, _ in motions])


def _energies(system: System, rough: list[ContactTerm], motions: Motions, frictions: dict[ContactTerm, float]) -> Floats:
    """Work of motions with each other's resistance if rough contacts had other coefficients of friction: endless ones, but
    for those of `frictions`. Collective."""
    trials: dict[Term, Any] = {contact: contact.trial.with_friction(frictions.get(contact, ENDLESS)) for contact in rough}
    system.assemble_tangent(trials=trials)
    matrix = supported(system)
    forces = [resistance(system, motion, matrix) for _, motion, _ in motions]
    return np.array([[motion.dot(force) for force in forces] for _, motion, _ in motions])

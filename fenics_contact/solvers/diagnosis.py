"""Why a step cannot be taken: evidence from the failing iterate, and from the tangent at the last accepted state."""

import numpy as np

from fenics_contact.assembly.finding import (
    COMES_IN,
    CRUSHING,
    CYCLING,
    LIMIT_POINT,
    LOST,
    MEMORY,
    OUT_OF_STEPS,
    RIGID_MOTION,
    SLIDES,
    TOO_STIFF,
    UNKNOWN,
    Finding,
    spot,
)
from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.solvers.entering import all_but_open
from fenics_contact.solvers.holding import (
    MOSTLY,
    closed,
    contacts_of,
    rigid_motion,
    sliding,
    slipping_away,
    turns_freely,
)
from fenics_contact.solvers.linear import FACTORISE, LinearSolver
from fenics_contact.solvers.overdrawn import overdrawn
from fenics_contact.solvers.softness import (
    LARGEST,
    damping,
    moved_instead,
    pushed,
    rolled_back,
    slides_over,
    soft_motion,
    topples_ahead,
    topples_stuck,
)
from fenics_contact.solvers.verdict import StepFailed

CERTAIN = (MEMORY, OUT_OF_STEPS, TOO_STIFF)  # causes that need no further evidence
SQUEEZED = 0.1  # J of the accepted state below which an inversion in the next step is no accident of Newton's way
LONG = 1e-2  # of the load: a step above that may still be too long for Newton's method where nothing ails the scene
FEW = 4  # points: the corners of one facet; between them a tool finds nothing that holds it
# Of the largest force of the run: a contact that presses less is about to let go; steps are cut to 1e-4 of their first size
FADED = 1e-3
GONE = 1e-9  # times the penalties of a contact: as if it were not there, with the last of its force


def diagnose(system: System, failure: StepFailed, goal: float | None = None) -> Finding:
    """Finding of the cause of a StepFailed: call at the failing iterate; the system is rolled back here. Collective.

    goal: t at which the step was to end; None on an arc.
    """
    known, unbalanced = failure.finding, _unbalanced(system)
    inverted = system.cells.check()
    rolled_back(system)
    if known.kind in CERTAIN:
        return known
    if stated := next(
        (found for contact in system.contact_terms if (found := contact.findings.misstated(system.state))), None
    ):
        return stated._replace(reason=f"{stated.reason}; {known.reason}")
    if worst := system.cells.check(CRUSHING):  # whatever failed last
        return worst
    if inverted and (worst := system.cells.check(SQUEEZED)):  # no iterate gone astray: the accepted state was about to
        return worst
    troubles = [found for term in system.terms if (found := term.findings.trouble(system.state))]
    if lost := [trouble for trouble in troubles if trouble.kind == LOST]:
        return lost[0]._replace(remedy="; or, where a body snaps past it, ".join([lost[0].remedy, *damping(system)]))
    if lifted := _lifted(system, goal):
        return lifted
    if known.kind == SLIDES:
        return known
    if known.kind == RIGID_MOTION and not _touched(system):  # a tool that lies on a body touches it before anything presses
        return overdrawn(system, goal) or known
    slides = sliding(system)
    found = (topples_stuck(system) or slides) if slides else None
    found = found or rigid_motion(system) or turns_freely(system) or slipping_away(system)
    found = found or (_on_few_points(system) if system.stabilised else None)
    found = found or _pressed_apart(system) or next(iter(troubles), None)
    if found is None:
        found = soft_motion(system, goal)
        if found and found.kind == LIMIT_POINT and known.remedy == FACTORISE:
            found = found._replace(remedy=" or ".join([FACTORISE, found.remedy]))
    if found is None and known.kind == CYCLING and goal is not None:
        found = _snaps_off(system, known.place)
    if found is None and known.kind in (UNKNOWN, CYCLING) and goal is not None and system.vector.getSize() <= LARGEST:
        found = topples_ahead(system, goal)
    if found is None and known.kind in (UNKNOWN, CYCLING):
        found = overdrawn(system, goal) or _cornered(system, known)
    if found is None and known.kind == COMES_IN:
        return known._replace(remedy=" or ".join([*damping(system), known.remedy]))
    if found is None and inverted and _inverts_ahead(system, goal):
        return inverted
    if found is None and known.kind == UNKNOWN:
        found = _restless(system, goal) or _letting_go(system) or _opening(system, known) or sliding(system, MOSTLY)
        return found or _unexplained(system, known._replace(place=known.place or unbalanced), inverted, goal)
    if found is None and known.kind == CYCLING:
        found = _opening(system, known)
    if found is None and known.kind in (CYCLING, LOST):
        if goal is None or goal - system.trail.last.t > LONG:
            return known._replace(remedy=" or ".join([known.remedy, *damping(system)]))
        # more steps would not be shorter ones; a force near the most that contacts can take may have no balance ahead
        ways = [*damping(system), *moved_instead(system), known.remedy]
        return known._replace(remedy=" or ".join(ways))
    if found is None and known.kind == RIGID_MOTION:  # one word for both: whether a step finds balance there is round-off
        found = overdrawn(system, goal) or _letting_go(system)
    return found or known


def _unbalanced(system: System) -> str:
    """Where most of the residual assembled last is out of balance. Collective."""
    found = system.longest(system.residual_vector.array_r)
    return f"most at {spot(found.place)}" if found else ""


def in_corner(system: System, failure: StepFailed) -> bool:
    """Whether most of what a step leaves out of balance is at a point in an inner corner of a tool: call at the failing
    iterate. Collective."""
    if failure.finding.kind not in (UNKNOWN, CYCLING) or not system.contact_terms:
        return False
    found = system.longest(system.residual_vector.array_r)
    return found is not None and any(
        contact.findings.cornered(system.state, found.place) for contact in system.contact_terms
    )


def _cornered(system: System, known: Finding) -> Finding | None:
    """A finding if a point lies in an inner corner of a tool: it jumps between what holds it there. Collective."""
    for contact in system.contact_terms:
        if corner := contact.findings.cornered(system.state):
            return corner._replace(kind=known.kind, reason=f"{known.reason}; {corner.reason}")
    return None


def _unexplained(system: System, known: Finding, inverted: Finding | None, goal: float | None) -> Finding:
    """What is left to try where nothing but the failure itself is known."""
    reason, place, ways = known.reason, inverted.place if inverted else known.place, [known.remedy] if known.remedy else []
    if inverted:
        reason = f"on its way to balance {inverted.reason}, which the path itself does not ask for"
    if edge := next(
        (found for contact in system.contact_terms if (found := contact.findings.pressing_edge(system.state))), None
    ):
        reason, place, ways = f"{reason}; {edge.reason}", f"{edge.place}, {place}", [edge.remedy, *ways]
    if not ways and goal is not None and goal - system.trail.last.t > LONG:
        ways = ["take more steps, or allow shorter ones (Method(smallest_step=...))"]
    elif not ways:
        ways = [*damping(system), "take finer cells there, and round edges that press or slide there"]
    # springs tell what friction cannot hold from the first step on, which no tangent of the start does
    if len(system.trail.accepted) < 2 and system.grounding and not system.stabilised:
        ways = ["see what holds before the contacts do: solve(..., method=Method(stabilise=True))", *ways]
    return Finding(UNKNOWN, reason, place, " or ".join(ways))


def _opening(system: System, known: Finding) -> Finding | None:
    """The finding that a fluid is about to come through. Collective."""
    found = all_but_open(system, known)
    return found and found._replace(remedy=" or ".join([*damping(system), found.remedy]))


def _restless(system: System, goal: float | None) -> Finding | None:
    """A finding if an arc was to start where loads are out of balance: what they do at once is no part of it. Collective."""
    if goal is not None or len(system.trail.accepted) > 1:
        return None
    if not system.assemble_residual() > TOLERANCE * system.scales.balance:
        return None
    text = "at the start loads act on bodies at rest: the path begins where they have given way, and no short arc meets it"
    return Finding(UNKNOWN, text, remedy="let the functions of the loads start from 0")


def _letting_go(system: System) -> Finding | None:
    """A finding if hardly anything holds a body any more in the accepted state, where something did before. Collective."""
    if len(system.trail.accepted) < 2 or not system.holds.reliant:
        return None
    loose = system.holds.loose(lambda contact: contact.forces.holding(system.state, FADED * system.scales.accepted))
    if not loose:
        return None
    names = ", ".join(system.bodies[i][0] for i in sorted(loose))
    text = f"the contacts that hold it press with less than {FADED:g} of the largest force so far: they are about to let go"
    springs = [] if system.stabilised else ["hold it by springs: solve(..., method=Method(stabilise=True))"]
    ways = ["fix a surface", *damping(system), *springs, "end the path before"]
    return Finding(RIGID_MOTION, text, f"body '{names}'", " or ".join(ways))


def _snaps_off(system: System, place: str) -> Finding | None:
    """A finding if the contacts of a place hardly press any more, and the bodies do not resist every motion where these
    leave them: they snap away, to where no short step leads. Collective."""
    if len(system.trail.accepted) < 2 or system.holds.reliant or system.vector.getSize() > LARGEST:
        return None
    least = FADED * system.scales.accepted
    faint = [c for c in system.contact_terms if f"'{c.name}'" in place and not c.forces.holding(system.state, least)]
    if not faint:
        return None
    system.assemble_residual()
    system.assemble_tangent(trials={c: c.penalties.stiffened(system.state, GONE) for c in faint})
    linear = LinearSolver(system, "direct", afresh=True)
    try:
        linear.solve(*system.still())
    except StepFailed:
        return None
    if not linear.count_negative(None):
        return None
    names = ", ".join(f"contact '{c.name}'" for c in faint)
    text = f"what is left of its force is less than {FADED:g} of the largest so far, and without it the bodies snap away"
    return Finding(LIMIT_POINT, text, names, " or ".join([*damping(system), "end the path before"]))


def _inverts_ahead(system: System, goal: float | None) -> bool:
    """Whether an element is about to turn inside out where the last step, carried on to `goal`, leads. Collective."""
    if goal is None or len(system.trail.accepted) < 2:
        return True
    (u, _, t), (u_now, _, t_now) = system.trail.accepted[-2:]
    system.state.u.x.array[:] = u_now + (goal - t_now) / (t_now - t) * (u_now - u)
    ahead = system.cells.check(SQUEEZED) is not None
    system.trail.rollback()
    return ahead


def _lifted(system: System, goal: float | None) -> Finding | None:
    """A finding if a tool that has been in contact is drawn off by the force that should push it. Collective."""
    if goal is None:
        return None
    then, before = system.tools.forces(goal), [system.tools.forces(t) for _, _, t in system.trail.accepted]
    for i in np.flatnonzero(system.tools.free.any(axis=1)):
        name, free = system.tools.names[i], system.tools.free[i]
        met = any(contact.trial.history.met.any() for contact in system.contact_terms if contact.master_name == name)
        reversed_ = all(forces[i, free] @ then[i, free] <= 0.0 for forces in before) and any(f[i].any() for f in before)
        if reversed_ and system.comm.allreduce(int(met)):
            text = f"the force on it draws tool '{name}' off the body, and contact cannot hold it back: there is no balance"
            remedy = "end the path where the force vanishes, or move the tool away in place of pushing it (move=)"
            return Finding(RIGID_MOTION, text, f"tool '{name}'", remedy)
    return None


def _pressed_apart(system: System) -> Finding | None:
    """A finding if bodies and tools lie inside one another before anything has been loaded: the first step must press them
    apart in one go, which is no small change. Collective."""
    if len(system.trail.accepted) > 1 or system.scales.moved > 0.0:
        return None
    return next((found for contact in system.contact_terms if (found := contact.findings.drawn_inside(system.state))), None)


def _on_few_points(system: System) -> Finding | None:
    """A finding if a pushed tool rests on so few points that it slides off them, with springs and all. Collective."""
    for contact in system.contact_terms:
        if contact.master_name not in system.tools.names:
            continue
        tool = system.tools.names.index(contact.master_name)
        points = system.comm.allreduce(int(np.count_nonzero(contact.statuses())))
        if pushed(system)[tool] and 0 < points <= FEW and slides_over(system, tool):
            text = f"tool '{contact.master_name}' rests on {points} of the slave surface's points alone, and slides off them"
            remedy = "take more of them, points=3 (Gauss points), or mesh the place more finely"
            return Finding(RIGID_MOTION, text, f"contact '{contact.name}'", remedy)
    return None


def _touched(system: System) -> bool:
    """Whether every pushed tool touches a body in the accepted state, or something does that is tied to it. Collective."""
    tools, met = system.tools, {contact.master_name for contact in system.contact_terms if closed(system, contact)}
    for i in np.flatnonzero(tools.free.any(axis=1)):
        tied = system.supports.ties.of(i)
        of_body = [system.comm.allreduce(int(np.isin(nodes, tied).any())) for _, nodes in system.bodies]
        bodies = {name for (name, _), follows in zip(system.bodies, of_body, strict=True) if follows}
        if tools.names[i] not in met and not any(closed(system, contact) for contact in contacts_of(system, bodies)):
            return False
    return True

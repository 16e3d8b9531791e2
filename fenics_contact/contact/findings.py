"""What ails a contact: points passed through, sunk or lost, penetrations that are round-off, a master never met."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.contact_term import Leads, Newcomers
from fenics_contact.assembly.finding import LOST, NO_LAW, TOO_SOFT, TOO_STIFF, UNKNOWN, Finding, Remark
from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import DRAWN
from fenics_contact.contact.between_facets import come_in, hidden_note, led_in_note, sunk, unheld_facets
from fenics_contact.contact.between_points import node_depth, nodes_deeper
from fenics_contact.contact.coming_in import between_note, came_in, held_better, pierced, unheld
from fenics_contact.contact.corners import cornered
from fenics_contact.contact.forces import ROUNDINGS
from fenics_contact.contact.foremost import worst
from fenics_contact.contact.leaning import LEANS, ROUND, bent_note, degrees, lean_note, lean_of
from fenics_contact.contact.led import LED
from fenics_contact.contact.newcomers import first_touch
from fenics_contact.kernels.quadratic import TRIANGLE
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

INSIDE = 1e-3  # of a cell's height: what lies deeper before anything has moved is more than what straight cells cut off
NEARLY = 0.9  # of what stops a run: an accepted state that far is what the steps after it fail of
SUNK = 0.5  # of a cell's height: a point that deep is held by nothing that deserves the name of contact
THROUGH = 0.1  # of a cell's height: an inner node that deep has been led in by a fold of the surface, or through it
DEEP = 0.05  # of a cell's height: a penetration that the result should not be trusted with unasked
RESOLVED = 1e-12  # of the coordinates: the pressure of a penetration that small is known to 2e-4 at best
CRUMBS = 1e-8  # of the coordinates: what a pressure must shorten the body beneath by, to matter
# Stated penalties over E/h: what is beyond them is no choice any more, the default being 100. Up to 1e7 forces are right to
# 1e-3 in as many solves; from 1e8 on steps are cut hundreds of times, the penalty's own error is lost in rounding
STIFF, FEEBLE = 3e7, 1e-3
OVER_STIFFNESS = "times Young's modulus over a cell's height, the default being 100 times"
TINY = 1e-9  # of a node's area that is over the master, and of a pressure: less is none
SLID_OFF = 0.5  # of the most area that was over the master at once: when so much has left it, that is what ails the contact


def _slid_off(contact: Contact, state: State, far: bool = False) -> tuple[float, str, str]:
    """(share of the area that has been in contact and has left the master, in words, place); far: however far away that is.
    Collective."""
    comm, h = state.comm, contact.trial.history
    bare, area = contact.places.bare(contact.places.feet(state), far), np.where(h.met, contact.surface.area, 0.0).ravel()
    # a tool that is led along a surface leaves more and more of it, and meets as much anew
    gone, left = area * bare, comm.allreduce((area * (1.0 - bare)).sum())
    lost = max(1.0 - left / h.faced, 0.0) if h.faced > 0.0 else 0.0
    text = f"{lost:.0%} of the area that was in contact has no partner on '{contact.master_name}' any more"
    return lost, text, worst(contact, comm, gone)[1]


def _too_deep(contact: Contact, state: State, share: float) -> Finding | None:
    """None, or the Finding that a point lies deeper than a share of a cell's height. Collective."""
    height = contact.surface.cell_height
    depth, place = deepest_point(contact, state, share * height)
    if depth <= share * height:
        return None
    text = f"a point lies {depth:.3g} inside '{contact.master_name}', where a cell is {height:.3g} high"
    return Finding(TOO_SOFT, text, place, "raise penalty= of this contact, or leave it to the default")


def deepest_point(contact: Contact, state: State, above: float = -np.inf) -> tuple[float, str]:
    """(penetration [length], place) of the deepest point, the place of one deeper than `above` [length]. Collective."""
    return worst(contact, state.comm, contact.led.depths(state).ravel(), above=above)


def _led_note(contact: Contact, state: State, noise: float) -> Remark | None:
    """None, or that supports press slave points into the tool: what holds these is no body. Collective."""
    comm = state.comm
    force = np.linalg.norm(contact.response(state).traction, axis=2) * contact.surface.area
    on_led = np.where(contact.led.points(state), force, 0.0)
    led, total = comm.allreduce(np.array([on_led.sum(), force.sum()]))
    if not led > max(LED * total, noise):
        return None
    _, place = worst(contact, comm, on_led.ravel())
    return Remark(
        led / total,
        f"{led / total:.2g} of the contact's force acts where supports prescribe the slave along its normal, most at "
        f"{place}: there it is penalty times overlap, and no body's; leave these nodes free, or take what they lie on out "
        "of the slave",
    )


def _edge_note(contact: Contact, state: State) -> Remark | None:
    """None, or that nodes on edges of the slave, whose areas are those of all faces there, carry load under a law that asks
    for pressures. Collective."""
    facets, comm = contact.surface.between, state.comm
    if facets is None or not contact.trial.law.friction.asks_pressure:
        return None
    edges = facets.on_edges(contact.surface.nodes[:, 0])
    force = np.linalg.norm(contact.response(state).traction, axis=2).ravel() * contact.surface.area.ravel()
    on_edges = np.where(edges, force, 0.0)
    carried, total = comm.allreduce(np.array([on_edges.sum(), force.sum()]))
    if not carried > LED * total:
        return None
    _, place = worst(contact, comm, on_edges)
    return Remark(
        carried / total,
        f"{carried / total:.2g} of the contact's force is on nodes at edges between faces of the slave, most at {place}: "
        "their areas are those of all these faces, their pressures too small, and the law of friction takes them; "
        "name the face that touches alone, or take points=3 (Gauss points)",
    )


def _depth_note(contact: Contact, state: State) -> Remark | None:
    """None, or that points or nodes lie deep in the master. Collective."""
    height = contact.surface.cell_height
    deep = DEEP * height
    point, between = deepest_point(contact, state, deep), node_depth(contact, state, deep)
    depth, place, inner = _depth_beside(contact, state, deep)
    # corners of triangles of degree 2 have no area
    nodes = "" if contact.surface.nodes.shape[1] == TRIANGLE else ', or points="nodes"'
    node, better = "a node that is no slave", "name the surface it lies on among the slaves"
    if inner:
        node, better = "an inner node of the body", held_better(contact)
    found = (
        (*point, "penetration= keeps it out, or raise penalty="),
        (between[0], f"a node between points, {between[1]},", f"more points= per facet keep it out{nodes}"),
        (depth, f"{node}, {place},", better),
    )
    depth, place, remedy = max(found, key=lambda one: one[0])
    if depth <= deep:
        return None
    where = f"'{contact.master_name}', where a cell is {height:.3g} high"
    return Remark(depth, f"{place} lies {depth:.3g} inside {where}: {remedy}")


def _depth_beside(contact: Contact, state: State, above: float) -> tuple[float, str, bool]:
    """Depth [length] and place of the deepest node off the slave surface, the place of one deeper than `above` [length], and
    whether it is an inner one of its body; zero where that is not looked for. Collective."""
    if (beside := contact.places.beside(state)) is None:
        return 0.0, "", False
    nodes, X, inner = beside
    comm, depths = state.comm, -contact.places.node_gaps(state, nodes, X)
    at_skin, within = (worst(contact, comm, depths[part], X[part], above) for part in (~inner, inner))
    depth, place = max(at_skin, within)
    return max(depth, 0.0), place, within > at_skin


def _folded(contact: Contact, state: State) -> Finding | None:
    """None, or the Finding that an inner node lies in the tool, deeper than any other. Collective."""
    height = contact.surface.cell_height
    depth, place, inner = _depth_beside(contact, state, THROUGH * height)
    if not (inner and depth > THROUGH * height and depth > deepest_point(contact, state, np.inf)[0]):
        return None
    text = (
        f"an inner node of the body lies {depth:.3g} inside '{contact.master_name}', where a cell is {height:.3g} high: "
        "the surface has folded over it, or let it through"
    )
    return Finding(LOST, text, place, held_better(contact))


def _passed(contact: Contact, state: State) -> Finding | None:
    """None, or the Finding that a tool has come out behind the slave surface in this step. Collective."""
    if (passed := contact.places.passed(state, contact.trial)) is None:
        return None
    depth, place = worst(contact, state.comm, *passed, above=0.0)
    if depth <= 0.0:
        return None
    text = f"'{contact.master_name}' was passed through by {depth:.3g} in one step: it has come out behind the surface"
    return Finding(LOST, text, place, "take smaller steps, or raise the penalty")


def _beyond_the_law(contact: Contact, state: State) -> Finding | None:
    """None, or the Finding that a pressure is greater than those for which mu(p) was given. Collective."""
    table = contact.trial.law.friction.table
    if len(table) == 0:
        return None
    pressure = contact.forces.split_traction(state)[0] / np.maximum(contact.forces.covered(state), TINY)
    allowed = (known := np.exp(table[-1, 1])) * (1.0 + TINY)
    largest, place = worst(contact, state.comm, pressure.ravel(), above=allowed)
    if largest <= allowed:
        return None
    needed, given = told_apart(largest, known)
    text = f"a pressure of {needed} is beyond the {given} up to which mu(p) is given"
    return Finding(NO_LAW, text, place, "raise up_to= of coulomb(...) to the largest pressure of the whole run, or more")


def told_apart(a: float, b: float) -> tuple[str, str]:
    """Two numbers as text, with four digits or as many as show that they differ."""
    for digits in range(4, 18):
        texts = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


class Findings:
    """Of one contact, as solvers ask for them at a state. Collective."""

    def __init__(self, contact: Contact) -> None:
        self._contact = contact

    def first_touch(self, state: State, leads: Leads) -> Newcomers:
        """See `newcomers.first_touch`."""
        return first_touch(self._contact, state, leads)

    def objection(self, state: State) -> Finding | None:
        """Why this state, evaluated last, must not be accepted: bodies have passed through one another, a body has folded
        over a tool, a point is held by nothing, mu(p) is not known, or penetrations are round-off beside the coordinates."""
        contact = self._contact
        comm, trial = state.comm, contact.trial
        depth = contact.places.lost_depth(state, trial)
        if depth > DRAWN * contact.surface.cell_height:
            text = f"'{contact.master_name}' was passed through by {depth:.3g}: a point lies too deep to be held"
            remedy = f"take smaller steps, or raise the penalty; or {contact.partner.slid_off}"
            return Finding(LOST, text, f"contact '{contact.name}'", remedy)
        through = came_in(contact, state) or come_in(contact, state) or _passed(contact, state)
        if found := through or _too_deep(contact, state, SUNK) or _folded(contact, state):
            return found
        if known := _beyond_the_law(contact, state):
            return known
        response = contact.response(state)
        soft = contact.surface.stiffness.min(initial=np.inf)
        x = np.abs(contact.surface.X).max(initial=0.0) + np.abs(state.u.x.array).max(initial=0.0)
        low = comm.allgather((soft, (response.gap + trial.history.shift).min(initial=0.0), -x))
        soft, depth, size = (-value for value in np.min(low, axis=0))
        if not depth < RESOLVED * size:
            return None
        # a contact without load has tiny penetrations too: one with load shortens the body beneath it by far more
        largest, place = worst(contact, comm, np.linalg.norm(response.traction, axis=2).ravel())
        if not largest > -soft * CRUMBS * size:
            return None
        text = f"the deepest penetration {depth:.1e} is round-off beside coordinates of {size:.3g}, and so is the pressure"
        return Finding(TOO_STIFF, text, place, "lower penalty= of this contact, or leave it to the default")

    def trouble(self, state: State) -> Finding | None:
        """What keeps the step after this accepted state from converging."""
        contact = self._contact
        lost, text, place = _slid_off(contact, state)
        if lost > SLID_OFF:  # what has opened wide may have no partner nearby, and has not left the master
            lost, text, place = _slid_off(contact, state, far=True)
        if lost > SLID_OFF:
            return Finding(LOST, text, place, contact.partner.slid_off)
        return (
            _too_deep(contact, state, SUNK)
            or came_in(contact, state, NEARLY)
            or come_in(contact, state, NEARLY)
            or pierced(contact, state)
        )

    def deep(self, state: State) -> Finding | None:
        """A point lies deep enough to be distrusted."""
        return _too_deep(self._contact, state, DEEP)

    def drawn_inside(self, state: State) -> Finding | None:
        """A point lies within the master before anything has moved."""
        contact = self._contact
        allowed = INSIDE * contact.surface.cell_height
        depth, place = deepest_point(contact, state, allowed)
        if depth <= allowed:
            return None
        inside = f"{depth:.3g} inside '{contact.master_name}'"
        text = f"at the start a point lies {inside}, and the first step cannot press it out"
        remedy = "start it outside and bring it in along its path, in steps, or let a body swell into its place, swell()"
        return Finding(UNKNOWN, text, place, remedy)

    def remarks(self, state: State, noise: float) -> dict[str, Remark]:
        """{kind: what is to be said of an accepted state}; noise: see Scales [force]."""
        contact = self._contact
        lean = lean_of(contact, state)
        kinds: dict[str, Callable[[Contact, State], Remark | None]] = {
            "led": partial(_led_note, noise=noise),
            "deep": _depth_note,
            "between": between_note,
            "hidden": hidden_note,
            "led in": led_in_note,
            "leans": partial(lean_note, lean=lean),
            "edges": _edge_note,
            "bent": partial(bent_note, lean=lean),
        }
        return {kind: note for kind, say in kinds.items() if (note := say(contact, state))}

    def nodes_deeper(self, state: State) -> Floats:
        """How much deeper (ne, nq) [length] than the points that hold them the surfaces lie around these. Collective."""
        find = sunk if self._contact.surface.at_nodes else nodes_deeper
        return find(self._contact, state)

    def between_nodes(self, state: State) -> tuple[Floats, Floats]:
        """See `ContactFindings.between_nodes`; (0, 3): points are alone."""
        contact = self._contact
        return contact.partner.more_friction(contact.places.feet(state), contact.trial)

    def misstated(self, state: State) -> Finding | None:
        """The penalty that is stated is far from the stiffness of the bodies."""
        contact = self._contact
        least, most = contact.penalties.stated(state.comm)
        if most > STIFF:
            text = f"penalty= is {most:.0e} {OVER_STIFFNESS}: what presses is a gap next to rounding"
            return Finding(TOO_STIFF, text, f"contact '{contact.name}'", "leave penalty= out, or state a lower one")
        if least < FEEBLE and contact.penetration is None:
            text = f"penalty= is {least:.0e} {OVER_STIFFNESS}: bodies sink into each other before they give way"
            return Finding(TOO_SOFT, text, f"contact '{contact.name}'", "leave penalty= out, or state a greater one")
        return None

    def pressing_edge(self, state: State) -> Finding | None:
        """An edge of the slave is what touches."""
        contact, lean = self._contact, lean_of(self._contact, state).at_ends
        if lean <= LEANS:
            return None
        text = f"an edge of the slave presses on '{contact.master_name}', along normals that lean by {degrees(lean)}"
        return Finding(UNKNOWN, text, f"contact '{contact.name}'", f"{ROUND}, or finer cells along it")

    def cornered(self, state: State, by: Floats | None = None) -> Finding | None:
        """A point lies where two parts of a union meet; by: one beside a place of the reference."""
        return cornered(self._contact, state, by)

    def never_met(self, state: State, greatest: float, unknown: float, as_drawn: bool) -> str | None:
        """How far away the master is after a run in which no point has touched it but by rounding; greatest: load of a step,
        and unknown, see Scales [force]; as_drawn: whether the run started from none, in which more had been met."""
        contact = self._contact
        comm, search = state.comm, contact.places.search
        area = contact.surface.area
        # a load is a sum over points, and balance knows the root of that of squares
        points, round_off = comm.allreduce(np.array([area.size, (contact.forces.round_off() * area).sum()]))
        known = greatest > max(np.sqrt(points) * unknown, round_off) or (greatest == 0.0 and not as_drawn)
        if known and comm.allreduce(int(contact.trial.history.met.sum())):
            return None
        if note := unheld(contact, state) or unheld_facets(contact, state):
            return note
        nearest = min(comm.allgather(contact.response(state).gap.min(initial=np.inf)))
        beyond = "more than " if nearest >= search else ""
        ends = f"'{contact.master_name}' ends {beyond}{nearest:.3g} away"
        if nearest <= ROUNDINGS * contact.trial.law.touch:
            ends = f"what touches '{contact.master_name}' carries no more than rounding"
        return (
            f"contact '{contact.name}' never closed: {ends}; see that both "
            "are in the same units and in their places, and that the path is long enough and comes from the slave's side"
        )

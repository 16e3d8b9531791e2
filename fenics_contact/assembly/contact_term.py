"""What solvers, scenes and the output ask of a contact; of what is its own they know that it can be handed back: `Any`."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, Protocol

import numpy as np

from fenics_contact.assembly.finding import Finding
from fenics_contact.assembly.term import Findings, State, Term
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64


class ContactSurface(Protocol):
    """Slave points, by elements: local nodes (ne, k), their weights (ne, nq, k), areas (ne, nq) [length^2], reference
    positions X (ne, k, 3) of nodes; count of the points and largest height [length] of a cell beneath; whether points are
    nodes, and which (gradients: None), or lie in corners."""

    nodes: Ints
    a: Floats
    area: Floats
    X: Floats
    cell_height: float
    gradients: Floats | None
    corners: bool
    linear: bool

    @property
    def at_nodes(self) -> bool:
        """Whether points are nodes, or the corners that nodes are in; else they are Gauss points."""

    @property
    def count(self) -> int:
        """Of this rank."""


class ContactPartner(Protocol):
    """What the points meet. `feet`, `before`: where points and master were, of which the contact's places know.

    grounded: can it hold a body by itself, as a tool does, or only as far as it is held, as another body; foresees: may
    pressures be unknowns beside the displacement; foretells: is friction's way foreseen with them; settles: do both alone
    say who is in contact, so that no increment need be shortened; edge_kind: what the output says of its edges.
    """

    edge_kind: str
    grounded: bool
    foresees: bool
    foretells: bool
    settles: bool

    @property
    def nodes(self) -> Ints:
        """This rank's nodes of the slave and of a master that deforms, local numbers (n,)."""

    def gives(self, held: Array) -> bool:
        """Whether the master could move where the local dofs `held` (n,) do not."""

    def foreseen(self, feet: Any, before: Any, trial: Trial) -> Floats:
        """What decides at these feet as the tangent at the feet `before` foresees it: gaps (n,), shifts added, or (4 n,),
        ways behind them [length]. Collective."""

    def found(self, feet: Any, trial: Trial) -> Floats:
        """What decides at these feet by what points have there, in whichever place they are then; (0,): by what they have in
        that."""

    def carried_on(self, trial: Trial, share: float) -> Floats:
        """The same at the start of a step: of the last accepted one, carried on by a share of the change in it."""

    def ahead(self, feet: Any, before: Any, trial: Trial) -> Floats:
        """Of the n points that slipped in the tangent `before`: how far (n, 2) each lay ahead of its anchor there, and does
        at these feet, along the friction that it had there, times its size; (0, 2): that is not looked for."""


class ContactPlaces(Protocol):
    """Where the points are at a state, as the partner sees them. Collective."""

    def feet(self, state: State) -> Any:
        """The same object while they do not change."""

    def first_feet(self, state: State) -> Any:
        """The same of a search that looks farther, not kept."""

    def as_accepted(self) -> AbstractContextManager[None]:
        """Feet are found meanwhile as they were when the last state was accepted."""

    def looks(self, state: State) -> Floats:
        """Unit directions (ne, nq, 3) in which this rank's points look for the master, or the tool holds them."""

    def point(self, state: State) -> Floats | None:
        """Where moments are taken about (3,) [length]: the tool's reference point; None: there is no tool."""

    def cut_off(self, state: State) -> Floats:
        """How much nearer (ne, nq) [length] round surfaces are to each other at the points than the facets that stand for
        them, see `chords`. Collective."""

    def overlap(self, state: State, X: Floats, slave: Bools, bodies: Sequence[Ints64]) -> tuple[Floats, Floats]:
        """How deep [length] each of the bodies (local nodes, at X (n, 3)) lies in the master: of the slave surface (mask of
        local nodes), and others of the bodies; (bodies,) each."""

    def back_share(self, state: State) -> float:
        """Share of the points that see the nearest facet of a tool from behind."""


class ContactPenalties(Protocol):
    """Trials with other penalties; remedy: what to state where multipliers do not get there with these."""

    @property
    def remedy(self) -> str: ...

    def stored(self, state: State) -> float:
        """Energy in normal penalties that may be raised [force length]. Collective."""

    def raised(
        self,
        state: State,
        strain: Callable[[], float],
        cost: Callable[[], float],
        stored: tuple[float, float],
        noise: float,
    ) -> tuple[Trial, str] | None:
        """None; or, where a point lies too deep, or penalties hold or cost too much, a trial with greater ones, and words.

        strain(): energy in the bodies [force length]; cost(): part of the load; stored: in these penalties, and in those of
        all contacts, noise: what of it is rounding [force length]. Collective.
        """

    def room(self, state: State) -> float:
        """By how much the penalties may still be raised, 1 where not at all. Collective."""

    def under_multipliers(self, state: State) -> Trial:
        """Greater ones, if there is room, beneath multipliers that stay. Collective."""

    def held_back(self) -> Trial:
        """They have been raised in vain in this step: later ones may be raised half as far."""

    def raise_factor(self, state: State) -> float:
        """By how much they are greater than at first, on all ranks. Collective."""

    def softness(self, state: State) -> float:
        """The part of them under which accepted pressures sink as far as they may, or 1. Collective."""

    def softened(self, state: State, part: float) -> Trial:
        """A part of them at an accepted state; until `release` points press as they did."""

    def holding_up(self, state: State) -> Trial:
        """So great that the deepest point of an accepted state would lie as deep as it may; forces stay. Collective."""

    def stiffened(self, state: State, factor: float) -> Trial:
        """Greater by a factor at a state just accepted, as forces would follow, multipliers staying. Collective."""


class ContactMultipliers(Protocol):
    """What they leave of the error, and trials with other ones."""

    def misfit(self, state: State) -> float:
        """Largest error of this rank's points over what is allowed."""

    def held(self, state: State, trial: Trial, before: Trial, slipping: float = 1.0) -> Trial:
        """A trial judged, until `release`, so that what presses and sticks under the trial `before` does so; slipping: times
        the limit of friction of points that slip."""

    def augmented(self, state: State, pressure: float = 1.0, friction: float = 1.0) -> Trial:
        """They have taken over shares of the pressure and of the friction that the penalty carries."""


class ContactForces(Protocol):
    """What a contact's points exert at a state."""

    def split_traction(self, state: State, trial: Trial | None = None) -> tuple[Floats, Floats]:
        """Contact pressure (ne, nq) and friction traction on the slave (ne, nq, 3) [pressure, per reference area]."""

    def acting(self, state: State) -> tuple[Floats, Floats]:
        """The same as results show them: sizes (ne, nq) of what acts normal to what is pressed, and vectors (ne, nq, 3)."""

    def pressing(self, state: State) -> Floats:
        """What pressure alone exerts on the slave (ne, nq, 3) [pressure, per reference area]."""

    def round_off(self) -> Floats:
        """Pressures (ne, 1) up to which points touch by round-off alone."""

    def idle(self, state: State) -> tuple[Bools, Bools]:
        """Which points (n,) of this rank touch and carry no more than what solves leave of round-off, and which more."""

    def pressed(self, state: State, points: Bools, slight: float) -> bool:
        """Whether one of these points (n,) lies deeper than `slight` [length], and than what is round-off. Collective."""

    def status(self, state: State) -> Ints:
        """Codes (ne, nq) of kernels/status.py; open, too, is what presses by no more than round-off."""

    def measures(self, state: State) -> dict[str, Any]:
        """{name: of all ranks' points together}, as the history has them: forces, moments, counts. Collective."""

    def within_facets(self, state: State) -> float:
        """Share of the squares of the pressures that varies within facets of the master. Collective."""

    def resultants(self, state: State) -> tuple[Floats, Floats]:
        """Force on the slave (3,), summed over all ranks, and contact pressure (n,) at this rank's points. Collective."""

    def limits(self, state: State) -> Floats:
        """Largest friction tractions (ne, nq) that the pressures allow [pressure, per reference area]."""

    def rubs(self, state: State) -> tuple[Floats, Floats]:
        """Limits (ne, nq) of friction, times what it does more on ways in other planes than those of the slave's facets, and
        the shares (ne, nq) of them that it may have in its directions [pressure, per reference area; 1]."""

    def covered(self, state: State) -> Floats:
        """Shares (ne, nq) of the points' areas that lie over the master."""

    def press(self, state: State, residual: Floats, tool_residual: Floats) -> float:
        """Add what the pressures alone give, friction apart, to local forces and tools' wrenches (tools, 6); returns this
        rank's energy in their penalties [force length]."""

    def stored(self, state: State) -> float:
        """Energy [force length] in the penalties at this rank's points."""

    def grip(self, state: State) -> tuple[float, float]:
        """(friction, what its law allows): sums of their sizes over this rank's points [force]."""

    def holding(self, state: State, least: float) -> set[str]:
        """Letters of the axes along which the contact holds a body, where it presses with more than `least` [force].
        Collective."""

    def could_hold(self, state: State) -> set[str]:
        """Letters of the axes along which it can hold a body that it touches. Collective."""


class Leads(NamedTuple):
    """What leads bodies in a step: vectors (k, 3), of which each may be that of any part of them, and how far something
    turns [length], which goes in every direction; endless where nothing tells that."""

    ways: Floats
    turned: float

    def across(self, normals: Floats) -> Floats:
        """How far (n,) these lead at most across unit normals (n, 3) [length]."""
        aside = self.ways - (normals @ self.ways.T)[..., None] * normals[:, None]
        return np.maximum(np.linalg.norm(aside, axis=2).max(axis=1, initial=0.0), self.turned)

    def along(self, normals: Floats) -> Floats:
        """How far (n,) along them [length]."""
        return np.asarray(np.abs(normals @ self.ways.T).max(axis=1, initial=0.0))


class Newcomers(NamedTuple):
    """Points that come to touch within a step.

    friction: of that of all of a contact what their approach does not explain, where nothing has pressed before and they are
    all that does, otherwise none; free: the same if they may have gone any way; beside: that of points that stick, beside
    others that press; load [force]; gaps: their mean gap when the step began, and when the last one did [length].
    """

    friction: float
    free: float
    beside: float
    load: float
    gaps: tuple[float, float]


class ContactFindings(Findings, Protocol):
    """What ails a contact, beside what every term is asked for."""

    def first_touch(self, state: State, leads: Leads) -> Newcomers:
        """Of the points that were open when the step began and are led aside, where all of the load is on such as were
        open, and there was none. Collective."""

    def deep(self, state: State) -> Finding | None:
        """A point lies deep enough to be distrusted."""

    def drawn_inside(self, state: State) -> Finding | None:
        """A point lies within the master before anything has moved."""

    def pressing_edge(self, state: State) -> Finding | None:
        """An edge of the slave is what touches."""

    def cornered(self, state: State, by: Floats | None = None) -> Finding | None:
        """A point lies where two parts of a union meet; by: one beside a place (3,) of the reference [length]."""

    def between_nodes(self, state: State) -> tuple[Floats, Floats]:
        """What places between nodes would rub with more, were friction at its limit where it turns round there: forces at
        samples (m, 3), as a Trial takes them, and sums of their sizes around the points (n,) [force]. Collective."""

    def nodes_deeper(self, state: State) -> Floats:
        """How much deeper (ne, nq) [length] than the points that hold them surfaces lie around these. Collective."""

    def misstated(self, state: State) -> Finding | None:
        """The penalty that is stated is far from the stiffness of the bodies."""

    def never_met(self, state: State, greatest: float, unknown: float, as_drawn: bool) -> str | None:
        """How far away the master is where no point has touched it but by rounding; greatest: load of a step, and unknown,
        see Scales [force]; as_drawn: whether the run started from no other one's state."""


class ContactLed(Protocol):
    """What supports do to a contact's slave points."""

    def fixed(self, state: State) -> Bools:
        """Which points (ne, nq) they prescribe along the contact's normal."""


class ContactParts(Protocol):
    """The laws that can hold at a contact's points, and trials of some of them alone."""

    def laws(self, frictionless: bool) -> dict[str, int]:
        """{name: status code} of the laws that can hold at a point."""

    def part(self, mask: Bools, frictionless: bool = False) -> Trial:
        """A trial in which the points (n,) of a mask alone exert forces."""

    def branches(self, state: State, trial: Trial | None = None) -> Array:
        """Rows of codes (n, ...), the status first: where one changes the traction has a kink."""


class ContactTerm(Term, Protocol):
    """A contact.

    penetration: how deep a point may lie in the master [length], None: as the penalty alone gives; rough: is there friction;
    friction_stated: Coulomb's mu, or the numbers of a friction law by name; trial: what it is evaluated with where no other
    trial is given.
    """

    penetration: float | None
    master_name: str
    friction_stated: float | dict[str, Any]
    surface: ContactSurface
    partner: ContactPartner
    places: ContactPlaces
    penalties: ContactPenalties
    multipliers: ContactMultipliers
    trial: Trial
    forces: ContactForces
    findings: ContactFindings
    led: ContactLed
    parts: ContactParts

    @property
    def rough(self) -> bool: ...

    def response(self, state: State, trial: Trial | None = None) -> Response:
        """What the points do at a state."""

    def take(self, trial: Trial) -> None:
        """Go on with this trial, until the next rollback or commit."""

    def hold_sights(self, state: State) -> bool:
        """Hold what looks towards the samples of averages until a commit or rollback; False where that changes nothing.
        Collective."""

    def resample(self, state: State) -> bool:
        """Choose the samples of averages anew where the surfaces lie, until a rollback; False where there are none, or what
        looks towards them is held. Collective."""

"""What solvers and the output ask of a contact; of what is its own they know that it can be handed back: `Any`."""

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
        ...

    @property
    def count(self) -> int: ...


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
    def nodes(self) -> Ints: ...

    def gives(self, held: Array) -> bool: ...

    def foreseen(self, feet: Any, before: Any, trial: Trial) -> Floats: ...

    def carried_on(self, trial: Trial, share: float) -> Floats: ...

    def ahead(self, feet: Any, before: Any, trial: Trial) -> Floats:
        """Of the n points that slipped in the tangent `before`: how far (n, 2) each lay ahead of its anchor there, and does
        at these feet, along the friction that it had there, times its size; (0, 2): that is not looked for."""
        ...


class ContactPlaces(Protocol):
    """Where the points are at a state, as the partner sees them. Collective."""

    def feet(self, state: State) -> Any: ...

    def first_feet(self, state: State) -> Any:
        """The same of a search that looks farther, not kept."""
        ...

    def as_accepted(self) -> AbstractContextManager[None]:
        """Feet are found meanwhile as they were when the last state was accepted."""
        ...

    def looks(self, state: State) -> Floats: ...

    def point(self, state: State) -> Floats | None:
        """Where moments are taken about (3,) [length]: the tool's reference point; None: there is no tool."""
        ...

    def cut_off(self, state: State) -> Floats:
        """How much nearer (ne, nq) [length] round surfaces are to each other at the points than the facets that stand for
        them, see `chords`. Collective."""
        ...

    def overlap(self, state: State, X: Floats, slave: Bools, bodies: Sequence[Ints64]) -> tuple[Floats, Floats]: ...

    def back_share(self, state: State) -> float: ...


class ContactPenalties(Protocol):
    """Trials with other penalties; remedy: what to state where multipliers do not get there with these."""

    @property
    def remedy(self) -> str: ...

    def stored(self, state: State) -> float: ...

    def raised(
        self,
        state: State,
        strain: Callable[[], float],
        cost: Callable[[], float],
        stored: tuple[float, float],
        noise: float,
    ) -> tuple[Trial, str] | None: ...

    def room(self, state: State) -> float: ...

    def under_multipliers(self, state: State) -> Trial: ...

    def held_back(self) -> Trial: ...

    def raise_factor(self, state: State) -> float: ...

    def softness(self, state: State) -> float: ...

    def softened(self, state: State, part: float) -> Trial: ...

    def holding_up(self, state: State) -> Trial: ...

    def stiffened(self, state: State, factor: float) -> Trial: ...


class ContactMultipliers(Protocol):
    """What they leave of the error, and trials with other ones."""

    def misfit(self, state: State) -> float: ...

    def held(self, state: State, trial: Trial, before: Trial, slipping: float = 1.0) -> Trial: ...

    def augmented(self, state: State, pressure: float = 1.0, friction: float = 1.0) -> Trial: ...


class ContactForces(Protocol):
    """What a contact's points exert at a state."""

    def split_traction(self, state: State, trial: Trial | None = None) -> tuple[Floats, Floats]: ...

    def acting(self, state: State) -> tuple[Floats, Floats]: ...

    def pressing(self, state: State) -> Floats: ...

    def round_off(self) -> Floats: ...

    def idle(self, state: State) -> tuple[Bools, Bools]: ...

    def pressed(self, state: State, points: Bools, slight: float) -> bool: ...

    def status(self, state: State) -> Ints: ...

    def measures(self, state: State) -> dict[str, Any]: ...

    def within_facets(self, state: State) -> float:
        """Share of the squares of the pressures that varies within facets of the master. Collective."""
        ...

    def resultants(self, state: State) -> tuple[Floats, Floats]: ...

    def limits(self, state: State) -> Floats: ...

    def rubs(self, state: State) -> tuple[Floats, Floats]: ...

    def covered(self, state: State) -> Floats: ...

    def press(self, state: State, residual: Floats, tool_residual: Floats) -> float: ...

    def stored(self, state: State) -> float: ...

    def grip(self, state: State) -> tuple[float, float]: ...

    def holding(self, state: State, least: float) -> set[str]: ...

    def could_hold(self, state: State) -> set[str]: ...


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
        ...

    def deep(self, state: State) -> Finding | None: ...

    def drawn_inside(self, state: State) -> Finding | None: ...

    def pressing_edge(self, state: State) -> Finding | None: ...

    def cornered(self, state: State, by: Floats | None = None) -> Finding | None: ...

    def between_nodes(self, state: State) -> tuple[Floats, Floats]: ...

    def nodes_deeper(self, state: State) -> Floats:
        """How much deeper (ne, nq) [length] than the points that hold them surfaces lie around these. Collective."""
        ...

    def misstated(self, state: State) -> Finding | None: ...

    def never_met(self, state: State, greatest: float, unknown: float, as_drawn: bool) -> str | None: ...


class ContactLed(Protocol):
    """What supports do to a contact's slave points."""

    def fixed(self, state: State) -> Bools: ...


class ContactParts(Protocol):
    """The laws that can hold at a contact's points, and trials of some of them alone."""

    def laws(self, frictionless: bool) -> dict[str, int]: ...

    def part(self, mask: Bools, frictionless: bool = False) -> Trial: ...

    def branches(self, state: State, trial: Trial | None = None) -> Array: ...


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

    def response(self, state: State, trial: Trial | None = None) -> Response: ...

    def take(self, trial: Trial) -> None: ...

    def hold_sights(self, state: State) -> bool: ...

    def resample(self, state: State) -> bool: ...

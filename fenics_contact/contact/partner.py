"""Whom slave points meet: what a contact asks of a rigid tool, of another body's facets, or of a meshed tool."""

from typing import Any, Protocol

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.contact_term import ContactPartner, ContactPlaces
from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import PRESENT, Response, Trial
from fenics_contact.contact.crossing import Crossed, Crossing
from fenics_contact.contact.entered import Entered
from fenics_contact.contact.friction import Friction
from fenics_contact.contact.meeting import Sights
from fenics_contact.contact.surface import Beside, SlaveSurface
from fenics_contact.types import Anchors, Array, Bools, Floats, Ints, Ints64


class Places(ContactPlaces, Protocol):
    """Where the points are at a state, as the partner sees them: their feet, and how the bodies lie to each other there.

    search: gaps from this on are not told apart [length]; reach: largest length that gaps are differences of, beside the
    slave's coordinates [length]. Collective where a state is taken.
    """

    search: float
    reach: float

    @property
    def sights(self) -> Sights | None:
        """Which facets look towards the samples of averages, where it has such."""

    def normals(self, feet: Any) -> Floats:
        """Unit normals (ne, nq, 3) along which pressure acts on this rank's points; zero without a partner."""

    def bare(self, feet: Any, far: bool = False) -> Floats:
        """Shares of the points' areas that do not lie over the master; far: however far away it is."""

    def features(self, feet: Any) -> Array:
        """Codes (n, ...): where one changes the traction has a kink."""

    def node_gaps(self, state: State, nodes: Array, X: Floats) -> Floats:
        """Gaps (n,) of local slave nodes at reference positions X (n, 3), endless where there are none [length].
        Collective."""

    def entered(self, state: State, nearly: float = 1.0, normals: Floats | None = None) -> Entered | None:
        """The slave's facets that the master has entered between their points, nearly: see `entered`; normals (n, 3): of the
        body at its nodes, in the place of those of facets. None where that is not looked for."""

    @property
    def crossing(self) -> Crossing | None: ...

    def crossed(self, state: State) -> Crossed | None:
        """Nodes of either surface behind the other's facets; None where the master has none. Collective."""

    def beside(self, state: State) -> Beside | None:
        """The nodes off the slave surface that may meet a tool; None where they are not looked for. Collective."""

    def lost_depth(self, state: State, trial: Trial) -> float:
        """Depth [length] of the deepest point, or sample, too deep in the master to have a partner, or zero. Collective."""

    def passed(self, state: State, trial: Trial) -> tuple[Floats, Floats] | None:
        """How deep (n,) places of the slave have been led through the master and out of it behind them, and their reference
        positions (n, 3) [length]; None where points without a partner tell of that."""


class Anchoring(Protocol):
    """From where the points' friction grows."""

    def none(self) -> Anchors: ...

    def here(self, feet: Any, trial: Trial) -> Anchors:
        """The points' places on the master."""

    def resting(self, feet: Any, trial: Trial) -> Anchors:
        """Where points that came to rest here slip from."""

    def committed(self, feet: Any, trial: Trial) -> tuple[Anchors, Floats]:
        """The anchors to keep when a step is accepted, and the ways in it (ne, nq) of points that do not stick [length]."""

    def slips(self, feet: Any, trial: Trial, status: Ints) -> Floats:
        """What is wrong (ne, nq) in the ways of points since they came to rest: what the penalty gave way in stick, and in
        slip what is not along the friction; 0 for others [length]."""

    def slid(self, feet: Any, trial: Trial, status: Ints) -> tuple[Floats, Floats]:
        """How far points that slip (ne, nq) have come from where they rested last, 0 for others, and the way on which their
        friction has worked: with the multipliers that it has now it turns into the way's direction as it slips. Points that
        have opened worked until then: all of their way, on which their friction falls to none [length]."""

    def augmented(self, feet: Any, trial: Trial, status: Ints, share: float) -> Anchors:
        """Uzawa's update of friction by a share: anchors under which the multiplier of a point that sticks or slips is the
        friction that it has now, within its limit. Friction then grows by eps_T times the slip once more: where points went
        as their old friction pushed them it falls below its limit, and they stick."""

    def stiffened(self, feet: Any, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Those that penalties greater by a factor need for points that slip on from where they rest as they do."""

    def chosen(self, points: Bools, ours: Anchors, others: Anchors) -> Anchors:
        """Our anchors at some points (ne, nq), the others elsewhere."""

    def packed(self, anchors: Anchors, feet: Any, name: str) -> dict[str, Array]:
        """Arrays (ne, ...) by names that begin with this one, which no partition changes."""

    def unpacked(self, values: dict[str, Array], name: str) -> Anchors:
        """The anchors that `packed` gave."""


class Partner(ContactPartner, Protocol):
    """What the points meet, and the forces there, which depend on feet and a Trial alone.

    softens: may penalties be softer on the way to a solution; smooth: have forces without friction a potential; slid_off:
    what to do where the slave has left the master.
    """

    name: str
    surface: SlaveSurface
    softens: bool
    smooth: bool
    slid_off: str

    @property
    def places(self) -> Places: ...

    @property
    def anchors(self) -> Anchoring: ...

    def resampled(self, trial: Trial, feet: Any) -> Trial:
        """The trial with points chosen anew where the surfaces lie at feet, for the rest of a step. Collective."""

    def return_to(self, trial: Trial) -> None:
        """To the points of a trial that was the present one before."""

    def sites(self, feet: Any) -> dict[str, Array]:
        """Arrays (ne, ...), which no partition changes, that tell where points chosen so are. Collective."""

    def put_sites(self, values: dict[str, Array], state: State) -> None:
        """Choose the points that `sites` told of."""

    def response(self, feet: Any, trial: Trial) -> Response:
        """What the points do at these feet."""

    def deciding(self, feet: Any, before: Trial, trial: Trial, gaps: Floats, wide: Floats) -> Floats:
        """What decides in a trial, as `Trial.judged` has it: gaps (ne, nq), shifts added, and that points slip as they did
        under the trial `before`, where limits of friction `wide` (ne, nq) times as great let them stick."""

    def add_forces(self, feet: Any, response: Response, residual: Floats, tool_residual: Floats) -> None:
        """Add area T to local forces on the slave, and its opposite to those on the master, or to tools' wrenches
        (tools, 6), (14)."""

    def on_slave(self, feet: Any, response: Response) -> tuple[Floats, Floats]:
        """Places and forces (n, 3) at the slave's nodes, which all ranks' together are what acts on the slave body, as
        `add_forces` adds it [length, force]."""

    def friction(self, feet: Any, trial: Trial) -> Friction:
        """The law of friction at these feet, with what directions it has there."""

    def tangent(self, feet: Any, trial: Trial) -> Blocks:
        """Blocks of the exact derivative of what `add_forces` adds."""

    def couplings(self, feet: Any, trial: Trial) -> Ints64 | None:
        """See `Term.couplings`."""

    def lean(self, feet: Any, trial: Trial) -> Floats:
        """Of averages: sums over this rank's samples of what acts aside, of the load and of friction (14,) [force]."""

    def more_friction(self, feet: Any, trial: Trial) -> tuple[Floats, Floats]:
        """What averages would rub with more between nodes, see `turning`: forces on the master at samples (m, 3), and sums
        of their sizes around the points (n,) [force]."""

    def held_axes(self, state: State, gap: Floats, rough: bool) -> set[str]:
        """Letters of the axes along which the contact can hold a body whose points have these gaps (ne, nq) [length]; rough:
        with friction. Collective."""


def slid_since(then: Any, now: Any, at: Ints64, under: tuple[Ints64, Floats]) -> Floats:
    """What points have gone (..., 3) over the master since they touched it [length].

    then, now: feet as a step began and now; at (...): numbers of the points; under: nodes (..., m) of the facets beneath
    them now, and their shape functions there. The way before, through the air, is no slip: they are taken to come nearer
    evenly.
    """
    gaps, normals, (nodes, shapes) = now.projection[4][at], now.projection[5][at], under
    gone = (now.coords - then.coords)[nodes]
    ways = (now.points - then.points)[at] - np.einsum("...m,...mc->...c", shapes, gone)
    nearer = -np.einsum("...c,...c->...", ways, normals)
    above = gaps + nearer > 0.0  # when the step began
    share = np.where(above, np.clip(-gaps / np.where(nearer > 0.0, nearer, 1.0), 0.0, 1.0), 1.0)
    return share[..., None] * ways


def worked(pulled: Floats, slip: Floats) -> Floats:
    """The way (...) on which friction works while its trial traction over eps_T grows by the slip (..., 3) to pulled
    (..., 3): the integral of its direction along the slip [length]."""
    return np.linalg.norm(pulled, axis=-1) - np.linalg.norm(pulled - slip, axis=-1)


def weighed(foreseen: Floats, found: Floats, share: Floats) -> Floats:
    """Ways (..., 3) that decide what slips: foreseen ones, with a share (..., 3 or 1) of those found. A point that has slid
    against what rubs it has none: it sticks before it slides that way."""
    turned = np.einsum("...c,...c->...", foreseen, found)[..., None] < 0.0
    return foreseen + np.where(turned, 0.0, share) * (found - foreseen)


def strayed(pulled: Floats, slip: Floats) -> Floats:
    """What of a slip (..., 3) friction cannot work on: all but what is along its trial traction over eps_T, pulled (..., 3);
    all where there is none [length]."""
    along, square = (np.einsum("...c,...c->...", pulled, one) for one in (slip, pulled))
    part = np.where(along > 0.0, along / np.where(square > 0.0, square, 1.0), 0.0)
    return slip - part[..., None] * pulled


class SingleAnchors:
    """What anchors have in common where each slave point has its own, by itself."""

    def _committed(self, feet: Any, trial: Trial, touch: float | None) -> tuple[Anchors, Floats]:
        """As `committed`; touch [length]: gaps up to it count as closed, None: those that the law says."""
        raise NotImplementedError

    def here(self, feet: Any, trial: Trial) -> Anchors:
        """The points' places on the master."""
        return self._committed(feet, trial, -np.inf)[0]

    resting = here

    def committed(self, feet: Any, trial: Trial) -> tuple[Anchors, Floats]:
        """The anchors to keep when a step is accepted, and the ways in it (ne, nq) of points that do not stick [length]."""
        return self._committed(feet, trial, None)

    def chosen(self, points: Bools, ours: Anchors, others: Anchors) -> Anchors:
        """Our anchors at some points (ne, nq), the others elsewhere."""
        return tuple(
            np.where(points.reshape(one.shape[:-1])[..., None], one, two) for one, two in zip(ours, others, strict=True)
        )


class PointPressures:
    """What partners have in common whose slave points press each by itself; averages say otherwise."""

    slid_off = "make the master's surface larger where the slave leaves it, raise the penalty, or end the path before"

    def resampled(self, trial: Trial, feet: Any) -> Trial:
        """The same: points stay where they are on the slave."""
        return trial

    def return_to(self, trial: Trial) -> None:
        """Nothing to do: they have stayed."""

    def sites(self, feet: Any) -> dict[str, Array]:
        """Nothing to keep."""
        return {}

    def put_sites(self, values: dict[str, Array], state: State) -> None:
        """Nothing to take up."""

    def deciding(self, feet: Any, before: Trial, trial: Trial, gaps: Floats, wide: Floats) -> Floats:
        """See `Partner.deciding`: by so much greater pressures, for ways decide as they are."""
        return (wide * gaps).ravel()

    def found(self, feet: Any, trial: Trial) -> Floats:
        """(0,): points stay where they are."""
        return PRESENT

    def carried_on(self, trial: Trial, share: float) -> Floats:
        """Gaps (ne nq,), shifts added, of the last accepted step, carried on by a share of the change in it."""
        return trial.history.carried_on(share)

    def ahead(self, feet: Any, before: Any, trial: Trial) -> Floats:
        """See `ContactPartner.ahead`: not looked for."""
        return np.empty((0, 2))

    def lean(self, feet: Any, trial: Trial) -> Floats:
        """Nothing: it is asked of averages alone."""
        return np.zeros(14)

    def more_friction(self, feet: Any, trial: Trial) -> tuple[Floats, Floats]:
        """Nothing: each rubs by its own way."""
        return np.empty((0, 3)), np.zeros(trial.area.size)

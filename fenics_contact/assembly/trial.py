"""What the forces of a contact depend on besides the state, and what they are: plain values, never changed in place."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.kernels.law import SMOOTH, Friction
from fenics_contact.types import Anchors, Bools, Floats, Ints

if TYPE_CHECKING:
    from fenics_contact.assembly.contact_term import ContactTerm

PRESENT: Floats = np.empty(0)
NOTHING: Floats = np.empty((0, 3))
ENDLESS = 1e12  # coefficient of friction under which every point in contact sticks
# Of a cell's height: gaps up to that are none at the start, surfaces drawn in contact carry them.
DRAWN = 1e-10


@dataclass(frozen=True, eq=False)
class ContactLaw:
    """Penalties eps_n, eps_t (ne,) [pressure/length] of the slave elements, Friction, and touch [length]: gaps up to it are
    round-off and closed, slips up to it are none."""

    eps_n: Floats
    eps_t: Floats
    friction: Friction
    touch: float

    def times(self, factor: float) -> "ContactLaw":
        """The law with penalties greater by a factor."""
        return replace(self, eps_n=self.eps_n * factor, eps_t=self.eps_t * factor)


@dataclass(frozen=True, eq=False)
class History:
    """What the accepted steps, and within a step the multipliers, leave behind at ne elements of nq slave points.

    anchors: from where a point's friction traction grows, (16); rests: where points that stick came to rest; before: the
    anchors at the start of the step accepted last; shift (ne, nq): multipliers over eps_n, by which points press more than
    their gaps do [length]; slip_path (ne, nq): way slid so far [length]; met (ne, nq): whether a point has been in contact;
    gaps: with shifts, when a step was last accepted and before (ne nq,) [length]; raised (ne, 2): how much greater the
    penalties are than at first, and how much they may become at most; feet: where the points were when a step was last
    accepted, as the master sees them; rubbed (ne, nq): way on which friction has worked in this run [length]; faced: most
    area that has been in contact and lay over the master at once [length^2].
    """

    anchors: Anchors
    rests: Anchors
    before: Anchors
    shift: Floats
    slip_path: Floats
    met: Bools
    gaps: tuple[Floats, Floats]
    raised: Floats
    feet: Any
    rubbed: Floats
    faced: float = 0.0

    def carried_on(self, share: float) -> Floats:
        """Gaps, shifts added, carried on from those of the last accepted step by a share of the change in it."""
        now, before = self.gaps
        # a pressure doubles or halves at most: it stays one, and what was open before gives no slope
        return np.where(now < 0.0, np.clip(now + share * (now - before), 2.0 * now, 0.5 * now), now)


@dataclass(frozen=True, eq=False)
class Trial:
    """Law and history that a contact is evaluated with; area (ne, nq): reference areas of its points [length^2]; judged
    (ne nq,): gaps, shifts added, that decide what is open and what slips in the place of the present ones; (0,): these;
    rubs (np, 3): what samples of averages rub with besides [force]; (0, 3): nothing."""

    law: ContactLaw
    history: History
    area: Floats
    judged: Floats = field(default_factory=lambda: PRESENT)
    rubs: Floats = field(default_factory=lambda: NOTHING)

    @property
    def rough(self) -> bool:
        """Whether there is friction."""
        return self.law.friction.mu > 0.0

    def rubbing(self, more: Floats) -> "Trial":
        """With more friction (np, 3) at the samples of averages [force]."""
        return replace(self, rubs=more)

    def under(self, law: ContactLaw) -> "Trial":
        return replace(self, law=law)

    def with_friction(self, mu: float) -> "Trial":
        """With another coefficient of friction."""
        return replace(self, law=replace(self.law, friction=SMOOTH._replace(mu=mu)))

    def remembering(self, **changes: Any) -> "Trial":
        """With some of the history changed."""
        return replace(self, history=replace(self.history, **changes))

    def nearer(self, by: Floats) -> "Trial":
        """All gaps smaller by (ne, nq) [length]."""
        return self.remembering(shift=self.history.shift - by)

    def judging(self, gaps: Floats = PRESENT) -> "Trial":
        """Judged by these gaps; by the present ones it is the same object where it was so before."""
        return replace(self, judged=gaps) if len(gaps) or len(self.judged) else self

    def only(self, points: Bools) -> "Trial":
        """In which the points (n,) of a mask alone exert forces."""
        return replace(self, area=np.where(points.reshape(self.area.shape), self.area, 0.0))


Trials = Mapping["ContactTerm", Trial]  # with what contacts are evaluated in the place of their own


@dataclass(frozen=True, eq=False)
class Response:
    """What ne elements of nq slave points do in a state.

    traction (ne, nq, 3): T of (14) [pressure, per reference area], -T acts on the slave; gap (ne, nq) [length]; status (ne,
    nq): codes of kernels/status.py; cover (ne, nq): share of eps_n, below one where a point slides out under a sharp edge;
    forces: sums of area T at the nodes, as the master numbers them; split: pressure (ne, nq) and friction on the slave (ne,
    nq, 3), where T is a mean over normals that may differ; power (ne, nq): friction's over what it has on ways in the
    slave's facets, where it acts in others; acting: as split, of the forces: across and along what is
    pressed, which lies aslant to the slave's facet at its ends and creases, and where it is round.
    """

    traction: Floats
    gap: Floats
    status: Ints
    cover: Floats
    forces: Floats
    split: tuple[Floats, Floats] | None = None
    power: Floats | None = None
    acting: tuple[Floats, Floats] | None = None

"""Stabilisation of bodies and tools that nothing holds yet: soft springs whose far ends follow until they pull no more."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import RIGID_MOTION, Finding
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.size import bodies_size
from fenics_contact.assembly.spring_term import Springs, SpringTerm
from fenics_contact.assembly.term import Findings, State
from fenics_contact.types import Array, Bools

SHARE = 1e-2  # stiffness of the springs over E V / L^2 of a body of volume V and size L: a hundredth of its own
SOFTER = 0.25  # change of stiffness where the springs pull as before: nothing has been met yet
LEAST = 1e-6  # of that stiffness
FAR = 10.0  # sizes of the bodies: no gap is wider
CLOSER = "close gaps, hold what tips over or rolls, fix a surface, or turn the load towards the contact"


class Grounding(SpringTerm):
    """Springs to u_0, at first the last accepted state.

    Within a load step u_0 follows u, solve by solve, until the springs pull less than ALLOWED of the largest force
    (proximal point iteration, Rockafellar 1976, doi:10.1137/0314056): what balances then is the scene without them. It
    may do so with any stiffness: springs that pull as before become softer, those too soft for Newton's method stiffer.
    always: asked for by the user, in every step; else in those alone for which they are engaged; among: what gives the
    strain energy over that at rest [force length], with which theirs is compared, and the contacts; state: the first one, as
    accepted.
    """

    def __init__(
        self,
        springs: Springs,
        free: Callable[[], Bools],
        always: bool,
        among: tuple[Callable[[], float], Sequence[ContactTerm]],
        state: State,
    ) -> None:
        super().__init__("stabilisation", *springs, free)
        self._pull: float | None = None  # at the state evaluated last, and before
        self._before: float | None = None
        self._left, self._engaged, self._softest = 0.0, False, LEAST * SHARE
        self.always, self.findings = always, Carrying(self)
        # accepted steps with springs in, and the largest of all they held then [force length]
        self.most = {"steps": 0.0, "energy": 0.0, "energy_share": 0.0}
        self._strain_energy, self._contacts = among
        self._far = FAR * bodies_size(state.u.function_space)
        self._accept(state)
        self.engage(always)

    def _accept(self, state: State) -> None:
        self._last = state.u.x.array.copy(), state.q.copy()

    @property
    def engaged(self) -> bool:
        return self._engaged

    def engage(self, wanted: bool) -> None:
        """Put the springs in, from the last accepted state on, or take them out. Collective."""
        self._engaged, self._left = wanted, 0.0
        self.rollback()

    def rollback(self) -> None:
        if self._pull is not None:
            self._left = self._pull
        self._pull, self._softest = None, LEAST * SHARE
        self.resist(SHARE if self._engaged else 0.0)
        self.begin(*self._last)

    def pull(self, state: State, allowed: float) -> float:
        """Pull of the springs over what is allowed [force]. Collective."""
        force, _ = self.spent(state)
        pull = force / allowed if allowed > 0.0 else 0.0
        self._before, self._pull = self._pull, pull
        return pull

    def follow(self, state: State) -> None:
        """Let the far ends go to where the state is, with softer springs where these pulled as before."""
        if self._before is not None and self._pull is not None and self._pull > 0.5 * self._before:
            self.resist(max(SOFTER * self.share, self._softest))
        self.begin(state.u.x.array, state.q)

    def ahead(self, state: State) -> float:
        """Solves that it takes at the rate of the last one until they pull no more, or until bodies and tools have gone FAR,
        on which they may meet something; 0 where the springs may still become softer. Collective."""
        if self._before is None or self._pull is None or self.share > self._softest:
            return 0.0
        fading = np.log(self._pull) / np.log(self._before / self._pull) if self._before > self._pull else np.inf
        way = state.way_from(self._reference.x.array, self._q)
        left = self._far - state.way_from(*self._last)
        return min(fading, left / way if left > 0.0 < way else np.inf)

    def stiffen(self) -> bool:
        """Take stiffer springs, and no softer ones within this step; False where they are as stiff as at first."""
        if self.share >= SHARE:
            return False
        self._softest = min(self.share / SOFTER, SHARE)
        self.resist(self._softest)
        return True

    @contextmanager
    def faint(self) -> Iterator[None]:
        """Springs are as soft as they become meanwhile: what is asked is how the bodies give way by themselves."""
        share = self.share
        self.resist(min(share, LEAST * SHARE))
        try:
            yield
        finally:
            self.resist(share)

    @contextmanager
    def away(self) -> Iterator[None]:
        """The accepted state is looked at without springs meanwhile."""
        engaged = self._engaged
        self.engage(False)
        try:
            yield
        finally:
            self.engage(engaged)

    def commit(self, state: State) -> None:
        self._accept(state)
        if not self._engaged:
            return
        energy, elastic = 0.5 * self.spent(state)[1], self._strain_energy()
        share = energy / elastic if elastic > 0.0 else 0.0
        energy, share = max(energy, self.most["energy"]), max(share, self.most["energy_share"])
        self.most = {"steps": self.most["steps"] + 1.0, "energy": energy, "energy_share": share}
        self._pull, self._softest = None, LEAST * SHARE
        self.resist(SHARE)
        self.begin(state.u.x.array, state.q)

    def restore(self, values: dict[str, Array], state: State) -> None:
        """The springs begin anew at the accepted state."""
        self._accept(state)
        self.rollback()

    @property
    def carries(self) -> bool:
        """Whether the springs held much of the load when they were taken back last."""
        return self._left * ALLOWED > 0.1

    def passed(self) -> list[str]:
        """Names of the contacts whose points are so far apart that a tool may pass between them."""
        return [contact.name for contact in self._contacts if _single(contact.surface)]


class Carrying(Findings):
    """What ails springs that hold what nothing else does."""

    def __init__(self, springs: Grounding) -> None:
        self._springs = springs

    def trouble(self, state: State) -> Finding | None:
        if not self._springs.carries:
            return None
        text = "the stabilisation still carries the load: no contact that has been met holds the bodies"
        remedy = CLOSER
        if single := [f"'{name}'" for name in self._springs.passed()]:
            remedy = f"take points=3 in contact {' and '.join(single)}, for a tool passes between single ones; or {remedy}"
        return Finding(RIGID_MOTION, text, remedy=remedy)


def _single(surface: Any) -> bool:
    """Whether a contact has one Gauss point a facet."""
    return surface.gradients is not None and surface.area.shape[1] == 1

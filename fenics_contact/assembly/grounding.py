"""Stabilisation of bodies and tools that nothing holds yet: soft springs whose far ends follow until they pull no more."""

from fenics_contact.assembly.finding import RIGID_MOTION, Finding
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.spring_term import SpringTerm

SHARE = 1e-2  # stiffness of the springs over E V / L^2 of a body of volume V and size L: a hundredth of its own
SOFTER = 0.25  # change of stiffness where the springs pull as before: nothing has been met yet
LEAST = 1e-6  # of that stiffness


class Grounding(SpringTerm):
    """Springs to u_0, at first the last accepted state.

    Within a load step u_0 follows u, solve by solve, until the springs pull less than ALLOWED of the largest force
    (proximal point iteration, Rockafellar 1976, doi:10.1137/0314056): what balances then is the scene without them.
    always: asked for by the user, in every step; else in those alone for which `engaged` is set.
    """

    def __init__(self, springs, free, always):
        super().__init__("stabilisation", *springs, free)
        self._pull, self._left, self._engaged = None, 0.0, False
        self.always, self.used = always, False
        self.most = {"energy": 0.0, "energy_share": 0.0}  # largest of all accepted steps, [force length]

    def bind(self, system):
        """Forces are compared with the largest of this System; the committed state is where its springs begin."""
        self._system = system
        self.engaged = self.always

    @property
    def engaged(self):
        return self._engaged

    @engaged.setter
    def engaged(self, wanted):
        """Put the springs in, from the last accepted state on, or take them out. Collective."""
        self._engaged, self._left, self.used = wanted, 0.0, self.used or wanted
        self.rollback()

    def rollback(self):
        if self._pull is not None:
            self._left = self._pull
        self._pull, self.share = None, SHARE if self._engaged else 0.0
        self.begin(*self._system.committed)

    def pull(self, state):
        """Pull of the springs over the largest force, over what is allowed. Collective."""
        force, _ = self.spent(state)
        largest = max(self._system.forces, self._system.force_scale)
        pull = force / (largest * ALLOWED) if largest > 0.0 else 0.0
        self._before, self._pull = self._pull, pull
        return pull

    def follow(self, state):
        """Let the far ends go to where the state is, with softer springs where these pulled as before."""
        if self._before is not None and self._pull > 0.5 * self._before:
            self.share = max(SOFTER * self.share, LEAST * SHARE)
        self.begin(state.u.x.array, state.travel)

    def commit(self, state):
        if not self._engaged:
            return
        energy, elastic = 0.5 * self.spent(state)[1], self.strain_energy(state)
        share = energy / elastic if elastic > 0.0 else 0.0
        self.most = {"energy": max(energy, self.most["energy"]), "energy_share": max(share, self.most["energy_share"])}
        self._pull, self.share = None, SHARE
        self.begin(state.u.x.array, state.travel)

    def trouble(self, state):
        if self._left * ALLOWED > 0.1:
            text = "the stabilisation still carries the load: no contact has been met that holds the bodies"
            return Finding(RIGID_MOTION, text, remedy="close the gap, fix a surface, or turn the load towards the contact")
        return None

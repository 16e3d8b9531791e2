"""How large forces are in a run, and what they can be known to: by that a state is judged to be in balance."""

import numpy as np

from fenics_contact.types import Vec

TOLERANCE = 1e-8  # out-of-balance share at which steppers call a state balanced, unless told otherwise
UNSTRAINED = 1e-4  # of the stiffest node's resistance to the way that bodies have gone: what forces are compared with there
ROUNDED = 4.0 * np.finfo(float).eps  # units in the last place by which gaps and positions are known


class Scales:
    """Forces and stiffness that have been seen.

    displacement: as a PETSc vector; extent: of the bodies; reach: largest length of which gaps are differences [length].
    forces: largest norm of a single term, reactions included, at the state assembled last, accepted: in any accepted state
    [force]; stiffness: largest diagonal entry of any tangent [force/length]; farthest: the greatest `moved` of any accepted
    state [length].
    """

    def __init__(self, displacement: Vec, extent: float, reach: float) -> None:
        self._displacement, self._extent, self._reach = displacement, extent, reach
        self.forces = self.accepted = self.stiffness = self.farthest = 0.0
        self._accepted_stiffness = 0.0

    @property
    def largest(self) -> float:
        """The largest force of any term, now or before [force]."""
        return max(self.forces, self.accepted)

    @property
    def noise(self) -> float:
        """Out-of-balance force [force] that the last places of the coordinates make: no iteration gets below it."""
        return float(self.stiffness * ROUNDED * self._reach)

    @property
    def noise_energy(self) -> float:
        """Energy [force length] that the last places of the coordinates make, in bodies at rest too."""
        return self.noise * self._extent

    @property
    def moved(self) -> float:
        """The largest displacement of a node along an axis [length]. Collective."""
        # no norm of PETSc's: it keeps the one it knows, and an array that is written past it changes nothing
        here = np.abs(self._displacement.array_r).max(initial=0.0)
        return float(max(self._displacement.comm.tompi4py().allgather(here)))

    @property
    def balance(self) -> float:
        """What out-of-balance forces are compared with [force]: the largest force. Collective.

        A body that moves without strain has no other scale than rounding.
        """
        return max(self.largest, UNSTRAINED * self.stiffness * self.moved, self.noise / TOLERANCE)

    @property
    def unknown(self) -> float:
        """Force [force] that may be out of balance, though balance is found, where bodies carry none: less is not known."""
        return max(TOLERANCE * UNSTRAINED * self.stiffness * self.farthest, self.noise)

    def meet(self, forces: float) -> None:
        """The largest norm of a single term at the state at hand [force]."""
        self.forces = forces

    def meet_stiffness(self, stiffness: float) -> None:
        """The largest diagonal entry of the tangent at hand [force/length]."""
        self.stiffness = max(self.stiffness, stiffness)

    def go_by(self, accepted: float) -> None:
        """Take for the largest force of accepted states this one: states since were of no load path [force]."""
        self.accepted = accepted

    def commit(self) -> None:
        """The state is accepted. Collective."""
        self.accepted, self._accepted_stiffness = self.largest, self.stiffness
        self.farthest = max(self.farthest, self.moved)

    def rollback(self) -> None:
        """Back to the accepted state: forces and stiffness of an iterate astray must not loosen what counts as balance."""
        self.forces, self.stiffness = 0.0, self._accepted_stiffness

    def resume(self, accepted: float, stiffness: float) -> None:
        """Go on from what another run had at its accepted state."""
        self.accepted = accepted
        self.stiffness = self._accepted_stiffness = stiffness

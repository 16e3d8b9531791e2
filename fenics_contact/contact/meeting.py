"""Where the samples of averaged contacts meet another body, and what a tangent there knew."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.pose import Pose
from fenics_contact.contact.mirrors import Standing
from fenics_contact.contact.pairing import Pairing, Seek, Walled, in_sight
from fenics_contact.contact.samples import Samples
from fenics_contact.kernels import mortar as kernel
from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.coverage import Sight
from fenics_contact.kernels.facets import Surface
from fenics_contact.timing import Timers
from fenics_contact.types import Bools, Floats, Ints64


class MortarFeet(NamedTuple):
    """Positions coords (nx, 3) of all slave nodes, then of all master nodes; points (np, 3) of the samples; lengths (np,) of
    their mean normals; normals (ng, 3) and turns (ns, 3, 4) of kernels/normals.py; what the means meet; pose: of a tool;
    standing: planes of symmetry there, and kept (ns, 3, 3): as of Slaves."""

    samples: Samples
    coords: Floats
    points: Floats
    lengths: Floats
    normals: Floats
    turns: Floats
    met: kernel.Met
    pose: Pose | None
    standing: Standing
    kept: Floats

    @property
    def projection(self) -> Projection:
        return self.met[:6]

    @property
    def seated(self) -> Bools:
        """Which of the samples around each slave node (ns, J) have a foot."""
        table = self.samples.table
        return (table >= 0) & (self.projection[1] != NONE)[table]

    def pairs(self, facets: Surface, anchors: kernel.Anchors) -> kernel.Pairs:
        """Samples and the master's facets, as kernels/mortar.py takes them."""
        return self.coords, self.samples.slaves._replace(kept=self.kept), facets, self.met, anchors, self.normals


class Linearised(NamedTuple):
    """What a tangent knew: where the samples were, tractions N (ns,), T_T (ns, 3) of the nodes, and their rates."""

    feet: MortarFeet
    N: Floats
    T: Floats
    rates: Floats


NO_FACETS = np.empty(0, dtype=np.int64)


class Sights:
    """Which facets of the master look towards the samples: judged wherever these are, or held as it was at some feet.

    Beside a crease of the master a foot on its far side comes and goes with that, and the mean of a node jumps. So it does
    beyond a corner of its end, where two facets, continued, are missed by as little: a sample that misses the master keeps
    the one that it has while sights are held. facets, corners: the master's; walled: as of a Pairing; pairing: what finds
    feet among those in sight; held: None, or by what it is judged; kept (np,): the facets that samples keep then, -1: none;
    (0,) where nothing is held.
    """

    def __init__(self, facets: Surface, corners: Surface, search: float, walled: Walled | None) -> None:
        self._facets, self._corners, self._search, self._walled = facets, corners, search, walled
        self._free = self.pairing = self._seeking(in_sight(corners))
        self.held: Sight | None = None
        self.kept = NO_FACETS
        self._accepted: tuple[Sight | None, Ints64, Pairing] = None, self.kept, self.pairing

    def hold(self, feet: MortarFeet, timers: Timers) -> None:
        """From the next change of the state on, until `free`."""
        facet, kind, *_, normals = feet.projection
        self.held = normals, feet.coords
        strict = self._seeking(in_sight(self._corners, self.held, beyond=0.0))
        met = strict.project(feet.points, -normals, feet.coords, timers)[1] != NONE
        self.kept = np.where(met | (kind == NONE), -1, facet)
        self.pairing = self._seeking(in_sight(self._corners, self.held, self.kept))

    def _seeking(self, seek: Seek) -> Pairing:
        return Pairing(self._facets, seek, self._search, walled=self._walled)

    def free(self) -> None:
        """From the next change of the state on."""
        self.held, self.kept, self.pairing = None, NO_FACETS, self._free

    def commit(self) -> None:
        """The state is accepted as it is seen; freed from its next change on."""
        self._accepted = self.held, self.kept, self.pairing
        self.free()

    @contextmanager
    def as_accepted(self) -> Iterator[None]:
        """See meanwhile, from the next change of the state on, what was seen when the last state was accepted: where that
        was held, the state is in balance so alone."""
        self.held, self.kept, self.pairing = self._accepted
        try:
            yield
        finally:
            self.free()

"""Which linear solver a run takes: foreseen from the shape of its bodies, then measured on its own tangents."""

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.system import System
from fenics_contact.types import Floats

# Seconds of one core of 2020: of a factorisation per flop-like (3 s)^3 with s nodes in the separators of the bodies, and of
# Krylov's method per solve and unknown, its hierarchies included. From frictional scenes of 1e4 to 6e4 unknowns.
FACTORISATION, KRYLOV = 0.5e-9, 2e-6
# Bulk over shear modulus above which multigrid's iterations grow as the square root of the ratio.
SLOWED_ABOVE = 20.0
QUADRATIC = 3.4  # how much dearer multigrid is per unknown of degree 2
DOUBT = 4.0  # foreseen costs that differ by less are measured
EARLIEST = 10  # solves before the other one is tried, times how much dearer it is foreseen to be
PIVOTS = 10.0  # how much dearer a factorisation may be where its pivots are wanted
TRIAL = 80  # iterations of a solve on trial: more than that is no gain
ENOUGH = 8  # solves that tell what a method costs: one factorisation may serve a single solve or ten
BETTER = 0.8  # of the present one's cost: what the other must stay below to take its place
OTHER = {"direct": "iterative", "iterative": "direct"}


def foreseen_costs(system: System) -> dict[str, float]:
    """Seconds per solve by "direct" and by "iterative", up to the machine's speed. Collective."""
    comm, space = system.comm, system.space
    degree = compat.degree(space)
    owned, X = space.dofmap.index_map.size_local, space.tabulate_dof_coordinates()
    flops, nodes = 0.0, 0
    for _, local in system.bodies:
        mine = X[local[local < owned]]
        count = comm.allreduce(len(mine))
        low, high = (np.full((1, 3), size) for size in (np.inf, -np.inf))
        ends = np.array([-np.concatenate([mine, low]).min(axis=0), np.concatenate([mine, high]).max(axis=0)])
        comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        flops += (3.0 * _separator(np.maximum(ends.sum(axis=0), 0.0), count)) ** 3
        nodes += count
    slowed = np.sqrt(max(1.0, system.bulk_over_shear / SLOWED_ABOVE)) * (QUADRATIC if degree > 1 else 1.0)
    return {"direct": FACTORISATION * flops, "iterative": KRYLOV * nodes * 3.0 * slowed}


def _separator(extents: Floats, count: int) -> float:
    """Nodes in a plane across the longest side of a box with that many nodes, as far apart along all its sides."""
    near, far = 1e-9 * extents.max(), extents.max() + 1e-300  # spacings with too many nodes, with eight or less
    for _ in range(60):
        spacing = np.sqrt(near * far) if near > 0.0 else far
        along = extents / spacing + 1.0
        near, far = (spacing, far) if along.prod() > count else (near, spacing)
    return float(np.sort(along)[:2].prod())


class Choice:
    """The cheaper of the two, per digit of accuracy. foreseen: seconds per solve by method.

    A preconditioner's cost is known when it is given up: `next` is asked then. Once the other method may pay for its own
    trial, which is `due` then, it serves for ENOUGH solves, too, unless it has `lost` before; from then on the cheaper of
    the two does, by what each took last.
    """

    def __init__(self, comm: MPI.Comm, foreseen: Mapping[str, float]) -> None:
        self._comm, self._foreseen = comm, foreseen
        self.rates: dict[str, float] = {}  # seconds per digit of a method's last preconditioners
        self._seconds = self._solving = self._digits = 0.0
        self._solves = self._served = 0  # in all, and of those that the seconds and digits are of

    @property
    def first(self) -> str:
        """What is foreseen to be cheaper."""
        return min(self._foreseen, key=lambda method: self._foreseen[method])

    @property
    def first_counting(self) -> str:
        """The same where a factorisation's pivots are wanted, too: they tell a continuation of bifurcations."""
        return "direct" if self._foreseen["direct"] < PIVOTS * self._foreseen["iterative"] else "iterative"

    def longest(self, method: str) -> int | None:
        """Iterations that a solve of a method on trial may take, None: of one that is not."""
        return TRIAL if self.rates and method not in self.rates else None

    @property
    def doubtful(self) -> bool:
        """Whether a measurement may say else."""
        costs = list(self._foreseen.values())
        return max(costs) < DOUBT * min(costs)

    def spent(self, seconds: float, digits: float = 0.0) -> None:
        """Count time, and a solve by its digits."""
        self._seconds, self._digits = self._seconds + seconds, self._digits + digits
        if digits > 0.0:
            self._solving, self._solves, self._served = self._solving + seconds, self._solves + 1, self._served + 1

    def count_anew(self) -> None:
        """Drop what was counted of the present method since the last change: a tangent that stalled it is among it."""
        self._seconds = self._solving = self._digits = 0.0
        self._served = 0

    def due(self, method: str) -> bool:
        """Whether the other method shall be tried now, although what `method` has made may serve on."""
        other = OTHER[method]
        dearer = max(self._foreseen[other] / self._foreseen[method], 1.0)
        return self.doubtful and other not in self.rates and self._solves >= EARLIEST * dearer

    def lost(self, method: str) -> bool:
        """Whether a method on trial takes more for its solves alone than the other one in all. Collective."""
        other = self.rates.get(OTHER[method])
        if other is None or method in self.rates or not self._digits:
            return False
        return max(self._comm.allgather(self._solving)) > other * self._digits

    def next(self, method: str) -> str:
        """The method of the preconditioner that is due, after those of `method`. Collective."""
        seconds = max(self._comm.allgather(self._seconds))
        due = self.due(method)
        if not self.doubtful or not self._digits or (self._served < ENOUGH and not due and not self.lost(method)):
            return method
        self.rates[method], other = seconds / self._digits, OTHER[method]
        wanted = due or self.rates.get(other, np.inf) < BETTER * self.rates[method]
        self.count_anew()
        return other if wanted else method

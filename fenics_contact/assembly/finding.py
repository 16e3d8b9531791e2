"""What stops a run, in words that a person reads and kinds that a program tells apart."""

from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from fenics_contact.types import Floats

ALIKE = 1e-6  # relative: values that differ by less, in symmetric scenes, are the same but for round-off
# J of a cell that has so little volume left that it has been led through its body, whatever its law says; and where steps
# that lead there have been cut to nothing before
CRUSHED, CRUSHING = 0.02, 0.04
DIGITS = 12  # of coordinates beside the largest of them; the rest is round-off

CONVERGED = "converged"
INVERTED = "element inverted"
LIMIT_POINT = "limit point"
RIGID_MOTION = "rigid-body motion"
SLIDES = "friction used up"
CYCLING = "status cycling"
TOO_STIFF = "penalty too stiff"
TOO_SOFT = "penalty too soft"
LOST = "projection lost"
COMES_IN = "fluid comes through"
NO_LAW = "outside a law"
MEMORY = "out of memory"
OUT_OF_STEPS = "out of steps"
UNKNOWN = "no convergence"
ERROR = "ended by an error"

MOVES = ("moves along x", "moves along y", "moves along z", "turns about x", "turns about y", "turns about z")


class Finding(NamedTuple):
    """kind: one of the above; reason: what is wrong; place: body, contact or point; remedy: the change to try."""

    kind: str
    reason: str
    place: str = ""
    remedy: str = ""


class Remark(NamedTuple):
    """size: of what is to be said, to tell where it is worst; text: in words."""

    size: float
    text: str


class Foremost(NamedTuple):
    """value; place (3,): where it is; rank: that has it; item: its number there."""

    value: float
    place: Floats
    rank: int
    item: int


def foremost(comm: MPI.Comm, values: Floats, places: Floats) -> Foremost | None:
    """The largest of values (n,) at places (n, 3), of all ranks; of those that are alike the first by its place, so that
    neither ranks nor the last digits choose. None where there is no value. Collective."""
    largest, size = np.max(comm.allgather((values.max(initial=-np.inf), np.abs(places).max(initial=0.0))), axis=0)
    least = largest - ALIKE * abs(largest) if np.isfinite(largest) else largest
    near = np.flatnonzero(values >= least) if len(values) else np.empty(0, dtype=int)
    tidy = tidied(places[near], size)
    first = np.lexsort(tidy.T[::-1])[:1]
    found = [here for part in comm.allgather([(*tidy[i].tolist(), comm.rank, int(near[i])) for i in first]) for here in part]
    if not found:
        return None
    *place, rank, item = min(found)
    return Foremost(float(largest), np.array(place), rank, item)


def tidied(places: Floats, size: float) -> Floats:
    """Places (n, 3) without round-off beside the largest coordinate."""
    scale = size or 1.0
    return (np.round(places / scale, DIGITS) + 0.0) * scale  # + 0.0: no minus before a zero


def spot(position: Floats) -> str:
    """A reference position as text."""
    return "({:.4g}, {:.4g}, {:.4g})".format(*position)

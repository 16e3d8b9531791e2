"""What stops a run, in words that a person reads and kinds that a program tells apart."""

from typing import NamedTuple

from fenics_contact.types import Floats

CONVERGED = "converged"
INVERTED = "element inverted"
LIMIT_POINT = "limit point"
RIGID_MOTION = "rigid-body motion"
SLIDES = "friction used up"
CYCLING = "status cycling"
TOO_STIFF = "penalty too stiff"
TOO_SOFT = "penalty too soft"
LOST = "projection lost"
MEMORY = "out of memory"
OUT_OF_STEPS = "out of steps"
UNKNOWN = "no convergence"


class Finding(NamedTuple):
    """kind: one of the above; reason: what is wrong; place: body, contact or point; remedy: the change to try."""

    kind: str
    reason: str
    place: str = ""
    remedy: str = ""


def spot(position: Floats) -> str:
    """A reference position as text."""
    return "({:.4g}, {:.4g}, {:.4g})".format(*position)

"""Where on a contact the largest of some values is, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.finding import foremost, spot
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact


def worst(
    contact: Contact, comm: MPI.Comm, values: Floats, spots: Floats | None = None, above: float = -np.inf
) -> tuple[float, str]:
    """Largest of values (n,) over all ranks, and the place of its point, or of its node at spots (n, 3), which is looked for
    where it is greater than `above`: only then is there something to be said. Collective."""
    largest = float(np.max(comm.allgather(values.max(initial=-np.inf))))
    if largest <= above:
        return largest, ""
    found = foremost(comm, values, contact.spots() if spots is None else spots)
    return (found.value, f"contact '{contact.name}' at {spot(found.place)}") if found else (-np.inf, "")

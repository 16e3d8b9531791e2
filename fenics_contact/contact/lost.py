"""Points that a step has carried through another body's facets, too deep to have a partner: open contacts by their looks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import DRAWN, Trial
from fenics_contact.contact.master import area_vectors
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.types import Bools, Ints64

if TYPE_CHECKING:
    from fenics_contact.contact.on_facets import PlacesOnFacets

# Over the search distance: how far the first search looks for a partner to anchor at and for surfaces that overlap.
FIRST_SEARCH = 3.0


def deepest_lost(places: PlacesOnFacets[Any], state: State, trial: Trial) -> float:
    """Depth [length] of the deepest point inside the master that is too deep to have a partner, else zero.

    A Newton step that carries bodies through each other by more than the search distance ends in such a state, which looks
    like an open contact. A point counts if it was in front of the master when the last state was accepted, no farther than
    the bodies have moved since: what has slid off and sprung back lies behind the master, too. Collective.
    """
    now, then, comm, first = places.feet(state), trial.history.feet, state.comm, places.first
    unpaired = now.projection[1] == NONE
    if not comm.allreduce(bool(unpaired.any()), op=MPI.LOR):
        return 0.0
    way = np.abs(now.coords - then.coords)
    moved = max(comm.allgather(way[:first].max(initial=0.0) + way[first:].max(initial=0.0)))
    reach = max(FIRST_SEARCH * places.search, places.search + np.sqrt(3.0) * moved)
    far, before = places.far(now, reach), places.far(then, reach)
    passed = unpaired & (before[1] != NONE) & (before[4] > -DRAWN * places.surface.cell_height)
    passed[passed] = _looked_at(places, then, far[0][passed], passed)
    return -min(comm.allgather(far[4][passed].min(initial=0.0)))


def _looked_at(places: PlacesOnFacets[Any], then: Any, facet: Ints64, some: Bools) -> Bools:
    """Whether points `some` (np,), as they were, looked towards a facet each (n,) of the master, or it towards them; else
    both turned their backs to each other, as sides of a fold do, and no motion has led the one through the other."""
    x = then.coords[places.first + places.master.corners[0][facet]]
    way, out = x.mean(axis=1) - then.points[some], area_vectors(x)
    looks = -then.projection[5][some]
    return np.asarray((np.einsum("nc,nc->n", looks, way) > 0.0) | (np.einsum("nc,nc->n", out, way) < 0.0))

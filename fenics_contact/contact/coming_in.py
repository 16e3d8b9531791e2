"""What is to be said of an analytic tool that comes into a body between the points of its slave surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.assembly.finding import LOST, Finding, Remark
from fenics_contact.assembly.term import State
from fenics_contact.contact.entered import Entered
from fenics_contact.contact.foremost import worst
from fenics_contact.contact.passing import facet_tangents
from fenics_contact.contact.rigid_places import named
from fenics_contact.types import Bools, Floats, Function, Ints64

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

# Of the distance of slave points: a facet that much deeper in a tool between them no longer follows it, and the force is too
# small by 2 to 40 % (docs/choices.md); and where more is missing, or that is what keeps a step from converging
BETWEEN, PIERCED = 0.1, 0.3
# Of the load: what less of it acts where a tool comes in is not worth a note, as at the tip of a cone that many nodes hold;
# and what more makes the whole force too small
LITTLE, MOST = 0.1, 0.5
YIELDS = "which is too small for the tool's way, or its way too long for a force that is given"
FINER = "cells of a third of its radius"
# Of BETWEEN: what finer cells are to hang by; that falls with their size, and grows where their nodes let more in
AIM = 0.75


def held_better(contact: Contact, size: float | None = None) -> str:
    """What keeps a tool from coming in between the points of a slave surface; size: of the cells that do [length], None:
    known by the tool's radius alone."""
    first = "points=3 (Gauss points), or " if contact.surface.between else ""
    return f"take {first}a finer mesh under the tool, {FINER if size is None else _cells(size)}"


def _cells(size: float) -> str:
    return f"cells of {size:.2g} there"


def _size(contact: Contact, state: State, hung: tuple[Floats, Ints64]) -> float:
    """Size of cells [length] that hang into the tool by AIM of BETWEEN, where those `_hung` do by more. Collective."""
    shares, facets = hung
    sizes = contact.surface.dense.spacing[facets] * AIM * BETWEEN / np.maximum(shares, BETWEEN)
    return float(min(state.comm.allgather(sizes.min(initial=np.inf))))


def _hung(contact: Contact, state: State) -> tuple[Floats, Ints64]:
    """How far facets hang into a tool between slave nodes over their distance (n,), and their numbers (n,)."""
    if contact.surface.between and (found := contact.places.entered(state)):
        return found.share, found.facets
    return np.empty(0), np.empty(0, dtype=np.int64)


def _between(contact: Contact, state: State, hung: tuple[Floats, Ints64], above: float) -> tuple[float, str, str]:
    """(how far a facet of those `_hung` hangs into a tool between slave nodes over their distance, in words, place of more
    than `above`). Collective."""
    shares, facets = hung
    share, place = worst(contact, state.comm, shares, contact.surface.dense.X[facets].mean(axis=1), above)
    text = f"between nodes the surface hangs by {share:.0%} of their distance into '{contact.master_name}'"
    return share, text, place


def pressing_forces(contact: Contact, state: State) -> Function:
    """What pressure exerts on the slave's nodes, a vector at each. Collective."""
    s = contact.surface
    pressing = contact.forces.pressing(state) * s.area[..., None]
    forces = compat.Function(state.u.function_space)
    np.add.at(forces.x.array.reshape(-1, 3), s.nodes, np.einsum("eqk,eqc->ekc", s.a, pressing))
    compat.sum_to_owners(forces)
    compat.copy_to_ghosts(forces)
    return forces


def _part_there(contact: Contact, state: State, hung: tuple[Floats, Ints64], above: float) -> float:
    """Of a contact's pressure the part at nodes of facets that hang (`_hung`) into the tool by more than `above`; endless
    where nothing presses. Collective."""
    shares, facets = hung
    space = state.u.function_space
    there = named(space, contact.surface.dense.nodes[facets[shares > above]].ravel())
    count = space.dofmap.index_map.size_local
    load = np.linalg.norm(pressing_forces(contact, state).x.array.reshape(-1, 3), axis=1)[:count]
    here, total = state.comm.allreduce(np.array([load[there[:count]].sum(), load.sum()]))
    return float(here / total) if total > 0.0 else np.inf


def between_note(contact: Contact, state: State) -> Remark | None:
    """None, or that a tool comes in between slave nodes that carry much of the load, or so far that these hardly hold it.
    Collective."""
    share, text, place = _between(contact, state, hung := _hung(contact, state), BETWEEN)
    if share <= BETWEEN or (part := _part_there(contact, state, hung, BETWEEN)) <= LITTLE:
        return None
    size, there = _size(contact, state, hung), f"{part:.0%} of the force acts there, {YIELDS}"
    if not np.isfinite(part):
        there = "nothing presses on it yet"
    elif share > PIERCED and _part_there(contact, state, hung, PIERCED) > MOST:
        return Remark(share, f"{place}: {text}; {there} by a third or more: {held_better(contact, size)}")
    return Remark(share, f"{place}: {text}; {there}: mesh it more finely, {_cells(size)}")


def pierced(contact: Contact, state: State) -> Finding | None:
    """None, or the Finding that a tool has come through between slave nodes. Collective."""
    share, text, place = _between(contact, state, _hung(contact, state), PIERCED)
    return Finding(LOST, text, place, held_better(contact)) if share > PIERCED else None


def _free(contact: Contact, state: State, found: Entered) -> Bools:
    """In which of the facets that a tool has entered (n,) no pressure at their nodes holds it from the front. Collective."""
    forces = pressing_forces(contact, state).x.array.reshape(-1, 3)
    return np.asarray(np.einsum("nkc,nc->n", forces[contact.surface.dense.nodes[found.facets]], found.normals) >= 0.0)


def _normals(state: State) -> Floats:
    """Sums (n, 3) of the area vectors of the facets around each node, of all that the body has. Collective."""
    space = state.u.function_space
    skin, out = skin_of(space, compat.exterior_facets(space.mesh)), compat.Function(space)
    normals, (ne, nq) = out.x.array.reshape(-1, 3), skin.area.shape
    tangents = facet_tangents(skin.slopes, skin.X + state.u.x.array.reshape(-1, 3)[skin.nodes])
    facing = np.cross(tangents[:, 0], tangents[:, 1]).reshape(ne, nq, 3).mean(axis=1)
    np.add.at(normals, skin.nodes, facing[:, None])
    compat.sum_to_owners(out)
    compat.copy_to_ghosts(out)
    return normals


def came_in(contact: Contact, state: State, nearly: float = 1.0) -> Finding | None:
    """None, or the Finding that a tool has come into the body between slave points that do not hold it;
    nearly: see `entered`. Collective.

    It has where two of three are so: pressures do not hold it from the front, more than half of it is within, and it
    reaches deep behind the surface. One alone may be right: a tool that begins to touch, a thin one, one held by its rim.
    """
    if (found := contact.places.entered(state, nearly)) is None:
        return None
    comm = state.comm
    if not comm.allreduce(bool((found.behind | found.deep).any()), op=MPI.LOR):
        return None
    # a facet beside an edge over which a tool presses on the next one has the tool at its side: the edge's own normal tells
    found = contact.places.entered(state, nearly, _normals(state)) or found
    free, both, suspect = _free(contact, state, found), found.behind & found.deep, found.behind | found.deep
    through = both | (suspect & free)
    spots = contact.surface.dense.X[found.facets].mean(axis=1)
    sag, place = worst(contact, comm, np.where(through, found.sag, 0.0), spots, 0.0)
    if sag <= 0.0:
        return None
    held = comm.allreduce(bool((through & ~free).any()), op=MPI.LOR)
    why = "more than half of it is behind the surface" if held else "no point holds it"
    text = f"'{contact.master_name}' has come into the body between slave points, {sag:.3g} deep, and {why}"
    return Finding(LOST, text, place, held_better(contact))


def unheld(contact: Contact, state: State) -> str | None:
    """None, or that a contact is open at all its points while the tool lies between them. Collective."""
    if (found := contact.places.entered(state)) is None:
        return None
    sag, place = worst(contact, state.comm, found.sag, contact.surface.dense.X[found.facets].mean(axis=1), 0.0)
    if sag <= 0.0:
        return None
    return (
        f"{place} never closed, though '{contact.master_name}' lies {sag:.3g} inside: it is between slave points, none of "
        f"which it reaches: {held_better(contact)}"
    )

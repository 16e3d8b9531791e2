"""What is to be said where surfaces of facets come into each other between the points that hold them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.finding import LOST, Finding, Remark
from fenics_contact.assembly.term import State
from fenics_contact.contact.coming_in import LITTLE, pressing_forces
from fenics_contact.contact.foremost import worst
from fenics_contact.contact.led import LED
from fenics_contact.kernels.status import OPEN
from fenics_contact.types import Bools, Floats, Ints64

if TYPE_CHECKING:
    from fenics_contact.contact.crossing import Crossed, Crossing
    from fenics_contact.contact.term import Contact

# Of the size of the slave's facet: rounded edges on facets that follow them, and edges of blocks that slide, lie an eighth
# deep. What a depth costs is no share of it: edges of 90 degrees a quarter deep between nodes of blocks have forces off by
# 5 to 70 %, as they have pressed far or just begun, a small chamfer that deep by 3 % (`sunk`)
HIDDEN = 0.15
LED_IN = 0.05  # likewise, of nodes that supports lead: what presses there has nothing to give way
# Of how deep an edge lies what it does in the mean: to either side of it the overlap falls to nothing along straight facets
MEAN = 0.5
# Likewise: an edge of 90 degrees that meets the middle of a facet is held from half of it on, and on fine facets goes on
# from there; what is deeper and held by nothing has come in, and so has what no surface of such facets follows
COME_IN, DROWNED = 0.75, 1.0
UNREACHED = 0.01  # likewise, of a contact that is open at all its points: what facets cut off of each other is less
FINER = "mesh the slave there more finely, with cells of a quarter of how deep it is to go"
CROSSED = "mesh both there more finely, with cells of a quarter of how deep they are to go, or round the edges"
# By what a side has, not by its name: with the sides exchanged it asks for the same ones
EDGED = "let the side without an edge there be the slave, or round the edge"


class Behind(NamedTuple):
    """n nodes and places on edges that lie behind facets, of this rank: by how much deeper than the points there, sag (n,)
    [length], share (n,): of the size of the slave's facet; X (n, 3): reference positions on the slave; slaves (n,): nodes of
    the slave, edges (n,): on edges; at (n,): as of Crossed; led (n,): supports have led them, or nodes of these facets, in;
    free (n,): no pressure around holds them. forces (nm,): what pressure exerts on each node of the slave, of all ranks
    [force]."""

    sag: Floats
    share: Floats
    X: Floats
    slaves: Bools
    edges: Bools
    at: Ints64
    led: Bools
    free: Bools
    forces: Floats


def _behind(contact: Contact, state: State) -> Behind | None:
    """None where no node lies deep. Collective."""
    crossing, comm = contact.places.crossing, state.comm
    if crossing is None or (found := contact.places.crossed(state)) is None:
        return None
    limits = np.where(found.led, LED_IN, HIDDEN)
    if not comm.allreduce(bool((found.depth > limits * found.size).any()), op=MPI.LOR):
        return None
    facets, points = crossing.facet_nodes(), _penetrations(contact, state, crossing)
    forces = crossing.skin.gathered(pressing_forces(contact, state).x.array.reshape(-1, 3)[crossing.skin.owned])
    ours, theirs, around, sums = found.slaves, ~found.slaves, forces[facets].sum(axis=1), np.zeros_like(forces)
    np.add.at(sums, facets, around[:, None])
    held, pushed = np.empty(len(ours)), np.empty((len(ours), 3))
    held[ours], held[theirs] = points[found.at[ours]], points[facets[found.at[theirs]]].max(axis=1, initial=0.0)
    pushed[ours], pushed[theirs] = sums[found.at[ours]], around[found.at[theirs]]
    sag, free = found.depth - held, np.einsum("nc,nc->n", pushed, found.normals) >= 0.0
    share, load = sag / found.size, np.linalg.norm(forces, axis=1)
    led_in = np.zeros(len(forces), dtype=np.int32)
    led_in[found.at[ours & found.led & (share > LED_IN)]] = 1
    comm.Allreduce(MPI.IN_PLACE, led_in, op=MPI.MAX)
    led = np.zeros(len(ours), dtype=bool)
    led[ours], led[theirs] = led_in[found.at[ours]] > 0, (led_in[facets[found.at[theirs]]] > 0).any(axis=1)
    return Behind(sag, share, found.X, ours, found.edges, found.at, led, free, load)


def _penetrations(contact: Contact, state: State, crossing: Crossing) -> Floats:
    """The greatest penetration (nm,) [length] of the points around each node of the slave, on all ranks. Collective."""
    response = contact.response(state)
    depth = np.where(response.status != OPEN, np.maximum(-response.gap, 0.0), 0.0)
    out = np.zeros(len(crossing.skin.moving))
    np.maximum.at(out, _numbers(contact, state, crossing), depth.max(axis=1, initial=0.0)[:, None])
    state.comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
    return out


def _part_there(contact: Contact, state: State, found: Behind, which: Bools) -> float:
    """Of the contact's pressure the part at the nodes of the facets around some places, endless where nothing presses.
    Collective."""
    crossing = contact.places.crossing
    facets = crossing.facet_nodes() if crossing else np.empty((0, 1), dtype=np.int64)
    there, ours = np.zeros(len(facets), dtype=np.int32), found.slaves
    there[found.at[which & ~ours]] = 1
    there[np.isin(facets, found.at[which & ours]).any(axis=1)] = 1
    state.comm.Allreduce(MPI.IN_PLACE, there, op=MPI.MAX)
    total = found.forces.sum()
    return float(found.forces[np.unique(facets[there > 0])].sum() / total) if total > 0.0 else np.inf


def _in_words(contact: Contact, state: State, found: Behind, values: Floats) -> tuple[str, str, str]:
    """(place, what lies how deep, remedy) of the place with the largest of values (n,). Collective."""
    most, place = worst(contact, state.comm, values, found.X)
    return place, *_lies(contact, state, found, found.sag, values >= most)


def _lies(contact: Contact, state: State, found: Behind | Crossed, deep: Floats, here: Bools) -> tuple[str, str]:
    """(what lies how deep in the other, in words, remedy) of the places `here` of n that lie deep (n,) [length], as these of
    all ranks tell. Collective."""
    sag, comm = max(state.comm.allgather(deep[here].max(initial=0.0))), state.comm
    node, edge = (comm.allreduce(bool(which[here].any()), op=MPI.LOR) for which in (found.slaves, found.edges))
    if node:
        text = f"a slave node lies {sag:.3g} inside '{contact.master_name}'"
        return text, FINER if contact.partner.grounded else EDGED
    if edge:
        text = f"the slave and '{contact.master_name}' lie {sag:.3g} in each other"
        return f"{text} where an edge of one crosses the other between nodes", CROSSED
    return f"'{contact.master_name}' lies {sag:.3g} inside the slave between its nodes", FINER


def hidden_note(contact: Contact, state: State) -> Remark | None:
    """None, or that one surface lies in the other where the load acts, deeper than the points there know. Collective."""
    if (found := _behind(contact, state)) is None:
        return None
    share = np.where(found.led, 0.0, found.share)
    most = max(state.comm.allgather(share.max(initial=0.0)))
    if most <= HIDDEN or (part := _part_there(contact, state, found, share > HIDDEN)) <= LITTLE:
        return None
    place, text, remedy = _in_words(contact, state, found, share)
    there = f"{part:.0%} of the force acts there" if np.isfinite(part) else "nothing presses yet"
    return Remark(most, f"{place}: {text}, {most:.0%} of the side of the slave's facet; {there}: {remedy}")


def sunk(contact: Contact, state: State) -> Floats:
    """How much deeper (ne, nq) [length] than the points, which are nodes, the surfaces lie in each other around them, in the
    mean: of what a note is on. Collective."""
    s, crossing = contact.surface, contact.places.crossing
    if crossing is None or (found := _behind(contact, state)) is None:
        return np.zeros(s.area.shape)
    sag, facets = np.where(found.led | (found.share <= HIDDEN), 0.0, found.sag), crossing.facet_nodes()
    ours, deeper = found.slaves, np.zeros(len(found.forces))
    np.maximum.at(deeper, found.at[ours], sag[ours])
    np.maximum.at(deeper, facets[found.at[~ours]], sag[~ours, None])
    state.comm.Allreduce(MPI.IN_PLACE, deeper, op=MPI.MAX)
    return MEAN * np.broadcast_to(deeper[_numbers(contact, state, crossing)].max(axis=1, keepdims=True), s.area.shape)


def _numbers(contact: Contact, state: State, crossing: Crossing) -> Ints64:
    """Of the nodes (ne, k) of the contact's elements their numbers on the slave, as Behind counts."""
    return np.searchsorted(crossing.skin.moving, compat.global_blocks(state.u.function_space)[contact.surface.nodes])


def unheld_facets(contact: Contact, state: State) -> str | None:
    """None, or that a contact is open at all its points while the surfaces lie in each other between them. Collective."""
    if (found := contact.places.crossed(state)) is None:
        return None
    depth = np.where(found.depth > UNREACHED * found.size, found.depth, 0.0)
    sag, place = worst(contact, state.comm, depth, found.X, 0.0)
    if sag <= 0.0:
        return None
    inside, remedy = _lies(contact, state, found, found.depth, depth >= sag)
    return f"{place} never closed, though {inside}, where its points do not reach: {remedy}"


def led_in_note(contact: Contact, state: State) -> Remark | None:
    """None, or that supports have led nodes of the slave into a body; of a tool `_led_note` says so. Collective."""
    if contact.partner.grounded or (found := _behind(contact, state)) is None:
        return None
    some = found.led & found.slaves
    if not state.comm.allreduce(bool(some.any()), op=MPI.LOR):
        return None
    led = np.zeros(len(found.forces))
    led[found.at[some]] = found.forces[found.at[some]]
    state.comm.Allreduce(MPI.IN_PLACE, led, op=MPI.MAX)
    total = found.forces.sum()
    if not led.sum() > LED * total:
        return None
    place, text, _ = _in_words(contact, state, found, np.where(some, found.share, 0.0))
    return Remark(
        led.sum() / total,
        f"{led.sum() / total:.2g} of the contact's force acts where supports prescribe the slave along its normal, most at "
        f"{place}: {text}, and what acts there is no body's; leave these nodes free, or take what they lie on out of the "
        "slave",
    )


def come_in(contact: Contact, state: State, nearly: float = 1.0) -> Finding | None:
    """None, or the Finding that one surface has come into the other between points that do not hold it; nearly: what of the
    limits is enough. Collective."""
    if (found := _behind(contact, state)) is None:
        return None
    through = ((found.share > nearly * COME_IN) & found.free) | (found.share > nearly * DROWNED)
    values = np.where(through & ~found.led, found.share, 0.0)
    if not state.comm.allreduce(bool(values.any()), op=MPI.LOR):
        return None
    place, text, remedy = _in_words(contact, state, found, values)
    return Finding(LOST, f"{text}, where no pressure holds it", place, remedy)

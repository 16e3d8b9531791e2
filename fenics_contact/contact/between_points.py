"""How deep nodes lie in the master between the Gauss points beside them, which alone are held out of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.term import State
from fenics_contact.contact.foremost import worst
from fenics_contact.kernels.status import OPEN
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

HEIGHT = 1.5  # of an arc over its side, times its mean


def node_depth(contact: Contact, state: State, above: float = -np.inf) -> tuple[float, str]:
    """Depth [length] and place of the deepest node of the facets with Gauss points that have a partner, touching or not, the
    place of one deeper than `above` [length].

    Zero where points are nodes themselves, which the penetration measures. Collective.
    """
    s, comm = contact.surface, state.comm
    if s.at_nodes:
        return 0.0, ""
    near = (contact.places.bare(contact.places.feet(state)) < 1.0).reshape(s.area.shape).any(axis=1)
    nodes, first = np.unique(s.nodes[near], return_index=True)
    X = s.X[near].reshape(-1, 3)[first]
    depth, place = worst(contact, comm, -contact.places.node_gaps(state, nodes, X), X, above)
    return max(depth, 0.0), place


def nodes_deeper(contact: Contact, state: State) -> Floats:
    """How much deeper (ne, nq) [length] than its deepest point a node of the facet lies, of those that touch.

    Not counted is what a round master's facets cut off, of which the chord error tells: bodies that fit have nodes as deep
    in its chords, and points on them that are as far out. Collective.
    """
    s, response = contact.surface, contact.response(state)
    touches, point = (response.status != OPEN).any(axis=1), (-response.gap).max(axis=1, initial=0.0)
    gaps = contact.places.node_gaps(state, s.nodes.ravel(), s.X.reshape(-1, 3)).reshape(s.nodes.shape)
    chords = np.abs(contact.places.cut_off(state) - s.cut_off).max(axis=1, initial=0.0)
    deeper = np.where(touches, np.maximum(-gaps.min(axis=1, initial=np.inf) - point - HEIGHT * chords, 0.0), 0.0)
    return np.repeat(deeper[:, None], s.area.shape[1], axis=1)

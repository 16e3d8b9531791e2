"""What acts aside: pressures along normals of the slave that lean from those of the master, friction across bent patches."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fenics_contact.assembly.finding import Remark
from fenics_contact.assembly.term import State
from fenics_contact.kernels.status import SLIP, STICK

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

ONE_WAY = 0.9  # of a contact's load: with less as its resultant what acts aside cancels from one side to another, too
LEANS = 0.05  # of a contact's pressure: when more of it acts aside, friction of 0.3 is off by a sixth
# Likewise where all of a rough contact slides, so that its tangential force is friction's, and not what halves of a pressed
# body hold against each other: edges of the slave are off by just what acts aside there. Where the master's edge is what
# touches, the slave's normals are nearer to the truth: with 0.03 forces are right to 0.002 of the load, with 0.12 they are
# off by 0.04
ASIDE = 0.005
# Likewise without friction, where nothing may act aside. Less is common at edges that are pressed and fold
NONE = 0.01
BENT = 0.01  # of the friction of nodes that slip
SEVERAL = 4  # slave nodes that slide: fewer, as where a tool lifts off, know normals and forces roughly
SMOOTH = "let the side without that edge be the slave"
ROUND = "round the edge, with cells of a quarter of its radius"


class Lean(NamedTuple):
    """Shares, see `lean_of`."""

    at_ends: float
    all_over: float
    lost: float


def lean_of(contact: Contact, state: State) -> Lean:
    """Shares of the contact's load by which the tangential force, that acts by the slave's normals, would change by the
    master's: where an edge of the slave touches, and all over; and the share of the friction of nodes that slip which is
    across the planes of their samples. Where parts of the load cancel, as around a ring, what acts along friction counts.
    Collective."""
    sums = state.comm.allreduce(contact.led.lean(state))
    size, (rubs, felt, *along) = sums[9] if sums[9] > 0.0 else np.inf, sums[10:]
    *aside, load = sums[:9].reshape(3, 3) / size
    across = np.linalg.norm(aside @ (np.eye(3) - np.outer(load, load)), axis=1)
    at_ends, all_over = across if np.linalg.norm(load) > ONE_WAY else np.maximum(across, np.abs(along) / size)
    return Lean(float(at_ends), float(all_over), float((rubs - felt) / rubs) if rubs > 0.0 else 0.0)


def degrees(lean: float) -> str:
    """The angle between normals that stands for a share as of `lean_of`."""
    return f"{np.degrees(2.0 * np.arcsin(min(0.5 * lean, 1.0))):.2g} degrees"


def lean_note(contact: Contact, state: State, lean: Lean) -> Remark | None:
    """None, or that contact acts by normals of the slave which are not the master's. Collective."""
    at_ends, all_over, _ = lean
    if max(at_ends, all_over) <= ASIDE:
        return None
    sticks, slips = _moves(contact, state)
    slides = contact.rough and slips >= SEVERAL and not sticks
    text = f"contact '{contact.name}': it acts by normals of the slave that lean from those of '{contact.master_name}'"
    free = not contact.rough
    if at_ends > (ASIDE if slides else NONE if free else LEANS):
        known = slides or free
        also = _of_friction(contact, state, at_ends) if slides else ""  # what sticks may rub with next to nothing
        off = "by so much of the load its tangential force is off" if known else "its tangential force may be off as far"
        return Remark(
            at_ends,
            f"{text}: an edge of the slave folds, or turns within a step where it is what touches, and {at_ends:.2g} of the "
            f"load acts aside{also}; {off}; {SMOOTH}, {ROUND}, "
            "let it meet an analytic tool, or, if it turns, take more steps",
        )
    if slides and all_over > min(LEANS, 0.1 * contact.trial.law.friction.mu):  # or a tenth of friction itself
        return Remark(
            all_over,
            f"{text}, an edge of which digs in, or where few nodes of a round side touch: its tangential force may be off "
            f"by up to {all_over:.2g} of the load{_of_friction(contact, state, all_over)}, as these pass; "
            f"{ROUND}, finer cells on what is round, or more steps",
        )
    return None


def _of_friction(contact: Contact, state: State, lean: float) -> str:
    """A share of the load, as one of the friction of all points, summed by size: what is led along may feel no more.
    Collective."""
    rubs, load = state.comm.allreduce(np.array([contact.forces.grip(state)[0], contact.led.lean(state)[9]]))
    return f", {lean * load / rubs:.2g} of the friction" if rubs > 0.0 else ""


def _moves(contact: Contact, state: State) -> tuple[int, int]:
    """How many points or nodes stick, and how many slip. Collective."""
    status = contact.response(state).status
    sticks, slips = state.comm.allreduce(np.array([np.count_nonzero(status == STICK), np.count_nonzero(status == SLIP)]))
    return int(sticks), int(slips)


def bent_note(contact: Contact, state: State, lean: Lean) -> Remark | None:
    """None, or that friction is lost where the patch of a node, in which it has one direction, is bent. Collective."""
    if lean.lost <= BENT or _moves(contact, state)[1] < SEVERAL:
        return None
    return Remark(
        lean.lost,
        f"contact '{contact.name}': friction has one direction in the patch of a slave node, whose facets are bent along "
        f"it: {lean.lost:.2g} of it acts across them, and so much of its moment and work is missing; take finer cells on "
        "what is round, or points=3 (Gauss points)",
    )

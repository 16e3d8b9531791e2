"""Contacts that have all but used up their friction, where hardly anything says which, or which side of one, slides."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.system import System
from fenics_contact.solvers.holding import (
    MOSTLY,
    closed,
    combined_motion,
    energies,
    kind_of_owner,
    lowest,
    moving_parts,
    pushed,
    resisted,
)
from fenics_contact.solvers.motions import Drift, rigid_motions
from fenics_contact.types import Vec

NEARLY = 0.9  # of the friction that its law allows: contacts that slide one instead of the other as the steps happen to fall
PULLS = 0.1  # of the largest work of a contact: what does less has no part in a motion
ALIKE = 0.95  # of the share of its friction that one side carries: how near the other one's must be for either to slide
FELT = 0.02  # of the friction that contacts may carry, times the way: less work has nothing to do with their sliding
ASIDE = 0.02  # of the way to where the bodies are: so much of it along what is undecided is more than rounding brings


def undecided(system: System, told: Collection[str]) -> dict[str, str]:
    """{place: a note} of contacts that hold bodies or free tools, no load against them, and that have all but used up their
    friction: on the way that what moves prescribes one of them, or one side of one, must slide, and hardly anything says
    which.

    Then a rigid motion of what they hold on which they pull against each other, or one side against the other, and no load
    pulls, is resisted by little of what would resist it if all points stuck, or less than nothing. told: places that have
    had theirs. Collective.
    """
    if not (system.holds.reliant or system.tools.free.any()):
        return {}
    rough = [contact for contact in system.contact_terms if contact.rough and closed(system, contact)]
    grips = [system.comm.allreduce(np.array(contact.forces.grip(system.state))) for contact in rough]
    least = ALLOWED * system.scales.largest
    near = [
        (contact, *grip) for contact, grip in zip(rough, grips, strict=True) if grip[0] > NEARLY * grip[1] > NEARLY * least
    ]
    if all(any(f"'{contact.name}'" in place for place in told) for contact, *_ in near):
        return {}
    motions, found = rigid_motions(system), dict[str, str]()
    if len(near) < 2 and not any(_gone_along(system, motion) for _, motion, _ in motions):
        return {}
    rubbing = [_Rubbing.of(system, *one) for one in near]
    if len(near) < 2 and not any(_against_itself(system, rubbing, motion) for _, motion, _ in motions):
        return {}
    now, stuck = resisted(system, motions, {}), energies(system, rough, motions, {})
    values, vectors = lowest(now, stuck)
    for motion in vectors[:, values < MOSTLY].T:
        combined = combined_motion(system, motions, motion)
        pulling = _against_each_other(rubbing, combined)
        concerned = pulling or _against_itself(system, rubbing, combined)
        if not concerned or (pulling and pushed(system, motions, motion[:, None])):
            continue
        names = " and ".join(f"'{one.contact.name}'" for one in concerned)
        place = f"contact{'s' if len(concerned) > 1 else ''} {names}"
        if place not in told:
            held = [f"{kind_of_owner(system, name)} '{name}'" for name, _ in moving_parts(motions, motion[:, None])]
            shares = ", ".join(f"{one.taken / one.most:.3f}" for one in concerned)
            found[place] = _told(place, ", ".join(held), shares, bool(pulling))
    return found


def _told(place: str, owners: str, shares: str, several: bool) -> str:
    """The note; shares: T / (mu N); several: contacts that pull against each other, not sides of one."""
    used = f"all but used up, T / (mu N) = {shares}: the path may branch here, for hardly anything says which"
    if several:
        return (
            f"{place} hold {owners}, and the friction of all of them is {used} of them slides; compare with twice the "
            f"steps, hold {owners} along that way, or let the frictions differ by a tenth"
        )
    return (
        f"{place} holds {owners} between its sides, and its friction is {used} side slides, and {owners} has gone aside; "
        f"compare with twice the steps, hold {owners} along that way, as a plane of symmetry does, or solve(..., "
        "method=Method(stabilise=True))"
    )


class _Rubbing(NamedTuple):
    """A contact, its friction and what its law allows [force]; as forces its friction, on the owned dofs, and all of it."""

    contact: ContactTerm
    taken: float
    most: float
    friction: Vec
    forces: Drift

    @classmethod
    def of(cls, system: System, contact: ContactTerm, taken: float, most: float) -> "_Rubbing":
        """Collective."""
        local, tools = np.zeros_like(system.state.u.x.array), np.zeros_like(system.tool_residual)
        pressed, wrenches = np.zeros_like(local), np.zeros_like(tools)
        contact.add_residual(system.state, local, tools)
        contact.forces.press(system.state, pressed, wrenches)
        forces = Drift(system.border_vector(local), system.comm.allreduce(tools))
        return cls(contact, taken, most, system.border_vector(local - pressed), forces)


def _against_each_other(rubbing: Sequence[_Rubbing], motion: Drift) -> list[_Rubbing]:
    """Contacts that pull each other along a motion, either side as near to sliding. Collective."""
    if len(rubbing) < 2:
        return []
    work = np.array([motion.dot(one.forces) for one in rubbing])
    most = np.array([one.most for one in rubbing])
    pulls = np.abs(work) > PULLS * np.abs(work).max()
    # of what each side may carry along that way: the side that carries more of it slides
    sides = [abs(work[side].sum()) / most[side].sum() for side in (pulls & (work > 0.0), pulls & (work < 0.0)) if side.any()]
    if len(sides) < 2 or max(sides) <= FELT * motion.largest or min(sides) < ALIKE * max(sides):
        return []
    return [one for one, pulling in zip(rubbing, pulls, strict=True) if pulling]


def _gone_along(system: System, motion: Drift) -> bool:
    """Whether bodies have gone along a motion, whatever else they have done. Collective."""
    u, size = system.new_vector(), motion.du.dot(motion.du)
    u.array[:] = system.state.u.x.array[: system.vector.getLocalSize()]
    return bool(size > 0.0 and abs(motion.du.dot(u)) / size * motion.largest > ASIDE * system.scales.moved)


def _against_itself(system: System, rubbing: Sequence[_Rubbing], motion: Drift) -> list[_Rubbing]:
    """Contacts of which one side pulls the other along a motion, by friction, along which bodies have gone. Collective."""
    if not _gone_along(system, motion):
        return []
    found = []
    for one in rubbing:
        work = (one.friction.array_r * motion.du.array_r).reshape(-1, 3).sum(axis=1)
        sides = system.comm.allreduce(np.array([work[work > 0.0].sum(), -work[work < 0.0].sum()]))
        # loads hold against what all of it does there
        pushes = abs(motion.dot(one.forces))
        if sides.max() > FELT * motion.largest * one.most and sides.min() > max(ALIKE * sides.max(), pushes / PULLS):
            found.append(one)
    return found

"""Whether contacts can balance the loads on bodies as rigid ones: where none of their forces can, the bodies topple."""

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import RIGID_MOTION, SLIDES, Finding
from fenics_contact.assembly.system import System
from fenics_contact.solvers.holding import Motions, closed, contacts_of, moving, works
from fenics_contact.solvers.motions import rigid_motions
from fenics_contact.types import Floats

REACH = 0.1  # of the bodies' size: points of smaller gaps touch, or may once the bodies have given way
CLOSED = 1e-6  # of the bodies' size: how deep these points are put into the master; the way tried is a tenth of that
UNBALANCED = 0.01  # of the loads: what is left of less the bodies may balance once they have given way
GAIN = 1e-6  # of a force and of what is left: less work of one on the other is round-off
MOST = 500  # forces tried, some times as many as motions
ENDLESS = 1e12  # coefficient of friction under which every point in contact sticks
STEEP = 10.0  # a coefficient of friction above all that there are, and in the place of a law that is no number


def toppling(system: System, goal: float) -> Finding | None:
    """A finding if bodies have a rigid motion on which the loads at `goal` do work, and no forces of contacts that touch, or
    nearly do, could do any against it: there is no balance near the accepted state. With more friction there may be: then
    they slide. Collective.

    None where something else may hold them: what is tied to tools, springs, a fluid, or a contact that is still open.
    """
    apart = (system.grounding, system.damping)
    if system.fluids or system.supports.ties or not set(system.springs) <= set(apart):
        return None
    motions = rigid_motions(system)
    free = _unsupported(system, motions)
    system.begin_step(goal)
    forces = works(system, [term for term in system.terms if term not in (*apart, *system.contacts)], motions)
    system.trail.rollback()
    load = (forces - [np.sum(motion.dq * system.tools.forces(goal)) for _, motion, _ in motions]) @ free
    if not np.abs(load).max(initial=0.0) > system.scales.noise:
        return None
    reaches = [_reaches(system, contact, motions, free, REACH) for contact in system.contacts]
    left = _left(system, load, reaches)
    if not np.linalg.norm(left) > UNBALANCED * np.linalg.norm(load):
        return None
    parts = moving(motions, (free @ left)[:, None])
    if not all(closed(system, contact) for contact in contacts_of(system, {name for name, _ in parts})):
        return None
    names, how = ", ".join(name for name, _ in parts), " and ".join(f"'{name}' {', '.join(ways)}" for name, ways in parts)
    place = f"body '{names}'" if len(parts) == 1 else f"bodies '{names}'"
    touching = [_reaches(system, contact, motions, free, CLOSED) for contact in system.contacts]
    rougher = _left(system, load, [(presses, slips, STEEP if mu else 0.0) for presses, slips, mu in touching])
    if not np.linalg.norm(rougher) > UNBALANCED * np.linalg.norm(load):
        text = f"no forces of the contacts balance the loads with the friction that is stated: {how}"
        where = ", ".join(f"contact '{contact.name}'" for contact in contacts_of(system, {name for name, _ in parts}))
        return Finding(SLIDES, text, where, "raise friction=, fix a surface, or prescribe this motion in place of the load")
    text = f"no forces at the points where contacts touch balance the loads, it topples: {how}"
    remedy = "fix a surface, use a symmetry plane, support it by another contact, or mesh the slave's edge there more finely"
    return Finding(RIGID_MOTION, text, place, remedy)


def _unsupported(system: System, motions: Motions) -> Floats:
    """Combinations (len(motions), n) of rigid motions that leave all supports where they are. Collective."""
    held = np.array([system.supports.held(motion.du.array_r) for _, motion, _ in motions])
    values, vectors = np.linalg.eigh(system.comm.allreduce(held @ held.T))
    return vectors[:, values < 1e-12 * max(values.max(initial=0.0), 1.0)]


def _reaches(
    system: System, contact: ContactTerm, motions: Motions, free: Floats, reach: float
) -> tuple[Floats, Floats, float]:
    """Of this rank's points with gaps up to `reach` [of the bodies' size]: works (n, len(load)) of a unit of pressure, slips
    (n, 3, len(load)), and the coefficient of friction. Collective."""
    state, law, forces, stated = system.state, contact.trial.law, contact.forces, contact.friction_stated
    u, q, deep = state.u.x.array.copy(), state.q.copy(), CLOSED * system.extent
    gap = contact.response(state).gap
    near = gap < reach * system.extent
    pressed = contact.trial.with_friction(ENDLESS).nearer(np.where(near, gap + deep, 0.0))
    before, works_, slips = forces.split_traction(state, pressed), [], []
    for _, motion, _ in motions:
        share = float(0.1 * deep / motion.largest)
        system.update(share * motion.du, share * motion.dq)
        pressure, friction = (
            after - then for after, then in zip(forces.split_traction(state, pressed), before, strict=True)
        )
        works_.append(pressure[near] / np.broadcast_to(law.eps_n[:, None], gap.shape)[near] / share)
        slips.append(friction[near] / np.broadcast_to(law.eps_t[:, None], gap.shape)[near][:, None] / share)
        state.u.x.array[:], state.q[:] = u, q
    mu = stated if isinstance(stated, float | int) else STEEP
    return -np.array(works_).T @ free, np.moveaxis(np.array(slips), 0, -1) @ free, float(mu)


def _left(system: System, load: Floats, reaches: list[tuple[Floats, Floats, float]]) -> Floats:
    """What contact forces leave of a load (n,) at least (Lawson & Hanson 1974, Solving Least Squares Problems, ch. 23): the
    force is added that does most work on what is left, and those that would pull are taken out. Collective."""
    chosen, sizes, left = np.zeros((0, len(load))), np.zeros(0), load
    for _ in range(MOST):
        best = max(system.comm.allgather(_best(left, reaches)), key=lambda found: found[0])
        if not best[0] > GAIN * np.linalg.norm(left) or np.linalg.norm(left) <= UNBALANCED * np.linalg.norm(load):
            return left
        chosen, sizes = np.vstack([chosen, best[1]]), np.append(sizes, 0.0)
        while (wanted := np.linalg.lstsq(chosen.T, load, rcond=None)[0]).min() <= 0.0:
            pulls = wanted <= 0.0
            share = (sizes[pulls] / np.maximum(sizes[pulls] - wanted[pulls], 1e-300)).min()
            sizes = sizes + share * (wanted - sizes)
            pushes = ~pulls | (sizes > 1e-12 * sizes.max())
            pushes[np.flatnonzero(pulls)[sizes[pulls].argmin()]] = False
            chosen, sizes = chosen[pushes], sizes[pushes]
            if not len(sizes):
                break
        sizes = wanted if len(sizes) else sizes
        left = load - sizes @ chosen
    return 0.0 * load


def _best(left: Floats, reaches: list[tuple[Floats, Floats, float]]) -> tuple[float, Floats]:
    """(work, force of unit size) of the contact force of this rank's points that does most work on what is left."""
    best = 0.0, np.zeros_like(left)
    for presses, slips, mu in reaches:
        along = slips @ left
        size = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        force = presses + mu * np.einsum("nc,nck->nk", along / size, slips)
        force /= np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
        if len(force) and (force @ left).max() > best[0]:
            best = float((force @ left).max()), force[(force @ left).argmax()]
    return best

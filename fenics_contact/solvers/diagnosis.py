"""Why a step cannot be taken: evidence from the failing iterate, and from the tangent at the last accepted state."""

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.finding import (
    LIMIT_POINT,
    LOST,
    MEMORY,
    OUT_OF_STEPS,
    RIGID_MOTION,
    TOO_STIFF,
    UNKNOWN,
    Finding,
    spot,
)
from fenics_contact.solvers.arc_length import ArcLength
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.verdict import StepFailed

# A motion counts as free below this share of the stiffness that its nodes have each alone: round-off is 1e-15, and the
# least of what holds a body, one corner in contact, is far above.
FREE = 1e-10
# A step cut to 1e-4 of the load before a fold leaves a mode sqrt(1e-4) of its stiffness, times a factor of order one.
FOLDED = 0.1
# Lengths of the failing step, within which a fold must lie ahead to be its cause: Newton's method fails a few before it.
AHEAD = 10.0
CERTAIN = (MEMORY, OUT_OF_STEPS, TOO_STIFF)  # causes that need no further evidence
SQUEEZED = 0.1  # J of the accepted state below which an inversion in the next step is no accident of Newton's way
LARGEST = 300_000  # unknowns up to which a factorisation for the diagnosis alone is worth its memory
SWEEPS = 30  # of inverse iteration; from a random start each gains the ratio of the two lowest eigenvalues

MOVES = ("moves along x", "moves along y", "moves along z", "turns about x", "turns about y", "turns about z")


def diagnose(system, failure, goal=None):
    """Finding of the cause of a StepFailed: call at the failing iterate; the system is rolled back here. Collective.

    goal: t at which the step was to end; None on an arc.
    """
    known = failure.finding
    inverted = system.check()
    system.rollback()
    if known.kind in CERTAIN:
        return known
    if inverted and (worst := system.check(SQUEEZED)):  # no iterate gone astray: the accepted state was about to
        return worst
    troubles = [found for term in system.terms if (found := term.trouble(system.state))]
    if lost := [trouble for trouble in troubles if trouble.kind == LOST]:
        return lost[0]
    if known.kind == RIGID_MOTION:
        return known
    system.assemble_tangent()
    matrix = _supported(system)
    found = rigid_motion(system, matrix) or next(iter(troubles), None)
    if found is None and matrix.getSize()[0] <= LARGEST:
        found = limit_point(system, matrix, goal)
    return found or (inverted if known.kind == UNKNOWN else None) or known


def _supported(system):
    """Copy of the tangent in which supports hold as stiffly as the stiffest node."""
    matrix = system.matrix.copy()
    matrix.setLGMap(*system.matrix.getLGMap())
    largest = matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY)
    matrix.zeroRowsColumnsLocal(system.supports.owned, largest)
    return matrix


# -- rigid-body motion ------------------------------------------------------------------------------------------------
def rigid_motion(system, matrix):
    """A finding if some bodies can move as rigid ones without any resistance."""
    modes = [mode for _, nodes in system.bodies for mode in _rigid_modes(system, nodes)]
    names = [name for name, _ in system.bodies]
    diagonal = matrix.getDiagonal()
    energy, weight = np.zeros((len(modes),) * 2), np.zeros((len(modes),) * 2)
    force, scaled = matrix.createVecLeft(), matrix.createVecLeft()
    for j, mode in enumerate(modes):
        matrix.mult(mode, force)
        scaled.pointwiseMult(diagonal, mode)
        energy[:, j] = [other.dot(force) for other in modes]
        weight[:, j] = [other.dot(scaled) for other in modes]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(weight), 1e-300))
    values, vectors = _lowest(scale[:, None] * energy * scale, scale[:, None] * weight * scale)
    free = vectors[:, values < FREE]
    if not free.size:
        return None
    share = np.linalg.norm(free, axis=1).reshape(len(names), 6)
    moving = [(name, part) for name, part in zip(names, share, strict=True) if part.max() > 0.1]
    text = []
    for name, part in moving:
        how = [MOVES[i] for i in range(6) if part[i] > 0.3 * part.max()]
        text.append(f"body '{name}' {', '.join(how)} without resistance")
    waiting = _open_contacts(system, {name for name, _ in moving})
    gap = f"close the gap of {waiting}, which is open, or cross it" if waiting else "bring it into contact, or move it there"
    remedy = f"fix a surface, use a symmetry plane, {gap} with prescribe or solve(..., stabilise=True)"
    place = f"body '{', '.join(name for name, _ in moving)}'"
    return Finding(RIGID_MOTION, " and ".join(text), place, remedy)


def _open_contacts(system, names):
    """Contacts of these bodies without a closed point (status 0: open) at the state evaluated last, in words. Collective."""
    found = []
    for term in (term for term in system.terms if hasattr(term, "touches")):
        met = sum(term.touches(nodes) for name, nodes in system.bodies if name in names)
        met, closed = system.comm.allreduce(np.array([met, int(term.statuses().any())]))
        if met and not closed:
            found.append(f"contact '{term.name}'")
    return " or ".join(found)


def _lowest(energy, weight):
    """Eigenvalues and vectors of the symmetric part of energy against weight."""
    sizes, axes = np.linalg.eigh(weight)
    good = sizes > 1e-12 * sizes.max()
    whiten = axes[:, good] / np.sqrt(sizes[good])
    values, vectors = np.linalg.eigh(whiten.T @ (0.5 * (energy + energy.T)) @ whiten)
    vectors = whiten @ vectors
    return values, vectors / np.linalg.norm(vectors, axis=0)


def _rigid_modes(system, nodes):
    """Six rigid motions of a body from its current place, as PETSc vectors of unit size; turns about its own centre."""
    owned = system.space.dofmap.index_map.size_local
    nodes = nodes[nodes < owned]
    x = system.space.tabulate_dof_coordinates()[nodes] + system.state.u.x.array.reshape(-1, 3)[nodes]
    sums = system.comm.allreduce(np.append(x.sum(axis=0), len(nodes)))
    x = x - sums[:3] / sums[3]
    modes = []
    for axis in range(6):
        mode = system.new_vector()
        mode.set(0.0)
        values = np.zeros((owned, 3))
        turn = np.eye(3)[axis % 3]
        values[nodes] = turn if axis < 3 else np.cross(turn, x)
        mode.array[:] = values.ravel()
        mode.normalize()
        modes.append(mode)
    return modes


# -- limit point ------------------------------------------------------------------------------------------------------
def limit_point(system, matrix, goal=None):
    """A finding if the softest motion of the tangent has lost nearly all stiffness it has in the unloaded bodies, and the
    path's rate says that the fold lies no further ahead than a few times the step to `goal`.

    A soft motion alone stops no step: sliding bodies have one, and so has a point on a fillet. Forks are found by the rate
    too, for only an imperfect one stops Newton's method, and before that the path bends.
    """
    mode = softest(system, matrix)
    if mode is None:
        return None
    force = matrix.createVecLeft()
    matrix.mult(mode, force)
    now = mode.dot(force)
    unloaded = _unloaded_stiffness(system, mode)
    if not abs(now) < FOLDED * unloaded:
        return None
    if goal is not None and not fold_ahead(system) <= AHEAD * abs(goal - system.committed_t):
        return None
    name, place = _largest(system, mode)
    text = (
        f"its softest motion keeps {now / unloaded:.2g} of the stiffness it has unloaded: the load path folds back or forks"
    )
    remedy = "follow the path by arc length or prescribe a displacement in place of the load"
    return Finding(LIMIT_POINT, text, f"body '{name}' at {place}", remedy)


def fold_ahead(system):
    """How far [t] ahead of the accepted state the load path folds back, as its last step and its rate tell. Collective.

    Before a fold at t_f displacements are u_f - a sqrt(t_f - t). So the rate du/dt over the mean rate of a last step of
    length h is q = (1 + sqrt((d + h) / d)) / 2, d = t_f - t: endless where the rate does not grow from step to step, zero
    where the tangent is singular. A first step, which has none before it, may have any fold ahead: zero.
    """
    if len(system.accepted) < 2:
        return 0.0
    (u, travel, t), (u_now, travel_now, t_now) = system.accepted[-2:]
    step = system.new_vector()
    step.array[:] = (u_now - u)[: step.getLocalSize()]
    arc = ArcLength(LinearSolver(system, "direct", afresh=True))
    try:
        arc.start(system)
    except StepFailed:
        return 0.0
    moved = np.sqrt(step.dot(step) / (step.getSize() / 3) + np.sum((travel_now - travel) ** 2))
    q = arc.per_load * (t_now - t) / moved if moved > 0.0 else np.inf
    return (t_now - t) / (4.0 * q * (q - 1.0)) if q > 1.0 else np.inf


def softest(system, matrix):
    """Unit motion that the tangent resists least, by inverse iteration; None if the factorisation fails. Collective."""
    ksp = PETSc.KSP().create(system.comm)
    shifted = matrix.copy()
    shifted.shift(1e-12 * matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY))
    ksp.setOperators(shifted)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    mode, next_one = matrix.createVecRight(), matrix.createVecRight()
    mode.array[:] = np.random.default_rng(system.comm.rank).uniform(-1.0, 1.0, mode.getLocalSize())
    for _ in range(SWEEPS):
        mode.normalize()
        ksp.solve(mode, next_one)
        if ksp.getConvergedReason() < 0 or not np.isfinite(next_one.norm()):
            return None
        mode, next_one = next_one, mode
    mode.normalize()
    return mode


def _unloaded_stiffness(system, mode):
    """Rayleigh quotient of a motion in the undeformed bodies, contacts and loads away."""
    solid = system.terms[0]
    system.state.u.x.array[:] = 0.0
    system.matrix.zeroEntries()
    solid.add_tangent(system.state, system.matrix, None)
    system.matrix.assemble()
    force = system.matrix.createVecLeft()
    system.matrix.mult(mode, force)
    system.rollback()
    return mode.dot(force)


def _largest(system, mode):
    """Body and reference position of the node that moves most in a motion. Collective."""
    size = np.linalg.norm(mode.array_r.reshape(-1, 3), axis=1)
    here = (-1.0, "", "")
    if len(size):
        node = int(size.argmax())
        name = next((name for name, nodes in system.bodies if node in nodes), "")
        here = (float(size[node]), name, spot(system.space.tabulate_dof_coordinates()[node]))
    return max(system.comm.allgather(here))[1:]

"""Motions of bodies and pushed tools against which a tangent is probed: rigid ones, and the one that it resists least."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.finding import MOVES
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trials
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.types import Floats, Ints, Ints64, Mat, Vec

SWEEPS = 30  # of inverse iteration; from a random start each gains the ratio of the two lowest eigenvalues
ALONG = 1e-9  # of a motion's square: a part of it that is not rounding
SEEN = 1e-4  # of how a body moves: a part of it that is told
ROUNDED = 1e-12  # of the largest diagonal entry: what lets a singular tangent be factorised


class Drift(NamedTuple):
    """du: PETSc Vec (owned part), zero on supports but for what is tied, which goes with dq; dq (tools, 6), zero where a
    tool is not free [lengths alike]."""

    du: Vec
    dq: Floats

    def dot(self, other: "Drift") -> float:
        """Work of the other's forces, or the inner product. Collective."""
        return self.du.dot(other.du) + float(np.sum(self.dq * other.dq))

    @property
    def largest(self) -> float:
        """The largest displacement. Collective."""
        return float(max(self.du.norm(PETSc.NormType.NORM_INFINITY), np.abs(self.dq).max(initial=0.0)))


def resistance(system: System, motion: Drift, matrix: Mat) -> Drift:
    """Forces of the assembled tangent, its block of the bodies being `matrix`, against a motion. What tied nodes do and feel
    is the tools'. Collective."""
    force, own, tied = system.new_vector(), motion.du.copy(), _tied(system)
    own.array_w[tied] = 0.0
    matrix.mult(own, force)
    tools = np.zeros_like(motion.dq)
    if system.border is not None:
        border, flat = system.border, motion.dq.ravel()
        for c in np.flatnonzero(system.tools.free.ravel()):
            force.axpy(flat[c], system.border_vector(border.columns[c]))
            tools.flat[c] = system.border_vector(border.rows[c]).dot(own)
        tools += (border.corner @ flat).reshape(-1, 6)
    force.array_w[tied] = 0.0
    return Drift(force, np.where(system.tools.free, tools, 0.0))


def _tied(system: System) -> Ints64:
    """Owned dofs that go with tools."""
    dofs = system.supports.ties.dofs
    return dofs[dofs < 3 * system.space.dofmap.index_map.size_local]


def softest(system: System, first: Ints | None = None, alike: float = 0.0) -> Drift | None:
    """Motion that the assembled tangent resists least, by inverse iteration; None where it cannot be factorised.

    Of the size |du|^2 / nodes + |dq|^2 = 1: a tool counts as much as a body. first: owned dofs that move alike where the
    iteration begins; of several motions that are as soft it finds the one most like that; by default a random start.
    alike: far less than this apart, motions count as equally soft [force / length]; else round-off, over what the softest
    one resists, chooses between them. The supports are eliminated from the bodies' tangent here, and all motions resist more
    there. Collective.
    """
    shift = max(ROUNDED * system.matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY), alike)
    system.matrix.shift(shift)
    free, border = system.tools.free, system.border
    mode = Drift(system.new_vector(), np.where(free, 1.0, 0.0))
    if first is not None:
        mode.du.array[first], mode.dq[:] = 1.0, 0.0  # what is tied moves so by its tool
        system.supports.ties.add_wrenches(system.state.poses, system.state.q, mode.du.array, mode.dq)
        mode.dq[:] = np.where(free, system.comm.allreduce(mode.dq), 0.0)
    else:
        mode.du.array[:] = np.random.default_rng(system.comm.rank).uniform(-1.0, 1.0, mode.du.getLocalSize())
    if border is None:
        return _iterated(system, mode)
    largest = np.abs(border.corner).max()  # what it is the difference of is as large as it
    with border.stiffer(max(shift, 10 * ROUNDED * largest)):
        return _iterated(system, mode)


def _iterated(system: System, mode: Drift) -> Drift | None:
    """What inverse iteration makes of a motion: of the size |du|^2 / nodes + |dq|^2 = 1, or None. Collective."""
    linear, nodes = LinearSolver(system, "direct", afresh=True, singular=True), system.vector.getSize() / 3
    for sweep in range(SWEEPS):
        system.supports.put(mode.du.array_w, 0.0)
        size = system.length(*mode)
        if not (np.isfinite(size) and size > 0.0):
            return None
        mode.du.scale(1.0 / size)
        mode = Drift(mode.du, mode.dq / size)
        side = mode.du.copy()
        side.scale(-1.0 / nodes)
        try:
            increment = linear.solve_sides([(side, -mode.dq, *system.still())], again=sweep > 0)
        except LinearFailure:
            return None
        mode = Drift(*increment[0])
    size = system.length(*mode)
    mode.du.scale(1.0 / size)
    return Drift(mode.du, mode.dq / size) if np.isfinite(size) else None


def rigid_motions(system: System) -> list[tuple[str, Drift, str]]:
    """(owner, Drift, words): six rigid motions of every group of bonded bodies, but those on which all of its nodes are
    held, as a body of revolution's are along x; then the free ones of the tools."""
    found = []
    for (name, nodes), held in zip(system.bodies, system.holds.everywhere, strict=True):
        still = np.zeros_like(system.state.q)
        ways = zip(_of_body(system, nodes), MOVES, strict=True)
        found += [(name, Drift(du, still), how) for du, how in ways if not (held.any() and _goes_along(system, du, held))]
    for i, axis in zip(*np.nonzero(system.tools.free), strict=True):
        dq = np.zeros_like(system.state.q)
        dq[i, axis] = 1.0
        found.append((system.tools.names[i], Drift(_carried(system, dq), dq), MOVES[axis]))
    return found


def relaxed(system: System, trials: Trials) -> list[Drift]:
    """Motions of the pushed tools with the bodies giving way to them, by the tangent with these trial states of contacts:
    what forces on each free component alone do. [] where there are none, or the tangent is singular. Collective."""
    sides = []
    for c in np.flatnonzero(system.tools.free):
        push = np.zeros_like(system.state.q)
        push.flat[c] = 1.0
        sides.append((system.new_vector(), push, *system.still()))
    if not sides:
        return []
    system.assemble_tangent(trials=trials)
    try:
        found = LinearSolver(system, "direct", afresh=True, singular=True).solve_sides(sides)
    except LinearFailure:
        return []
    sizes = [system.length(du, dq) for du, dq in found]
    for (du, _), size in zip(found, sizes, strict=True):
        du.scale(1.0 / max(size, 1e-300))
    return [Drift(du, dq / size) for (du, dq), size in zip(found, sizes, strict=True) if np.isfinite(size) and size > 0.0]


def by_owner(system: System, motion: Drift) -> list[tuple[str, Drift, str]]:
    """(owner, Drift, ""): the parts of a motion that its bodies and tools have, what is tied to a tool with that."""
    found, owned, tied = [], system.space.dofmap.index_map.size_local, system.supports.ties.nodes
    for name, nodes in system.bodies:
        part, own = (
            Drift(system.new_vector(), np.zeros_like(motion.dq)),
            nodes[(nodes < owned) & ~np.isin(nodes, tied)],
        )
        part.du.array_w.reshape(-1, 3)[own] = motion.du.array_r.reshape(-1, 3)[own]
        found.append((name, part, ""))
    for i in np.flatnonzero(system.tools.free.any(axis=1)):
        dq = np.zeros_like(motion.dq)
        dq[i] = motion.dq[i]
        found.append((system.tools.names[i], Drift(_carried(system, dq), dq), ""))
    return found


def turning_point(system: System, name: str, motions: Sequence[Drift]) -> Floats | None:
    """The place (3,) [length] nearest to the middle of a body of that name about which all of these rigid motions turn it;
    None where there is none but that. Collective."""
    nodes = next((nodes for body, nodes in system.bodies if body == name), None)
    if nodes is None:
        return None
    owned = nodes[(nodes < system.space.dofmap.index_map.size_local) & ~np.isin(nodes, system.supports.ties.nodes)]
    x = system.space.tabulate_dof_coordinates()[owned] + system.state.u.x.array.reshape(-1, 3)[owned]
    total = system.comm.allreduce(np.array([*x.sum(axis=0), len(x)]))
    if not total[3]:
        return None
    middle, r = total[:3] / total[3], x - total[:3] / total[3]
    spread = system.comm.allreduce(np.sum(r**2) * np.eye(3) - r.T @ r)
    rows, ways = [], []
    for motion in motions:
        du = motion.du.array_r.reshape(-1, 3)[owned]
        way, moment = system.comm.allreduce(np.array([du.sum(axis=0), np.cross(r, du).sum(axis=0)]))
        turn = np.linalg.pinv(spread, rcond=ALONG, hermitian=True) @ moment
        rows.append(np.cross(turn, np.eye(3)).T)  # turn x place = rows @ place
        ways.append(way / total[3])
    matrix, side = np.concatenate(rows), -np.concatenate(ways)
    aside = np.linalg.lstsq(matrix, side, rcond=ALONG)[0]
    missed, size = np.linalg.norm(matrix @ aside - side), np.linalg.norm(side)
    there = size > SEEN * np.linalg.norm(matrix) * np.sqrt(np.trace(spread) / total[3]) and missed < SEEN * size
    return middle + aside if there else None


def _carried(system: System, dq: Floats) -> Vec:
    """How what is tied to tools goes when they move by dq (tools, 6)."""
    du, state = system.new_vector(), system.state
    with du.localForm() as local:
        local.set(0.0)
        system.supports.ties.follow(state.poses, state.q, dq, local.array_w)
    return du


def _goes_along(system: System, du: Vec, directions: Floats) -> bool:
    """Whether a motion of unit size has a part along directions, a sum (3, 3) of d d^T. Collective."""
    moved = du.array_r.reshape(-1, 3)
    return bool(system.comm.allreduce(float(np.einsum("ni,ij,nj->", moved, directions, moved))) > ALONG)


def _of_body(system: System, nodes: Ints64) -> list[Vec]:
    """Six rigid motions of a body from its current place, as PETSc vectors of unit size; turns about its own centre. What is
    tied to a tool moves with that alone."""
    owned, tied = system.space.dofmap.index_map.size_local, system.supports.ties.nodes
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
        values[tied[tied < owned]] = 0.0
        mode.array[:] = values.ravel()
        mode.normalize()
        modes.append(mode)
    return modes

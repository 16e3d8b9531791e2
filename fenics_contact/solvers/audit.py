"""Audit of a System's tangent: Taylor remainders of every block at the accepted state, and the order of Newton's method."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.exchange import sum_to_owners
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import Term
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Bools, Floats, Vec

STEP = 1e-4  # of a cell, by which nodes are moved: far below penetrations at the default penalty, far above round-off
SHARES = 0.25 ** np.arange(5)  # of that motion: a slip under a small pressure turns within the larger ones
SECOND = 1.8  # order above which a remainder is of second order: third-order terms and kinks of single cells shift it
ROUNDING = 1e-9  # of the block's linear part, where STEP leaves round-off 1e-11: smaller remainders have no order
RESIDUAL_ROUNDING = 1e-12  # of the largest force


@dataclass(frozen=True)
class Block:
    """One block: its points that were moved (0: all cells), order of its Taylor remainder (inf: linear), and the largest
    remainder over the linear part."""

    name: str
    points: int
    order: float
    remainder: float

    @property
    def right(self) -> bool:
        return self.order >= SECOND


@dataclass(frozen=True)
class Audit:
    """blocks; residuals: out-of-balance shares after each solve of the last step, and their order at its end, None where
    these are too few to tell."""

    blocks: list[Block]
    residuals: list[float]
    newton_order: float | None

    @property
    def right(self) -> bool:
        return all(block.right for block in self.blocks)

    def __str__(self) -> str:
        width = max(len(block.name) for block in self.blocks)
        lines = [f"{'block':{width}}  points  order  remainder"]
        for b in self.blocks:
            order = "linear" if np.isinf(b.order) else f"{b.order:6.2f}"
            verdict = "" if b.right else "  WRONG: the tangent is not the derivative of the forces"
            lines.append(f"{b.name:{width}}  {b.points or 'all':>6}  {order}  {b.remainder:9.1e}{verdict}")
        sizes = ", ".join(f"{size:.1e}" for size in self.residuals)
        order = "too few iterations to tell an order" if self.newton_order is None else f"order {self.newton_order:.2f}"
        return "\n".join([*lines, f"Newton's method in the last step: {order}, out-of-balance shares {sizes}"])


def audit(system: System, residuals: Sequence[float] = ()) -> Audit:
    """Audit at the last accepted state, which is the system's again afterwards; residuals of its last step. Collective.

    Each term's forces at x + h d must be F + h K d + O(h^2). Points of a contact that change their status or facet along
    the way have no derivative there and are left out, e.g. half of those that slipped: they rest on Coulomb's cone.
    """
    system.trail.rollback()
    move = _move(system)
    others = [term for term in system.terms if term not in system.contact_terms]
    blocks = [_taylor(system, term, term.name, 0, move, {}) for term in others]
    blocks += [block for contact in system.contact_terms for block in _blocks(system, contact, move)]
    with system.foresight.as_accepted():
        system.assemble_residual()  # the terms' tractions are those of the state again
    return Audit(blocks, list(residuals), _order(residuals))


def _move(system: System) -> tuple[Floats, Floats]:
    """Motion (local dofs, free tools' coordinates) [length] of STEP of a cell, the same on any number of ranks."""
    X = system.space.tabulate_dof_coordinates()
    mesh = system.space.mesh
    size = STEP * system.extent / max(compat.cell_map(mesh).size_global, 1) ** (1 / mesh.topology.dim)
    keys = node_keys(system.space).astype(float)
    waves = np.sin(np.outer(keys + 1.0, [12.9898, 78.233, 37.719])) * 43758.5453  # a hash: neighbours differ
    du = 2.0 * (waves - np.floor(waves)) - 1.0
    dq = np.cos(np.arange(system.state.q.size)).reshape(-1, 6)
    return size * du[: len(X)].ravel(), size * np.where(system.tools.free, dq, 0.0)


def _blocks(system: System, term: ContactTerm, move: tuple[Floats, Floats]) -> Iterator[Block]:
    for name, frictionless, mask in _parts(system, term, move):
        count = system.comm.allreduce(int(mask.sum()))
        if count:
            trials = {term: term.parts.part(mask, frictionless)}
            yield _taylor(system, term, f"{term.name}: {name}", count, move, trials)


def _parts(system: System, term: ContactTerm, move: tuple[Floats, Floats]) -> Iterator[tuple[str, bool, Bools]]:
    """(name, without friction?, mask of the points) of a contact's laws."""
    frictions = [False, True] if term.rough else [True]
    for frictionless in frictions:
        trial, branches = term.parts.part(np.ones(term.surface.count, dtype=bool), frictionless), []
        for h in (0.0, *SHARES):
            _displace(system, move, h)
            branches.append(term.parts.branches(system.state, trial))
        system.trail.rollback()
        same = np.all([(b == branches[0]).all(axis=1) for b in branches], axis=0)
        status = branches[0][:, 0]
        for name, code in term.parts.laws(frictionless).items():
            yield name, frictionless, same & (status == code)


def _displace(system: System, move: tuple[Floats, Floats], share: float) -> None:
    """The accepted state moved by share of a motion."""
    system.trail.rollback()
    system.state.u.x.array[:] += share * move[0]
    system.state.q[:] += share * move[1]


def _taylor(system: System, term: Term, name: str, points: int, move: tuple[Floats, Floats], trials: Trials) -> Block:
    system.trail.rollback()
    force, tool_force = _forces(system, term, trials)
    linear, tool_linear = _rate(system, term, trials, *move)
    size = _norm(linear, tool_linear)
    remainders = []
    for h in SHARES:
        _displace(system, move, h)
        there, tool_there = _forces(system, term, trials)
        there.axpy(-1.0, force)
        there.axpy(-h, linear)
        remainders.append(_norm(there, tool_there - tool_force - h * tool_linear))
    system.trail.rollback()
    shares = np.array(remainders) / size if size > 0.0 else np.sign(remainders)
    known = shares[shares > ROUNDING]
    order = np.inf if len(known) < 2 else float(np.log(known[-2] / known[-1]) / np.log(SHARES[0] / SHARES[1]))
    return Block(name, points, order, float(shares[0]))


def _norm(vector: Vec, tools: Floats) -> float:
    return float(np.hypot(vector.norm(PETSc.NormType.NORM_2), np.linalg.norm(tools)))


def _forces(system: System, term: Term, trials: Trials) -> tuple[Vec, Floats]:
    """Forces of one term on all dofs (PETSc Vec) and on the tools (tools, 6), at the state. Collective."""
    vector, tools = system.new_vector(), np.zeros_like(system.tool_residual)
    with vector.localForm() as local:
        local.set(0.0)
        term.add_residual(system.state, local.array_w, tools, trials)
    sum_to_owners(vector)
    return vector, system.comm.allreduce(tools)


def _rate(system: System, term: Term, trials: Trials, du: Floats, dq: Floats) -> tuple[Vec, Floats]:
    """Rate of the forces when the local dofs move by du and the tools by dq, by the term's tangent. Collective."""
    system.assemble_tangent([term], trials)
    move, rate = system.new_vector(), system.matrix.createVecLeft()
    move.array[:] = du[: move.getLocalSize()]
    system.matrix.mult(move, rate)
    if system.border is None:
        return rate, np.zeros_like(dq)
    rate.axpy(1.0, system.border_vector(dq.ravel() @ system.border.columns))
    tools = system.comm.allreduce(system.border.rows @ du) + system.border.corner @ dq.ravel()
    return rate, tools.reshape(-1, 6)


def _order(sizes: Sequence[float]) -> float | None:
    """Order by the last three out-of-balance shares in a row that fall, above round-off; None where there are none."""
    falls = np.diff(np.log(np.maximum(sizes, RESIDUAL_ROUNDING)))
    known = np.minimum(sizes[1:], sizes[:-1]) > RESIDUAL_ROUNDING
    orders = [
        falls[i + 1] / falls[i] for i in range(len(falls) - 1) if known[i : i + 2].all() and falls[i : i + 2].max() < 0.0
    ]
    return float(orders[-1]) if orders else None

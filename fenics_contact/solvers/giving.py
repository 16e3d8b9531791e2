"""How bodies give way where their cells are less stiff than the tangent: one solve in a state that has been accepted."""

from collections.abc import Iterable
from itertools import chain

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trials
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.solvers.sensitivity import local
from fenics_contact.types import Floats, Vec

ENOUGH = 1e-2  # relative residual of an iterative solve: of energies its square is what it leaves
HELD = 1e6  # of the largest stiffness: that of what is held without a support


def gives(system: System, linear: LinearSolver, u: Floats, softer: Iterable[Blocks], force: Floats) -> Floats | None:
    """Motion (local) of the dofs, that have moved by u (local), as the tangent falls by `softer` and the force (local) comes
    in, whole once that is drawn; None where the tangent is singular.

    In the state itself contacts go on as they are; in an earlier one all nodes stay on which loads or contacts acted.
    Collective.
    """
    state, own = system.state, system.state.u.x.array.copy()
    here = all(system.comm.allgather(bool(np.array_equal(u, own))))
    with system.as_accepted():
        try:
            if here:
                trials: Trials = {term: term.penalties.stiffened(state, 1.0) for term in system.contact_terms}
                system.assemble_residual(trials=trials)
                system.assemble_tangent(trials=trials, more=softer)
            else:
                state.u.x.array[:] = u
                system.assemble_tangent(system.terms[:1], more=chain(softer, _holding(system)))
            linear.forget()  # frees what would stand beside that of the softer tangent, which is no guide to the next ones
            solver = LinearSolver(system, linear.method)
            ((du, _),) = solver.solve_sides([(*_led(system, force), *system.still())], ENOUGH)
            return local(system, du)
        except LinearFailure:
            return None
        finally:
            state.u.x.array[:] = own
            system.assemble_residual()


def _led(system: System, force: Floats) -> tuple[Vec, Floats]:
    """What the residual and the tools' one grow by with forces (local) on the nodes. Collective."""
    wrenches, residual, supports = np.zeros_like(system.tool_residual), system.border_vector(force), system.supports
    with residual.localForm() as ghosted:
        supports.ties.add_wrenches(system.state.poses, system.state.q, ghosted.array_r, wrenches)
        supports.put_forces(ghosted.array_w, 0.0)
    return residual, system.comm.allreduce(wrenches)


def _holding(system: System) -> Iterable[Blocks]:
    """Stiffness that holds the tools, and the nodes on which the solid is out of balance."""
    forces, wrenches = np.zeros_like(system.state.u.x.array), np.zeros_like(system.tool_residual)
    system.terms[0].add_residual(system.state, forces, wrenches)
    sizes = np.linalg.norm(system.border_vector(forces).array_r.reshape(-1, 3), axis=1)
    nodes, stiffness = np.flatnonzero(sizes > ALLOWED * system.scales.largest), HELD * system.scales.stiffness
    blocks = np.broadcast_to(stiffness * np.eye(3), (len(nodes), 3, 3))
    free = np.full(wrenches.size, stiffness) if wrenches.size and system.comm.rank == 0 else None
    yield Blocks(pairs=(nodes, nodes, blocks), whole=False, free=free)

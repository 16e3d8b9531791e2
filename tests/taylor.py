"""Taylor tests: what a tangent leaves of the change of the forces falls with the square of the way."""

import numpy as np

from fenics_contact.kernels.status import OPEN


def forces(term, state):
    """What a term puts on the nodes and, behind these, on the tools' coordinates."""
    on_nodes, on_tools = np.zeros_like(state.u.x.array), np.zeros_like(state.q)
    term.add_residual(state, on_nodes, on_tools)
    return np.concatenate([on_nodes, on_tools.ravel()])


def random_way(system):
    """A motion of all nodes and, behind these, of the tools' coordinates."""
    return np.random.default_rng(2).uniform(-1, 1, system.state.u.x.array.size + system.state.q.size)


def change(system, way):
    """What the matrix and the border that were assembled last make of a way."""
    count, vector = len(system.state.u.x.array), system.new_vector()
    vector.array[:] = way[:count]
    on_nodes, border, dq = (system.matrix * vector).array.copy(), system.border, way[count:]
    if border is None:
        return on_nodes
    return np.concatenate([on_nodes + dq @ border.columns, border.rows @ way[:count] + border.corner @ dq])


def left_over(system, residual, slope, way, longest, kept):
    """Norms (4,) of what a slope leaves of a residual's change along a way, after halves of the longest step; kept() gives
    codes that must not change on the way."""
    state, start, q = system.state, system.state.u.x.array.copy(), system.state.q.copy()
    at_start, left = residual(), []
    codes = np.copy(kept())
    for step in longest / 2.0 ** np.arange(4):
        state.u.x.array[:] = start + step * way[: len(start)]
        state.q[:] = q + step * way[len(start) :].reshape(q.shape)
        left.append(np.linalg.norm(residual() - at_start - step * slope))
        assert np.array_equal(kept(), codes)
    state.u.x.array[:], state.q[:] = start, q
    return np.array(left)


def remainders(system, term, longest, way=None, kept=None):
    """The same of a term's tangent and forces along a way, by default a random one; kept: by default its statuses."""
    way = random_way(system) if way is None else way
    system.assemble_tangent([term])
    slope = change(system, way)
    return left_over(system, lambda: forces(term, system.state), slope, way, longest, kept or term.statuses)


def foreseen_left(system, contact, way, longest, closed_alone=False):
    """Norms (4,) of how far gaps foreseen after halves of the longest step along a way are from those there; closed_alone:
    of closed points."""
    state, start, left = system.state, system.state.u.x.array.copy(), []
    for step in longest / 2.0 ** np.arange(4):
        state.u.x.array[:] = start
        system.assemble_tangent()
        state.u.x.array[:] = start + step * way
        system.foresight.foresee(state)
        foreseen = contact.trial.judged.reshape(contact.surface.count, -1)[:, 0]
        system.foresight.release()
        found = contact.response(state)
        counted = found.status.ravel() != OPEN if closed_alone else slice(None)
        left.append(np.linalg.norm((foreseen - found.gap.ravel())[counted]))
    return np.array(left)


def orders(left):
    """By which power of the step the remainders fall, from each to the next."""
    return np.log2(left[:-1] / left[1:])

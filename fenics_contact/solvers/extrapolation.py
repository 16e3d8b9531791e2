"""Where a step starts from: on the curve through the last accepted states, as far as the load path goes straight on."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.assembly.trail import Accepted
from fenics_contact.types import Floats


def extrapolate(system: System, owed: Floats) -> bool:
    """Put the state, of parameter t, on the parabola or line through the last accepted ones, supports in their places.

    owed: supports' displacements still missing. False, and nothing moved, where the supports leave both curves, where an
    element would turn inside out, or where no term foresees the kinks of a contact, or one settles them by itself.
    Collective.
    """
    foresight, accepted, state = system.foresight, system.trail.accepted, system.state
    settled = not foresight.contacts or any(contact.unknowns.settles for contact in foresight.contacts)
    if settled or system.condensed or len(system.tools):
        return False
    u, _, t = system.trail.last
    for count in (3, 2):
        step = _onwards(accepted[-count:], state.t) if len(accepted) >= count else None
        if step is None or _strays(system, system.supports.held(step) - owed, owed):
            continue
        system.supports.put(step, owed)
        state.u.x.array[:] = u + step
        foresight.hold((state.t - t) / (t - accepted[-2].t))
        if np.isfinite(system.assemble_residual()):
            return True
        foresight.release()
        state.u.x.array[:] = u
    return False


def _onwards(states: Sequence[Accepted], t: float) -> Floats:
    """Displacement from the last of these states to t on the polynomial through all of them (Lagrange)."""
    times = np.array([state.t for state in states])
    step = -states[-1].u
    for i, state in enumerate(states):
        others = np.delete(times, i)
        step = step + np.prod((t - others) / (state.t - others)) * state.u
    return step


def _strays(system: System, gap: Floats, owed: Floats) -> bool:
    """True where supports would end further from their places than half the way they go. Collective."""
    left, whole = system.comm.allreduce(np.array([np.sum(gap**2), np.sum(owed**2)]))
    return bool(left > 0.25 * whole)

"""Bodies that keep strain where nothing loads them any more: rest would be a balance, and is not the one they came to."""

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.solvers.penalty_error import least_load
from fenics_contact.solvers.softness import rolled_back

KEPT = 1e-6  # of the greatest strain energy of a run: less is what balance leaves
PUT = 1e-9  # of the farthest displacement: what supports lead by less, they do not


def strained(system: System, energy: float, most: float) -> str | None:
    """Words on the energy that the accepted state keeps where all bodies at rest would be in balance, too; None where they
    would not be, none is kept, or a tool presses, which at rest may be past the bodies. energy, most: the bodies' in that
    state, and the greatest of the run. Collective.

    That is either another balance of the bodies, or a fold that no body has.
    """
    if not energy > max(KEPT * most, system.scales.noise_energy):
        return None
    least = least_load(system)
    if any(one.partner.grounded and one.forces.holding(system.state, least) for one in system.contact_terms):
        return None
    u = system.state.u.x.array
    u[:] = 0.0
    owed = system.places(system.state.t) - system.supports.held(u)
    led = system.comm.allreduce(float(np.abs(owed).max(initial=0.0)), op=MPI.MAX)
    at_rest = led <= PUT * system.scales.farthest and system.assemble_residual() <= TOLERANCE * system.scales.balance
    rolled_back(system)
    if not at_rest:
        return None
    found = system.longest(u)
    place = f", most displaced at {spot(found.place)}, by {found.value:.3g}" if found else ""
    share = f"{energy / most:.2g}" if energy < 0.99 * most else "all"
    return (
        f"at the end nothing loads the bodies, and at rest they would be in balance; yet they keep {share} of the "
        f"greatest strain energy of the run{place}: they rest in another balance, as a dome does that is pushed "
        "through, or cells or edges are folded there, which no body does; look at the deformed mesh, and see whether more "
        "steps, finer cells or a rounder edge give the same"
    )

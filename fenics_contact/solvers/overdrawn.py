"""Loads that ask more of friction than there is from the first step on, when nothing presses yet and no tangent tells."""

from fenics_contact.assembly.finding import Finding
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import ENDLESS
from fenics_contact.solvers.holding import sliding
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.softness import rolled_back
from fenics_contact.solvers.verdict import StepFailed

ROUGHLY = 1e-2  # of the force: where single points go on opening and closing, what friction is asked for is known


def overdrawn(system: System, goal: float | None) -> Finding | None:
    """A finding if the first step, to t = goal, has no balance since friction alone would have to hold bodies or tools, and
    needs more than its law allows: were it endless, there would be a balance, and in that it is asked for too much along
    some rigid motion. The system is rolled back. Collective."""
    rough = [contact for contact in system.contact_terms if contact.rough]
    if goal is None or len(system.trail.accepted) > 1 or not rough:
        return None
    for contact in rough:
        contact.take(contact.trial.with_friction(ENDLESS))
    try:
        Newton(LinearSolver(system, "direct", afresh=True), ROUGHLY).settle(system, goal)
        for contact in rough:
            contact.rollback()
        found = sliding(system, asked=True)
    except StepFailed:
        found = None
    rolled_back(system)
    return found

"""Newton's method with its safeguards taken away one by one, for maps of what each of them cures."""

from typing import Any

from fenics_contact.assembly.system import System
from fenics_contact.options import Method
from fenics_contact.plans import STEPPERS
from fenics_contact.solvers.linear import Solution
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.out_of_balance import upright


class FullSteps(Newton):
    """Newton's method without a line search."""

    @staticmethod
    def shorten(system: System, increment: Solution, before: float, size: float, strict: bool) -> tuple[float, float]:
        return upright(size), 1.0


STEPPERS["full steps"] = FullSteps

MULTIPLIERS = "and augmented to 1e-3 mm"
# name: options of `solve`; where no step is small enough to be cut, the first failure ends the run
CONTROLS: dict[str, dict[str, Any]] = {
    "full steps": {"method": Method("full steps", smallest_step=1.0)},
    "line search": {"method": Method(smallest_step=1.0)},
    "and step control": {},
    MULTIPLIERS: {},
}

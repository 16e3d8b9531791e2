"""Newton's method with its safeguards taken away one by one, for maps of what each of them cures."""

import numpy as np

from fenics_contact.run import STEPPERS
from fenics_contact.solvers.newton import Newton, StepFailed


class FullSteps(Newton):
    """Newton's method without a line search."""

    def _shorten(self, system, du, dq, before, size, strict):
        if not np.isfinite(size):
            raise StepFailed("an element turned inside out")
        return size


STEPPERS["full steps"] = FullSteps

MULTIPLIERS = "and augmented to 1e-3 mm"
# name: options of `solve`; where no step is small enough to be cut, the first failure ends the run
CONTROLS = {
    "full steps": {"method": "full steps", "smallest_step": 1.0},
    "line search": {"smallest_step": 1.0},
    "and step control": {},
    MULTIPLIERS: {},
}

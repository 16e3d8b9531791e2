"""Newton's method with its safeguards taken away one by one, for maps of what each of them cures."""

from fenics_contact.run import STEPPERS
from fenics_contact.solvers.newton import Newton, relative_residual


class FullSteps(Newton):
    """Newton's method without a line search."""

    def _shorten(self, system, *_):
        return relative_residual(system, followed=True)


STEPPERS["full steps"] = FullSteps

# name: options of `solve`; where no step is small enough to be cut, the first failure ends the run
CONTROLS = {
    "full steps": {"method": "full steps", "smallest_step": 1.0},
    "line search": {"smallest_step": 1.0},
    "and step control": {},
}

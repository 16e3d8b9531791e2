"""Augmented Lagrangian around a stepper: multipliers take over what penalties carry, until no error is left that matters."""

from fenics_contact.assembly.finding import TOO_SOFT
from fenics_contact.solvers.verdict import StepFailed


class Augmented:
    """Uzawa's iteration of multipliers within each load step, outside of the stepper's own.

    Each augmentation divides the error by about 1 + eps/k, where k is the stiffness of the bodies against the penalty eps:
    a hundred with the default penalty. Where more points are held than the facets can follow, multipliers that press on
    nothing grow until the needless points let go, which takes tens of augmentations. stepper: Newton or
    Snes; limit: largest number of augmentations of a step.
    """

    def __init__(self, stepper, limit=200):
        self.stepper, self.limit = stepper, limit

    def step(self, system, t):
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        report = self.stepper.step(system, t)
        report.misfits.append(system.misfit())
        while report.misfits[-1] > 1.0:
            if report.augmentations == self.limit:
                left, first = report.misfits[-1], report.misfits[0]
                text = f"{self.limit} augmentations left {left:.3g} times the penetration allowed, of {first:.3g} at first"
                remedy = "raise penalty= of the augmented contacts or leave it to the default, take fewer points= per facet"
                raise StepFailed(text, TOO_SOFT, remedy=remedy)
            system.augment()
            more = self.stepper.settle(system, t)
            report.iterations += more.iterations
            report.corrections += more.corrections
            report.residuals += more.residuals
            report.notes += more.notes
            report.augmentations += 1
            report.misfits.append(system.misfit())
        return report

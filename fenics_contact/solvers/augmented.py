"""Augmented Lagrangian around a stepper: multipliers take over what penalties carry, until no error is left that matters."""

from fenics_contact.assembly.finding import TOO_SOFT
from fenics_contact.solvers.verdict import StepFailed

WORTH = 0.98  # share of the error an augmentation may leave, on the mean of some: with more, hundreds would be needed
TRIED = 10  # augmentations over which that mean is taken


class Augmented:
    """Uzawa's iteration of multipliers within each load step, outside of the stepper's own.

    Each augmentation divides the error by about 1 + eps/k, where k is the stiffness of the bodies against the penalty eps:
    a hundred with the default penalty. stepper: Newton or Snes; limit: largest number of augmentations of a step.
    """

    def __init__(self, stepper, limit=100):
        self.stepper, self.limit = stepper, limit

    def step(self, system, t):
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        report = self.stepper.step(system, t)
        report.misfits.append(system.misfit())
        while report.misfits[-1] > 1.0:
            self._refuse(report.misfits)
            system.augment()
            more = self.stepper.settle(system, t)
            report.iterations += more.iterations
            report.corrections += more.corrections
            report.residuals += more.residuals
            report.notes += more.notes
            report.augmentations += 1
            report.misfits.append(system.misfit())
        return report

    def _refuse(self, misfits):
        """StepFailed where the errors fall too slowly."""
        done = len(misfits) - 1
        slow = done > TRIED and misfits[-1] > WORTH**TRIED * misfits[-1 - TRIED]
        if slow or done >= self.limit:
            text = f"{done} augmentations left {misfits[-1]:.3g} times the penetration allowed, of {misfits[0]:.3g} at first"
            remedy = "raise penalty= of the augmented contacts, or leave it to the default"
            raise StepFailed(text, TOO_SOFT, remedy=remedy)

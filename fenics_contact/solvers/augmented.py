"""Steps solved again with better multipliers, until no error is left that matters, or with greater penalties."""

from fenics_contact.assembly.finding import TOO_SOFT
from fenics_contact.solvers.verdict import StepFailed

AUGMENTATIONS = 200  # of a step, at most: where points have to let go it takes tens

# Out-of-balance share above which penetrations are no measure of pressure: a point that closed in a single solve, 2 % of a
# cell deep, leaves 2 E times its area (100 E / h is the default penalty), the force of tens of points at a strain of a tenth
BALANCED = 1e-2


class Augmented:
    """Uzawa's iteration of multipliers within each load step, outside of the stepper's own: an augmented Lagrangian.

    Each augmentation divides the error by about 1 + eps/k, where k is the stiffness of the bodies against the penalty eps:
    a hundred with the default penalty. Where more points are held than the facets can follow, multipliers that press on
    nothing grow until the needless points let go, which takes tens of augmentations. stepper: Newton, Snes or
    Incremental; limit: largest number of augmentations of a step.
    """

    def __init__(self, stepper, limit=AUGMENTATIONS):
        self.stepper, self.limit = stepper, limit

    def step(self, system, t):
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        return self._augment(system, t, self.stepper.step(system, t))

    def settle(self, system, t):
        """Into balance at t from the present state, after penalties have changed."""
        return self._augment(system, t, self.stepper.settle(system, t))

    def _augment(self, system, t, report):
        while augment(system, report, self.limit):
            report.add(self.stepper.settle(system, t))
        return report


def augment(system, report, limit):
    """Let a state's multipliers grow where that is needed: False, or True where it has to be solved again.

    A state far from balance, as an incremental step leaves it where points have closed, is solved again as it is.
    """
    if not system.augmented:
        return False
    report.misfits.append(system.misfit())
    if report.misfits[-1] <= 1.0:
        return False
    if report.augmentations == limit:
        left, first = report.misfits[-1], report.misfits[0]
        text = f"{limit} augmentations left {left:.3g} times the penetration allowed, of {first:.3g} at first"
        remedy = "raise penalty= of the augmented contacts or leave it to the default, take fewer points= per facet"
        raise StepFailed(text, TOO_SOFT, remedy=remedy)
    if report.residuals[-1] <= BALANCED:
        system.augment()
    report.augmentations += 1
    return True


class Adapted:
    """Default penalties that are raised, and the step solved again, where slave points sink in too far.

    Where a step cannot be solved with greater penalties it is taken with those there were. stepper: Newton, Snes,
    Incremental or Augmented.
    """

    def __init__(self, stepper):
        self.stepper = stepper

    def step(self, system, t):
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        report = self.stepper.step(system, t)
        while raised := raise_penalties(system, report):
            try:
                report.add(self.stepper.settle(system, t))
            except StepFailed as failure:
                forgo(system, raised, report, failure)
                report.add(self.step(system, t))
                return report
        return report


def raise_penalties(system, report):
    """The terms that have raised their penalties at a state near balance, which is then to be solved again. Collective."""
    if report.residuals[-1] > BALANCED:
        return []
    found = {
        term: note for term in system.terms if hasattr(term, "raise_penalty") and (note := term.raise_penalty(system.state))
    }
    report.notes += found.values()
    report.raises += bool(found)
    return list(found)


def forgo(system, raised, report, failure):
    """Back to the last accepted state after a failure with greater penalties: these terms keep the ones they had."""
    system.rollback()
    for term in raised:
        term.forgo_raise()
    report.notes.append(f"not solved with them ({failure}): penalties stay")

"""Load path: from t = 0 to 1 in steps, cutting a step back when it fails."""

import time
from dataclasses import dataclass, field

from fenics_contact.solvers.newton import StepFailed


@dataclass
class Verdict:
    """How a run ended: converged, the load parameter reached, and in words why not."""

    converged: bool = True
    t: float = 0.0
    reason: str = "converged"
    cuts: int = 0
    iterations: int = 0
    corrections: int = 0
    residuals: list = field(default_factory=list)  # per accepted step: out-of-balance share after each solve


def run(system, stepper, times, on_step, smallest=1e-4):
    """Visit every t of `times`; a failing step is halved down to `smallest` of t, then the run ends with its reason.

    on_step(report, seconds, on_schedule): called after each accepted step, on all ranks. Returns a Verdict.
    """
    verdict = Verdict()
    for target in times:
        pieces = [target]
        while pieces:
            start = time.perf_counter()
            goal = pieces[-1]
            try:
                report = stepper.step(system, goal)
                if wrong := system.check():
                    raise StepFailed(wrong)
            except StepFailed as failure:
                system.rollback()
                size = (goal - system.committed_t) / 2
                if size < smallest:
                    verdict.converged, verdict.reason = False, f"at t = {goal:.6g}: {failure}"
                    return verdict
                verdict.cuts += 1
                pieces.append(system.committed_t + size)
                continue
            system.commit()
            pieces.pop()
            verdict.t = goal
            verdict.iterations += report.iterations
            verdict.corrections += report.corrections
            verdict.residuals.append(report.residuals)
            on_step(report, time.perf_counter() - start, not pieces)
    return verdict

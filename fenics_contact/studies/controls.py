"""Newton's method with its safeguards taken away one by one, for maps of what each of them cures."""

import time

import numpy as np

from fenics_contact.run import Result
from fenics_contact.solvers.control import run
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton, relative_residual


class FullSteps(Newton):
    """Newton's method without a line search."""

    def _shorten(self, system, *_):
        return relative_residual(system, followed=True)


# name: (stepper, smallest step to which a failing one is cut; endless: the first failure ends the run)
CONTROLS = {
    "full steps": (FullSteps, np.inf),
    "line search": (Newton, np.inf),
    "and step control": (Newton, 1e-4),
}


def carry(scene, control, steps, move=None, push=None, record=None):
    """`solve` under one of CONTROLS, without files; record: function of the state kept for each accepted step."""
    stepper, smallest = CONTROLS[control]
    system = scene.system(move, push)
    start, history = time.perf_counter(), []

    def on_step(report, seconds, on_schedule):
        history.append({"t": system.state.t} | (record(system.state) if record else {}))

    times = np.arange(1, steps + 1) / steps
    verdict = run(system, stepper(LinearSolver(system, "direct")), times, on_step, smallest)
    seconds = {"set-up": 0.0, "total": time.perf_counter() - start, **system.timers.seconds}
    return Result(history, verdict, system, {"seconds": seconds, "sizes": {"unknowns": system.vector.getSize()}})

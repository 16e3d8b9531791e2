"""The share of the largest force that is out of balance: how large it is, when it is little enough, how far to solve."""

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.solvers.reuse import TIGHTEST
from fenics_contact.solvers.verdict import StepFailed

# Share below which foreseen pressures and those of the gaps agree to what Newton leaves anyway, and samples of averages lie
# where they will at last.
HELD = 1e-3
LOOSEST = 1e-3  # relative residual of an iterative solve far from balance


def upright(size: float) -> float:
    """An out-of-balance norm as it is; StepFailed where it is no number, or endless."""
    if not np.isfinite(size):
        raise StepFailed("an element turned inside out")
    return size


def relative_residual(system: System, followed: bool = False) -> float:
    """Out-of-balance norm over its scale; StepFailed where it is not a number."""
    size, scale = upright(system.assemble_residual(followed)), system.scales.balance
    return size / scale if scale > 0.0 else size


def finite_residual(system: System) -> float:
    """The same with condensed unknowns where the last tangent puts them, infinite where an element is inside out."""
    try:
        return relative_residual(system, followed=True)
    except StepFailed:
        return np.inf


def balanced(system: System, size: float, tolerance: float) -> bool:
    """Whether an out-of-balance share meets the tolerance, or is all rounding."""
    return size <= tolerance or size * system.scales.balance <= system.scales.noise


def forcing(size: float, tolerance: float) -> float:
    """How far an iterative solve must go: a tenth of what Newton's quadratic convergence can gain from this share, nor
    farther than a tenth of what it is to reach.

    (Dembo, Eisenstat & Steihaug 1982, doi:10.1137/0719025.) The predictor, which has no residual yet, gets 1e-5, for
    its right-hand side may hold a penalty times the travel of a tool, many times the forces.
    """
    if size == np.inf:
        return 1e-5
    wanted = max(0.1 * size, 0.1 * tolerance / max(size, tolerance))
    return float(np.clip(wanted, TIGHTEST, LOOSEST))


def stalls(residuals: list[float]) -> bool:
    """Whether the last two solves have left more than a quarter of what was out of balance, as where a point slips to and
    fro, past the place where it would stick."""
    return len(residuals) > 2 and residuals[-1] > 0.25 * residuals[-3]

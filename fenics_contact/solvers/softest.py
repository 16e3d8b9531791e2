"""The softest motion that a preconditioned tangent leaves, and whether it resists: what can be told without pivots."""

from collections.abc import Callable
from typing import Any

import numpy as np

from fenics_contact.types import Floats, Mat, Vec

LEAST, MOST = 4, 30  # products
NEAR = 0.1  # of the least eigenvalue: error at which it is known well enough
INVERSE, TURNED = 2, 0.5  # solves, and the error of their eigenvector that is borne


class Softest:
    """Follows the eigenvector of M^-1 A with the least eigenvalue, from one tangent A to the next, by Arnoldi's method.

    (Arnoldi 1951, doi:10.1090/qam/42792.) With a multigrid cycle for M, or the factors of an older tangent, most others lie
    near one, and a few products tell. loads: forces in which every motion has a part, zero where supports hold nodes: what
    they move joins the `vector` found last, so that another motion that softens is not overlooked. Collective.
    """

    def __init__(self, loads: Vec) -> None:
        self.loads, self.vector = loads, loads.duplicate()

    def start(self, motion: Vec) -> Vec | None:
        """A motion of any length and the vector found last, of length 1; None where the motion is none."""
        start = motion.copy()
        if not start.normalize() > 0.0:
            return None
        start.axpy(1.0, self.vector)
        start.normalize()
        return start

    def resists(self, A: Mat, pc: Any, symmetric: bool) -> bool:
        """Whether no motion that is found lowers the energy; of an unsymmetric tangent, whether no eigenvalue that is found
        is negative, as one is whose determinant is."""
        force, right = self.loads.duplicate(), self.loads.duplicate()
        pc.apply(self.loads, right)
        if (start := self.start(right)) is None:
            return True
        basis, H, lowers = [start], np.zeros((MOST + 1, MOST)), False
        least, error, weights = 1.0, np.inf, np.ones(1)
        for j in range(MOST):
            A.mult(basis[j], force)
            lowers = lowers or (symmetric and j == 0 and force.dot(basis[0]) < 0.0)
            pc.apply(force, right)
            for _ in range(2):  # what is left may be round-off, which is not orthogonal after once
                for i, other in enumerate(basis):
                    part = right.dot(other)
                    H[i, j] += part
                    right.axpy(-part, other)
            H[j + 1, j] = right.norm()
            if not np.isfinite(H[: j + 2, j]).all():
                break
            least, error, weights = _least(H, j + 1)
            if (j + 1 >= LEAST and error <= NEAR * abs(least)) or H[j + 1, j] == 0.0:
                break
            basis.append(right.copy())
            basis[-1].scale(1.0 / H[j + 1, j])
        self.vector.set(0.0)
        for weight, vector in zip(weights, basis, strict=False):
            self.vector.axpy(weight, vector)
        if not self.vector.normalize() > 0.0:
            self.vector.axpy(1.0, basis[0])
        if symmetric:  # a proof, whatever the preconditioner
            A.mult(self.vector, force)
            lowers = lowers or force.dot(self.vector) < 0.0
        else:
            lowers = least < 0.0 and error <= NEAR * abs(least)
        for vector in (*basis, force, right):
            vector.destroy()
        return not lowers


def has_turned(motion: Vec, solve: Callable[[Vec, Vec], int]) -> tuple[bool, Vec]:
    """Whether the tangent's eigenvalue next to zero, of an eigenvector near a motion, is negative, and that vector: inverse
    iteration. solve: of a right side and for the solution; negative where that failed. Collective."""
    along, size, motion = 0.0, 1.0, motion.copy()
    for _ in range(INVERSE):
        out = motion.duplicate()
        if solve(motion, out) < 0:
            return False, motion
        along, size = out.dot(motion), out.norm()
        motion = out
        motion.scale(1.0 / size)
    return along < 0.0 and 1.0 - (along / size) ** 2 < TURNED**2, motion


def _least(H: Floats, size: int) -> tuple[float, float, Floats]:
    """(real part of the least eigenvalue of Hessenberg's matrix, error that it may have, its vector); a pair of complex ones
    has no sign, and its error is infinite."""
    values, vectors = np.linalg.eig(H[:size, :size])
    at = int(values.real.argmin())
    error = abs(H[size, size - 1] * vectors[-1, at])
    paired = abs(values[at].imag) > 1e-12 * abs(values[at])
    return float(values[at].real), np.inf if paired and values[at].real < 0.0 else float(error), vectors[:, at].real

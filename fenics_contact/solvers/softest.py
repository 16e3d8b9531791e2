"""The softest motion that a preconditioned tangent leaves, and whether it resists: what can be told without pivots."""

from collections.abc import Callable
from typing import Any

import numpy as np

from fenics_contact.types import Array, Floats, Mat, Vec

LEAST, MOST = 4, 30  # products
FIRST = 12  # at least, as long as no motion is known
NEAR = 0.1  # of the least eigenvalue: error at which it is known well enough
INVERSE, ITERATIVE = 6, 3  # solves with a tangent, by its factors and by iterations, each of which is as many products


class Softest:
    """Follows the eigenvector of M^-1 A with the least eigenvalue, from one tangent A to the next, by Arnoldi's method.

    (Arnoldi 1951, doi:10.1090/qam/42792.) With a multigrid cycle for M, or the factors of an older tangent, most others lie
    near one, and a few products tell. loads: forces in which every motion has a part, zero where supports hold nodes: what
    they move joins the vector found last, so that another motion that softens is not overlooked. Collective.
    """

    def __init__(self, loads: Vec) -> None:
        self._loads, self._vector, self._known = loads, loads.duplicate(), False

    def _start(self, motion: Vec) -> Vec | None:
        """A motion of any length and the vector found last, of length 1; None where the motion is none."""
        start = motion.copy()
        if not start.normalize() > 0.0:
            return None
        start.axpy(1.0, self._vector)
        start.normalize()
        return start

    def resists(self, A: Mat, pc: Any, symmetric: bool) -> bool:
        """Whether no motion that is found lowers the energy; of an unsymmetric tangent, whether no eigenvalue that is found
        is negative, as one is whose determinant is."""
        force, right = self._loads.duplicate(), self._loads.duplicate()
        pc.apply(self._loads, right)
        if (start := self._start(right)) is None:
            return True
        span, lowers, found = _Span(start, MOST), False, (1.0, np.inf, np.ones(1))
        for j in range(MOST):
            A.mult(span.last, force)
            lowers = lowers or (symmetric and j == 0 and force.dot(start) < 0.0)
            pc.apply(force, right)
            if not span.add(right):
                break
            found = _least(*span.table)
            if j + 1 >= (LEAST if self._known else FIRST) and found[1] <= NEAR * abs(found[0]):
                break
        span.combine(found[2], self._vector)
        self._known = True
        if symmetric:  # a proof, whatever the preconditioner
            A.mult(self._vector, force)
            lowers = lowers or force.dot(self._vector) < 0.0
        else:
            lowers = _is_negative(found)
        for vector in (*span.basis, force, right):
            vector.destroy()
        return not lowers

    def has_turned(self, solve: Callable[[Vec, Vec], int], most: int, alone: bool = False) -> bool:
        """Whether a tangent has a negative eigenvalue, by Arnoldi's method with its inverse, in which those next to zero are
        the largest of both signs; what is softest, or goes negative, is found last then.

        solve: of a right side and for the solution, negative where that failed; most: solves, once a motion is known; alone:
        of the motion found last, the loads apart. Collective.
        """
        start = self._vector.copy() if alone else self._start(self._loads)
        if start is None:
            return False
        most = most if self._known else FIRST
        span, out, softest, turned = _Span(start, most), start.duplicate(), np.ones(1), False
        for _ in range(most):
            if solve(span.last, out) < 0 or not span.add(out):
                break
            table = span.table
            found, (values, vectors) = _least(*table), table[2:]
            turned = _is_negative(found)
            softest = found[2] if turned else vectors[:, np.abs(values).argmax()].real
            if turned:
                break
        span.combine(softest, self._vector)
        self._known = True
        for one in (*span.basis, out):
            one.destroy()
        return turned


class _Span:
    """Arnoldi's basis of what a product makes of a start of length 1, with at most so many products."""

    def __init__(self, start: Vec, most: int) -> None:
        self.basis, self._H, self._size = [start], np.zeros((most + 1, most)), 0

    @property
    def last(self) -> Vec:
        return self.basis[-1]

    @property
    def table(self) -> tuple[Floats, int, Array, Array]:
        """Hessenberg's matrix and the number of products, with its eigenvalues and vectors."""
        return self._H, self._size, *np.linalg.eig(self._H[: self._size, : self._size])

    def add(self, product: Vec) -> bool:
        """Add the product with the last vector, which is changed; False where it is no number, or leads nowhere new."""
        H, j = self._H, self._size
        for _ in range(2):  # what is left may be round-off, which is not orthogonal after once
            for i, other in enumerate(self.basis):
                part = product.dot(other)
                H[i, j] += part
                product.axpy(-part, other)
        H[j + 1, j] = product.norm()
        if not np.isfinite(H[: j + 2, j]).all():
            return False
        self._size += 1
        if H[j + 1, j] > 0.0:
            self.basis.append(product.copy())
            self.last.scale(1.0 / H[j + 1, j])
        return bool(H[j + 1, j] > 0.0)

    def combine(self, weights: Floats, vector: Vec) -> None:
        """A vector of the span, of length 1."""
        vector.set(0.0)
        for weight, one in zip(weights, self.basis, strict=False):
            vector.axpy(weight, one)
        if not vector.normalize() > 0.0:
            vector.axpy(1.0, self.basis[0])


def _is_negative(found: tuple[float, float, Floats]) -> bool:
    least, error, _ = found
    return least < 0.0 and error <= NEAR * abs(least)


def _least(H: Floats, size: int, values: Array, vectors: Array) -> tuple[float, float, Floats]:
    """Of Hessenberg's matrix with these eigenvalues and vectors (real part of the least one, error that it may have, its
    vector); a pair of complex ones has no sign, and its error is infinite."""
    at = int(values.real.argmin())
    error = abs(H[size, size - 1] * vectors[-1, at])
    paired = abs(values[at].imag) > 1e-12 * abs(values[at])
    return float(values[at].real), np.inf if paired and values[at].real < 0.0 else float(error), vectors[:, at].real

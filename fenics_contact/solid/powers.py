"""Sums of powers of the eigenvalues of B^, of any exponents, as functions of its invariants: no eigenvalue is asked for.

With det B^ = 1 its eigenvalues b are the roots of a cubic in i1 = tr B^ and i2 = tr B^^-1, and what is symmetric in them is
smooth in i1 and i2, also where eigenvalues are equal.  b^s with 0 < s < 1 is c + sum w b/(b + t) over poles -t (a rule for
its Stieltjes integral, with weights by least squares), and

    sum_b 1/(b + t) = (3 t^2 + 2 i1 t + i2)/chi,   sum_b b/(b + t) = (i1 t^2 + 2 i2 t + 3)/chi,
    sum_b b^2/(b + t) = ((i1^2 - 2 i2) t^2 + (i1 i2 - 3) t + i1)/chi,   chi(t) = t^3 + i1 t^2 + i2 t + 1,

from which b^3 = i1 b^2 - i2 b + 1 leads to higher powers; those below zero are powers of B^^-1.
"""

from functools import lru_cache

import numpy as np

from fenics_contact.types import Expr, Floats

RANGE = 100.0  # of eigenvalues, and one over it: of stretches 10
POLES = np.exp(np.linspace(-1.0, 1.0, 24) * np.log(10.0 * RANGE))  # with these errors are below 2e-8 for any exponent


def power_sum(exponent: float, i1: Expr, i2: Expr) -> Expr:
    """Sum of b^exponent over the eigenvalues b of B^, to 2e-8 where they lie in RANGE; exact for whole exponents."""
    if exponent < 0.0:
        return power_sum(-exponent, i2, i1)
    whole = int(np.floor(exponent))
    powers = _upward([3.0, i1, i1**2 - 2 * i2], whole, i1, i2)
    if exponent == whole:
        return powers
    constant, *weights = _weights(exponent - whole).tolist()
    poles = [(w / (t**3 + i1 * t**2 + i2 * t + 1.0), t) for w, t in zip(weights, POLES.tolist(), strict=True)]
    sums = [sum(w * (i1 * t**2 + 2 * i2 * t + 3) for w, t in poles)]
    if whole > 0:
        sums.append(sum(w * ((i1**2 - 2 * i2) * t**2 + (i1 * i2 - 3) * t + i1) for w, t in poles))
    if whole > 1:
        sums.append(i1 * sums[1] - i2 * sums[0] + sum(w * (3 * t**2 + 2 * i1 * t + i2) for w, t in poles))
    return constant * powers + _upward(sums, whole, i1, i2)


def _upward(sums: list[Expr], power: int, i1: Expr, i2: Expr) -> Expr:
    """Number `power` of sums of successive powers, of which the first up to three are known."""
    while len(sums) <= power:
        sums.append(i1 * sums[-1] - i2 * sums[-2] + sums[-3])
    return sums[power]


@lru_cache(maxsize=64)
def _weights(s: float) -> Floats:
    """c and w of the poles, for c + sum w b/(b + t) to be b^s, 0 < s < 1, and its rate with ln b, relative to each."""
    b = np.exp(np.linspace(-1.0, 1.0, 1500) * np.log(RANGE))[:, None]
    values = np.column_stack([np.ones(len(b)), b / (b + POLES)]) / b**s
    rates = np.column_stack([np.zeros(len(b)), POLES * b / (b + POLES) ** 2]) / (s * b**s)
    rows = np.concatenate([values, rates])
    scale = np.linalg.norm(rows, axis=0)
    found: Floats = np.linalg.lstsq(rows / scale, np.ones(len(rows)), rcond=1e-14)[0] / scale
    return found

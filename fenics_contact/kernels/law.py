"""The law of one slave point: contact traction T(g, n, w) of penalties and Coulomb friction, with its exact partials.

g is the gap [length], n the unit normal, and w = x_M - x_a [length] the way to the point's foot on the master from its
anchor there. Masters differ in how these follow the nodes; the law is the same for all. The virtual power is
T . (dv_S - dv_M), (14): -T acts on the slave.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK
from fenics_contact.kernels.vectors import AXES, ZERO, Vector, dot, less, norm, planar, plus, row, times
from fenics_contact.types import Floats

FREE = -1  # no status: the way decides
ON_CONE = 1e-8  # round-off of a traction rebuilt from its anchor, relative


class Friction(NamedTuple):
    """|T_T| <= mu(p) p under a pressure p: mu(p) = mu (p/reference)^exponent, Coulomb's constant mu for an exponent of 0;
    and |T_T| <= shear [pressure], 0: no such limit. A table (m, 2 + c) of mu(p) stands in the place of that power, mu being
    its greatest: from ln p in column 0 to ln p in column 1 a polynomial in 2 (ln p - middle)/width, its highest power first.

    ratio: mu over the coefficient across the unit vector `along`, or across each point's own, directions (np, 3) of any
    length; (0, 3): `along` holds for all. |T_T| is then sqrt((t_a)^2 + ratio^2 (t_b)^2) of the parts
    of T_T along that vector and across: the ellipse of Mroz & Stupkiewicz (1994, doi:10.1016/0020-7683(94)90167-8). Slip is
    not associated with it: friction acts against the way slid.
    """

    mu: float
    reference: float
    exponent: float
    shear: float
    ratio: float
    along: Vector
    table: Floats
    directions: Floats

    @property
    def asks_pressure(self) -> bool:
        """Whether it knows more of a pressure than that friction grows with it."""
        return bool(self.exponent or self.shear or len(self.table))


SMOOTH = Friction(  # no friction
    mu=0.0, reference=1.0, exponent=0.0, shear=0.0, ratio=1.0, along=ZERO,
    table=np.empty((0, 2)), directions=np.empty((0, 3)),
)  # fmt: skip


class Rubbing(NamedTuple):
    """Friction of one point: mu, 0 where there is none; the greatest |T_T| [pressure] under the pressure that decides, and
    its slope; ratio and `along` as of Friction. Numbers alone: arrays would be counted in each function that they pass."""

    mu: float
    limit: float
    slope: float
    ratio: float
    along: Vector


NO_RUBBING = Rubbing(mu=0.0, limit=0.0, slope=0.0, ratio=1.0, along=ZERO)  # of a point without an anchor


class Law(NamedTuple):
    """Penalties eps_N, eps_T [pressure/length]; friction; touch [length]: gaps up to it are round-off and closed, slips up
    to it are none."""

    eps_n: float
    eps_t: float
    friction: Rubbing
    touch: float


class Gaps(NamedTuple):
    """press: the gap and its multiplier over eps_N [length], by which the point presses; decides: what tells open from
    closed and stick from slip, press itself or the press that Newton's last solve foresaw."""

    press: float
    decides: float


class Traction(NamedTuple):
    """status; N [pressure]; the limit of |T_T| [pressure] and its slope d(limit)/dp; |T_T^tr|; T_T^tr, T_T and T (3,)."""

    status: int
    N: float
    limit: float
    slope: float
    size: float
    trial: Vector
    tangential: Vector
    T: Vector


class Partials(NamedTuple):
    """dT/dg and dT/d(eps_N) (3,); dT/dn and dT/dw (3, 3), by rows. Each holds the status, a foreseen pressure, and the
    other arguments."""

    g: Vector
    eps_n: Vector
    n: tuple[Vector, Vector, Vector]
    w: tuple[Vector, Vector, Vector]


@njit(cache=True, error_model="numpy")
def friction_limit(friction: Friction, p: float) -> tuple[float, float]:
    """The greatest |T_T| [pressure] under a pressure p, mu |N| of (16), and its slope."""
    if p <= 0.0:  # a gap within touch presses on nothing
        return 0.0, 0.0
    if len(friction.table) > 0:
        mu, slope = _tabulated(friction.table, math.log(p))
        slope += mu
    else:
        mu = friction.mu
        if friction.exponent != 0.0:
            mu *= (p / friction.reference) ** friction.exponent
        slope = mu * (1.0 + friction.exponent)
    if 0.0 < friction.shear <= mu * p:
        return friction.shear, 0.0
    return mu * p, slope


@njit(cache=True, error_model="numpy")
def _tabulated(table: Floats, place: float) -> tuple[float, float]:
    """mu and d mu/d(ln p) at ln p = place; beyond the table's ends what it has there."""
    low, high = 0, len(table) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if place <= table[middle, 1] else (middle + 1, high)
    start, end = table[low, 0], table[low, 1]
    s = 2.0 * (min(max(place, start), end) - start) / (end - start) - 1.0
    mu, rate = 0.0, 0.0
    for c in range(2, table.shape[1]):
        rate = rate * s + mu
        mu = mu * s + table[low, c]
    return mu, rate * 2.0 / (end - start) if start <= place <= end else 0.0


@njit(cache=True, error_model="numpy")
def rubbing(friction: Friction, q: int, p: float) -> Rubbing:
    """The friction of point q, along its own direction where each has one, under a pressure p that decides."""
    along = friction.along
    if len(friction.directions) > 0:
        d = row(friction.directions, q)
        along = times(1.0 / max(norm(d), 1e-300), d)
    limit, slope = friction_limit(friction, p)
    return Rubbing(friction.mu, limit, slope, friction.ratio, along)


@njit(cache=True, error_model="numpy")
def strength_taken(friction: Rubbing, t: Vector) -> float:
    """|T_T| of a traction t, that of the ellipse where friction has directions."""
    if friction.ratio == 1.0:
        return norm(t)
    square = friction.ratio * friction.ratio
    # a rounded difference of squares may fall below zero
    return math.sqrt(max(square * dot(t, t) + (1.0 - square) * dot(friction.along, t) ** 2, 0.0))


@njit(cache=True)
def friction_limits(friction: Friction, pressures: Floats, tractions: Floats, limits: Floats, shares: Floats) -> None:
    """Fill limits (n,) of friction under pressures (n,), and the shares (n,) of them that the sizes of friction tractions
    (n, 3) may have in their directions."""
    for i in range(len(limits)):
        t, one = row(tractions, i), rubbing(friction, i, pressures[i])
        taken, limits[i], shares[i] = strength_taken(one, t), one.limit, 1.0
        if taken > 0.0:
            shares[i] = norm(t) / taken


@njit(cache=True)
def _strength(law: Law, gaps: Gaps, N: float, limit: float, slope: float) -> float:
    """|T_T| in slip (18); under a foreseen pressure linear in the gap, so that one more solve mends what was foreseen."""
    return limit if gaps.decides == gaps.press else limit + slope * (law.eps_n * gaps.decides - N)


@njit(cache=True, error_model="numpy")
def traction(law: Law, gaps: Gaps, n: Vector, w: Vector, told: int = FREE) -> Traction:
    """The Traction T = N n + T_T of a point; told: STICK or SLIP, where the way itself is not to decide."""
    if gaps.decides > law.touch:
        return Traction(OPEN, 0.0, 0.0, 0.0, 0.0, ZERO, ZERO, ZERO)
    N = law.eps_n * gaps.press  # penalty of (15)
    friction = law.friction
    if friction.mu == 0.0:
        return Traction(CLOSED, N, 0.0, 0.0, 0.0, ZERO, ZERO, times(N, n))
    # of (17): eps_T P(n) (x_M - x_a) in place of T_T(t_k) + eps_T (xi(k+1) - xi(k))
    trial = times(law.eps_t, planar(w, n))
    limit, slope, size = friction.limit, friction.slope, strength_taken(friction, trial)
    # A way within round-off has no direction to slip in. A point that slipped when the last step was accepted starts the
    # next one on the cone to round-off, of the traction or of the way: it slips, so that the next step's first tangent lets
    # it go on.
    crumb = law.eps_t * law.touch
    sticks = size <= crumb or size <= limit * (1.0 - ON_CONE) - crumb
    if told == STICK or (told == FREE and sticks):
        return Traction(STICK, N, limit, slope, size, trial, trial, plus(times(N, n), trial))
    share = _strength(law, gaps, N, limit, slope) / size
    tangential = times(min(share, 1.0) if gaps.decides == gaps.press and told == FREE else share, trial)
    return Traction(SLIP, N, limit, slope, size, trial, tangential, plus(times(N, n), tangential))


@njit(cache=True, error_model="numpy")
def partials(law: Law, gaps: Gaps, n: Vector, w: Vector, found: Traction) -> Partials:
    """The Partials of T, found at the same arguments: (26), with (27) in stick and (28) in slip."""
    if found.status == OPEN:
        return Partials(ZERO, ZERO, (ZERO, ZERO, ZERO), (ZERO, ZERO, ZERO))
    rub, lost, t, pull = 0.0, 0.0, ZERO, ZERO
    if found.status == STICK:
        rub = law.eps_t
    elif found.status == SLIP:
        size, lost = found.size, found.slope  # -d|T_T|/dN
        t = times(1.0 / size, found.trial)
        pull = _size_rate(law.friction, t)
        rub = law.eps_t / size * _strength(law, gaps, found.N, found.limit, found.slope)
    push = less(n, lost, t)  # dT/dN
    n0, w0 = _rows(AXES[0], less(AXES[0], t[0], pull), rub, found.N, n, w)
    n1, w1 = _rows(AXES[1], less(AXES[1], t[1], pull), rub, found.N, n, w)
    n2, w2 = _rows(AXES[2], less(AXES[2], t[2], pull), rub, found.N, n, w)
    return Partials(times(law.eps_n, push), times(gaps.press, push), (n0, n1, n2), (w0, w1, w2))


@njit(cache=True)
def _size_rate(friction: Rubbing, t: Vector) -> Vector:
    """d|T_T|/dT_T of a traction of the direction t, which has the size 1."""
    if friction.ratio == 1.0:
        return t
    square = friction.ratio * friction.ratio
    return plus(times(square, t), times((1.0 - square) * dot(friction.along, t), friction.along))


@njit(cache=True, error_model="numpy")
def direction_rate(friction: Rubbing, t: Vector, length: float) -> tuple[Vector, Vector, Vector]:
    """dT_T/dd by rows of a friction traction t that slips, where the unit vector `along` is d of a length over it.

    t keeps its direction and its size |T_T|, of which the ellipse turns: d|T_T|/d(along) = (1 - ratio^2) (along.t) t/|T_T|.
    """
    part, size = dot(friction.along, t), strength_taken(friction, t)
    rate = times((friction.ratio * friction.ratio - 1.0) * part / (size * size * length), less(t, part, friction.along))
    return times(t[0], rate), times(t[1], rate), times(t[2], rate)


@njit(cache=True)
def _rows(e: Vector, left: Vector, rub: float, N: float, n: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Rows of dT/dn = N I - rub L (n w^T + (n.w) I) and dT/dw = rub L (I - n n^T) along the axis e; left: that of L.

    d(P w) = P dw - n (w.dn) - (n.w) dn, and L = I - t d|t|/dt is the return to the limit, t being of size 1.
    """
    across = dot(left, n)
    return less(less(times(N, e), rub * dot(n, w), left), rub * across, w), times(rub, less(left, across, n))

"""Friction as the user states it: Coulomb's coefficient, a number or one that depends on the pressure, with a shear limit or
with two directions."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fenics_contact.assembly.pose import Pose
from fenics_contact.kernels.law import SMOOTH, Friction, friction_limits
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, finite, function, is_number, positive, shown

__all__ = ["Friction", "allowed", "coulomb", "friction_of", "stated", "turned"]

POWER = 7  # of the polynomials that stand for a user's mu(p)
EXACT = 1e-10  # how near they come to it, of its greatest value: below what any run resolves
DECADES = 12  # below the largest pressure of its range: under less mu is that of the least
PIECES = 64  # at first: two an octave and a half, so that no bend of a law is passed over
NARROWEST = 1e-12  # of ln p: where a kink would long be met to EXACT, mu(p) jumps


def coulomb(
    mu: float | Callable[[float], float],
    *,
    exponent: float = 0.0,
    reference: float = 1.0,
    shear_limit: float | None = None,
    up_to: float | None = None,
    across: float | None = None,
    along: Sequence[float] | None = None,
) -> Friction:
    """`|T_T| <= mu(p) p` with mu(p) = mu (p/reference)^exponent, and `|T_T| <= shear_limit` [pressure] where one is given.

    mu: a number, or a function mu(p) of one pressure: it is asked once, here, and met to 1e-10 by polynomials in ln p, of
    which the tangent is exact; exponent: 0 for Coulomb's constant mu; -1/3 for smooth rubber, whose true area of contact
    grows as p^(2/3) (Hertz); above -1, so that more pressure allows more friction; reference: the pressure at which
    mu(p) = mu [pressure]; shear_limit: of the friction traction [pressure]; up_to: largest pressure that a function mu(p)
    holds for [pressure]; a state under more is refused, and under less than 1e-12 of it mu is that of the least; across:
    the coefficient across the direction `along`, along which mu holds; along: direction (3,) on the master, a tool
    or an undeformed body, to which it is fixed: on a body that of its facets, with which it turns and shears. `|T_T|` lies
    on the ellipse of both and acts against the way slid: slip is not associated with the ellipse. SceneError for anything
    else.
    """
    law = SMOOTH
    if shear_limit is not None:
        law = law._replace(shear=float(positive(shear_limit, "friction: shear_limit", more=", a pressure")))
    if callable(mu):
        if exponent != 0.0 or across is not None or along is not None:
            raise SceneError("friction: a function mu(p) says all itself; it goes without exponent=, across= and along=")
        if up_to is None:
            raise SceneError("friction: a function mu(p) needs the largest pressure it holds for, coulomb(mu, up_to=...)")
        table = _table(function(mu, "friction", "mu(p)"), float(positive(up_to, "friction: up_to", more=", a pressure")))
        return law._replace(mu=_greatest(table), table=table)
    if up_to is not None:
        raise SceneError("friction: up_to= is the range of a function mu(p); a number mu has none")
    if not (is_number(exponent) and np.isfinite(exponent) and exponent > -1.0):
        raise SceneError(f"friction: exponent = {shown(exponent)} must be greater than -1")
    reference = float(positive(reference, "friction: reference", more=", a pressure"))
    law = law._replace(mu=float(positive(mu, "friction", zero=True)), reference=reference, exponent=float(exponent))
    return law if across is None and along is None else _with_directions(law, across, along)


def _with_directions(law: Friction, across: float | None, along: Sequence[float] | None) -> Friction:
    if across is None or along is None:
        raise SceneError("friction: two directions need both across=, the second coefficient, and along=, where mu holds")
    if law.shear:
        raise SceneError("friction: shear_limit= is the same in all directions; it goes without across= and along=")
    first, second = positive(law.mu, "friction, with across=,"), positive(across, "friction: across")
    way = finite(along, "friction: along", (3,))
    largest = np.abs(way).max()
    if largest == 0.0:
        raise SceneError("friction: along has the length zero; give a direction")
    x, y, z = way / largest / np.linalg.norm(way / largest)  # its square may be beyond what a number holds
    return law._replace(ratio=float(first / second), along=(float(x), float(y), float(z)))


def _table(mu: Callable[[float], Any], up_to: float) -> Floats:
    """The table (m, POWER + 3) of kernels/law.py for mu(p) up to a pressure: pieces halved until they are exact."""
    nodes = np.cos(np.pi * np.arange(POWER, -1, -1) / POWER)
    between = np.append(0.5 * (nodes[1:] + nodes[:-1]), [-0.995, 0.995])
    powers = np.linalg.inv(np.vander(nodes))
    ends = np.log(up_to) - np.log(10.0) * DECADES * np.linspace(1.0, 0.0, PIECES + 1)
    left, done, greatest = list(zip(ends[:-1], ends[1:], strict=True))[::-1], [], 0.0
    while left:
        start, end = left.pop()
        middle, half = 0.5 * (start + end), 0.5 * (end - start)
        there = np.array([_asked(mu, min(np.exp(middle + half * s), up_to)) for s in (*nodes, *between)])
        greatest = max(greatest, there.max())
        parts = powers @ there[: POWER + 1]
        error = np.abs(np.vander(between, POWER + 1) @ parts - there[POWER + 1 :]).max()
        if error <= EXACT * greatest:
            done.append([start, end, *parts])
        elif half > NARROWEST:
            left += [(middle, end), (start, middle)]
        else:
            raise SceneError(f"friction: mu(p) jumps at p = {np.exp(middle):.6g}; give a continuous function")
    return np.array(done)


def _asked(mu: Callable[[float], Any], p: float) -> float:
    try:
        value = mu(float(p))
    except Exception as error:
        raise SceneError(f"friction: mu(p) fails at p = {p:.6g}: {type(error).__name__}: {error}") from error
    if not (is_number(value) and np.isfinite(value) and value >= 0.0):
        raise SceneError(f"friction: mu(p) = {shown(value)} at p = {p:.6g} must be zero or a positive number")
    return float(value)


def _greatest(table: Floats) -> float:
    """The greatest mu of a table, at the ends and in the middle of its pieces."""
    places = np.vander([-1.0, 0.0, 1.0], POWER + 1)
    return float(max((table[:, 2:] @ places.T).max(), 0.0))


def friction_of(value: object, what: str = "friction") -> Friction:
    """The Friction of a number, Coulomb's mu, or of what `coulomb` gives. SceneError for anything else."""
    if isinstance(value, Friction):
        return value
    more = ", Coulomb's mu, or coulomb(...)" + (" of this function, with up_to=" if callable(value) else "")
    return coulomb(positive(value, what, zero=True, more=more))


def stated(friction: Friction) -> float | dict[str, Any]:
    """Coulomb's mu, or the numbers of a friction law by name, a table as some of its pressures with their mu."""
    parts = friction._asdict()
    del parts["directions"]  # each contact's own
    if len(table := parts.pop("table")) == 0:
        return friction.mu if friction == coulomb(friction.mu) else parts
    mu = table[:, 2:] @ np.ones(POWER + 1)
    return {"shear": friction.shear, "pressures": np.exp(table[:, 1]).tolist(), "mu": mu.tolist()}


def turned(friction: Friction, pose: Pose | None) -> Friction:
    """The law on a tool in a pose: its direction has turned along. None: of no tool."""
    if pose is None or friction.ratio == 1.0:
        return friction
    x, y, z = pose.turn @ friction.along
    return friction._replace(along=(float(x), float(y), float(z)))


def allowed(friction: Friction, pressure: Floats, traction: Floats) -> tuple[Floats, Floats]:
    """Limits [pressure] of friction under pressures (...), and the shares (...) of them that the sizes of friction tractions
    (..., 3) may have in their directions: those of an ellipse where friction has two."""
    limits, shares = np.empty((2, pressure.size))
    friction_limits(friction, pressure.ravel(), np.ascontiguousarray(traction.reshape(-1, 3)), limits, shares)
    return limits.reshape(pressure.shape), shares.reshape(pressure.shape)

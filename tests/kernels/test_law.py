"""The law of one slave point alone: closed forms, exact partials in every status, Coulomb's cone, frame indifference."""

import numpy as np
import pytest

from fenics_contact import coulomb
from fenics_contact.kernels.law import Gaps, Law, Partials, friction_limit, partials, rubbing, traction
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK

pytestmark = pytest.mark.serial

EPS_N, EPS_T = 50.0, 20.0
NORMAL = np.array([2.0, -3.0, 6.0]) / 7.0
WAY = np.array([0.3, 0.5, 0.4])  # leans out of the plane across NORMAL, as the way to a foot on a curved master does
SMOOTH, SOME, MUCH = coulomb(0.0), coulomb(0.3), coulomb(9.0)
FALLING, CAPPED = (coulomb(0.3, exponent=-1 / 3, reference=0.5, shear_limit=cap) for cap in (0.8, 0.5))
BENT = coulomb(lambda p: 0.1 + 0.2 / (1.0 + p / 4.0), up_to=50.0)
GROOVED = coulomb(0.3, across=0.6, along=(1.0, 2.0, 0.5))  # neither along the plane across NORMAL nor across it
# status, friction, press, decides: the pressures are 5 but where they are foreseen to be 2, the trial traction is 13, and
# a falling mu allows 0.696 of a pressure of 5
POINTS = {
    "open": (OPEN, SOME, 0.1, 0.1),
    "closed": (CLOSED, SMOOTH, -0.1, -0.1),
    "stick": (STICK, MUCH, -0.1, -0.1),
    "slip": (SLIP, SOME, -0.1, -0.1),
    "slip, mu falls": (SLIP, FALLING, -0.1, -0.1),
    "slip, shear limit": (SLIP, CAPPED, -0.1, -0.1),
    "slip, mu(p)": (SLIP, BENT, -0.1, -0.1),
    "slip, two directions": (SLIP, GROOVED, -0.1, -0.1),
    "stick, two directions": (STICK, coulomb(9.0, across=5.0, along=(1.0, 2.0, 0.5)), -0.1, -0.1),
    "closed, foreseen": (CLOSED, SMOOTH, 0.02, -0.04),
    "stick, foreseen": (STICK, MUCH, 0.02, -0.04),
    "slip, foreseen": (SLIP, SOME, -0.1, -0.04),
    "slip, foreseen and open": (SLIP, SOME, 0.02, -0.04),
    "slip, mu falls, foreseen": (SLIP, FALLING, -0.1, -0.04),
    "slip, mu(p), foreseen": (SLIP, BENT, -0.1, -0.04),
    "slip, two directions, foreseen": (SLIP, GROOVED, -0.1, -0.04),
    "open, foreseen": (OPEN, SOME, -0.1, 0.04),
}


def test_a_law_says_whether_it_asks_for_a_pressure():
    assert all(law.asks_pressure for law in (FALLING, CAPPED, BENT))
    assert not any(law.asks_pressure for law in (SMOOTH, SOME, GROOVED))


def law_under(gaps, friction, eps_n=EPS_N, touch=0.0):
    """The law of a point that these gaps decide on."""
    return Law(eps_n, EPS_T, rubbing(friction, 0, -eps_n * gaps.decides), touch)


def at(name, press=None, n=NORMAL, w=WAY, eps_n=EPS_N, along=None):
    """(law, gaps, n, w) of a point; a press of its own decides with it, unless another pressure was foreseen."""
    _, friction, own, decides = POINTS[name]
    friction = friction if along is None else friction._replace(along=tuple(map(float, along)))
    press = own if press is None else press
    decides = press if own == decides else decides * EPS_N / eps_n
    gaps = Gaps(press, decides)
    return law_under(gaps, friction, eps_n), gaps, tuple(map(float, n)), tuple(map(float, w))


def numbers(point):
    found = traction(*point)
    return found, Partials(*(np.array(part) for part in partials(*point, found)))


@pytest.mark.parametrize("name", POINTS)
def test_partials_are_the_derivatives(name):
    """Against central differences of fourth order: remainder h^4/30 times fifth derivatives of at most 2e5, that of a power
    of a gap of 0.1, and rounding 1e-15/h."""
    status, _, press, _ = POINTS[name]
    found, by = numbers(at(name))
    assert found.status == status
    h = 3e-4

    def rate(point_moved_by):
        T = []
        for s in (h, -h, 2 * h, -2 * h):
            moved = traction(*point_moved_by(s))
            assert moved.status == status
            T.append(np.array(moved.T))
        return (8 * (T[0] - T[1]) - (T[2] - T[3])) / (12 * h)

    bound = 1e-10
    assert np.abs(rate(lambda s: at(name, press=press + s)) - by.g).max() < bound
    assert np.abs(rate(lambda s: at(name, eps_n=EPS_N + s)) - by.eps_n).max() < bound
    for c, axis in enumerate(np.eye(3)):
        assert np.abs(rate(lambda s, axis=axis: at(name, n=NORMAL + s * axis)) - by.n[:, c]).max() < bound
        assert np.abs(rate(lambda s, axis=axis: at(name, w=WAY + s * axis)) - by.w[:, c]).max() < bound
    assert (status == OPEN) == (not any(np.any(part) for part in by))
    assert (status >= STICK) == bool(by.w.any())


@pytest.mark.parametrize("name", POINTS)
def test_partials_in_closed_form(name):
    """(26)-(28) by matrices: a point stuck to its anchor, and one that slips under mu |N|, |N| linear if foreseen."""
    status, friction, press, decides = POINTS[name]
    _, by = numbers(at(name))
    if status == OPEN:
        return
    one, along = np.eye(3), NORMAL @ WAY
    across, pressure = one - np.outer(NORMAL, NORMAL), -EPS_N * press
    strength, mu = friction.mu * pressure, friction.mu
    if friction in (FALLING, CAPPED):  # mu(p) p = 0.3 (0.5 p^2)^(1/3), foreseen along its tangent
        known = -EPS_N * decides
        strength = 0.3 * (0.5 * known**2) ** (1 / 3)
        mu = 2 / 3 * strength / known
        strength, mu = (strength + mu * (pressure - known), mu) if friction == FALLING else (0.5, 0.0)
    if friction is BENT:
        known = -EPS_N * decides
        mu = 0.1 + 0.2 / (1.0 + known / 4.0) ** 2  # of mu(p) p
        strength = (0.1 + 0.2 / (1.0 + known / 4.0)) * known + mu * (pressure - known)
    direction = across @ WAY / np.linalg.norm(across @ WAY)
    ellipse = one
    if friction is GROOVED:  # sqrt(t_a^2 + t_b^2/4) of what is twice as great across
        groove = np.array(GROOVED.along)
        ellipse = np.outer(groove, groove) + 0.25 * (one - np.outer(groove, groove))
    direction = direction / np.sqrt(direction @ ellipse @ direction)
    slide = np.outer(direction, ellipse @ direction)
    spring = {CLOSED: 0.0, STICK: EPS_T, SLIP: strength * np.linalg.norm(direction) / np.linalg.norm(across @ WAY)}[status]
    turning = one - slide if status == SLIP else one
    pushed = NORMAL - mu * direction if status == SLIP else NORMAL
    # sums of a few rounded products of size 50
    atol = 1e-13 if friction is not BENT else 1e-7  # 1e-10 that polynomials are off, the slope of one over its width
    np.testing.assert_allclose(by.g, EPS_N * pushed, rtol=0, atol=atol)
    np.testing.assert_allclose(by.eps_n, press * pushed, rtol=0, atol=atol)
    np.testing.assert_allclose(by.w, spring * turning @ across, rtol=0, atol=atol)
    turn = -turning @ (np.outer(NORMAL, WAY) + along * one)
    np.testing.assert_allclose(by.n, -pressure * one + spring * turn, rtol=0, atol=atol)
    np.testing.assert_allclose(by.w @ NORMAL, 0.0, rtol=0, atol=1e-13)  # a way along the normal is none


UP = (0.0, 0.0, 1.0)


@pytest.mark.parametrize("angle", [0.0, 17.0, 90.0, 200.0])
def test_two_directions_allow_what_the_ellipse_does(angle):
    """mu_1 = 0.3 along (1, 2, 0) and mu_2 = 0.6 across: |T_T| = p / sqrt((cos/mu_1)^2 + (sin/mu_2)^2), against the slip."""
    turn, c, s = np.arctan2(2.0, 1.0) + np.radians(angle), np.cos(np.radians(angle)), np.sin(np.radians(angle))
    way = (float(np.cos(turn)), float(np.sin(turn)), 0.0)
    gaps = Gaps(-0.1, -0.1)
    found = traction(law_under(gaps, coulomb(0.3, across=0.6, along=(1.0, 2.0, 0.0))), gaps, UP, way)
    size = 5.0 / np.hypot(c / 0.3, s / 0.6)
    np.testing.assert_allclose(found.tangential, size * np.array(way), rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.size / found.limit, EPS_T / size, rtol=1e-14)


def octaves(count):
    rng = np.random.default_rng(7)
    return np.exp(rng.uniform(np.log(1e-9), np.log(50.0), count))


@pytest.mark.parametrize(
    "mu",
    [
        lambda p: 0.2 + 0.6 / (1.0 + (p / 2.0) ** 0.7),
        lambda p: 0.3 * (p / 2.0) ** (-1 / 3),
        lambda p: float(np.interp(p, [0.0, 1.0, 5.0, 50.0], [0.9, 0.7, 0.3, 0.2])),
        lambda p: 0.3,
        lambda p: 0.0,
    ],
    ids=["smooth", "power", "kinks", "constant", "none"],
)
def test_a_function_of_the_pressure_is_met(mu):
    """To 1e-10 of its greatest value, kinks included; an exact one lies between the slopes of two pressures near each."""
    friction, p = coulomb(mu, up_to=50.0), octaves(2000)
    found = [friction_limit(friction, x) for x in p]
    wanted = np.array([mu(x) for x in p])
    largest = max(mu(50.0e-12), mu(50.0))
    np.testing.assert_allclose(friction.mu, largest, rtol=1e-9)
    assert np.abs(np.array([limit for limit, _ in found]) / p - wanted).max() <= 1e-10 * largest
    h = 1e-5 * p  # of a fourth derivative h^4, and 1e-10/h of what the polynomials are off
    above, below = (np.array([friction_limit(friction, x)[0] for x in p + side * h]) for side in (1, -1))
    rate = (above - below) / (2 * h)
    assert np.quantile(np.abs(rate - np.array([slope for _, slope in found])), 0.99) <= 1e-8 * largest


@pytest.mark.parametrize(
    ("mu", "press", "decides", "way", "status", "pressure", "friction"),
    [
        (0.3, 0.1, 0.1, 2.0, OPEN, 0.0, 0.0),
        (0.0, -0.1, -0.1, 2.0, CLOSED, 5.0, 0.0),
        (0.3, -0.1, -0.1, 0.05, STICK, 5.0, 1.0),
        (0.3, -0.1, -0.1, -0.05, STICK, 5.0, -1.0),
        (0.3, -0.1, -0.1, 2.0, SLIP, 5.0, 1.5),
        (0.3, -0.1, -0.1, -2.0, SLIP, 5.0, -1.5),
        (0.3, -0.1, 0.1, 2.0, OPEN, 0.0, 0.0),  # another pressure was foreseen: it decides, the gap presses
        (0.3, 0.1, -0.1, 0.05, STICK, -5.0, 1.0),
        (0.3, -0.1, -0.2, 2.0, SLIP, 5.0, 1.5),
        (0.3, 0.1, -0.2, 2.0, SLIP, -5.0, -1.5),
    ],
)
def test_a_point_on_a_plane(mu, press, decides, way, status, pressure, friction):
    gaps = Gaps(press, decides)
    found = traction(law_under(gaps, coulomb(mu)), gaps, UP, (way, 0.0, 0.7))
    assert found.status == status
    np.testing.assert_allclose(found.T, (friction, 0.0, -pressure), rtol=4e-16, atol=0)
    assert found.T[2] == found.N and found.tangential == (found.T[0], 0.0, 0.0)
    if status >= STICK:
        np.testing.assert_allclose(found.size / found.limit, EPS_T * abs(way) / (-mu * EPS_N * decides), rtol=1e-15)


def test_round_off_decides_nothing():
    gaps = Gaps(1e-9, 1e-9)
    touching = law_under(gaps, SOME, touch=1e-8)
    # a gap of round-off is closed, and presses on nothing: a way beyond round-off slips freely
    for way, status in ((1e-9, STICK), (1e-3, SLIP)):
        found = traction(touching, gaps, UP, (way, 0.0, 0.0))
        by = partials(touching, gaps, UP, (way, 0.0, 0.0), found)
        assert (found.status, found.N) == (status, EPS_N * 1e-9) and by.g == (0.0, 0.0, EPS_N)
    assert found.tangential == (0.0, 0.0, 0.0)
    assert traction(touching, Gaps(2e-8, 2e-8), UP, (0.0, 0.0, 0.0)).status == OPEN
    # on the cone to round-off it slips, under the traction of its way
    gaps = Gaps(-0.1, -0.1)
    law = law_under(gaps, SOME)
    for share, status in ((1 - 1e-6, STICK), (1 - 1e-9, SLIP)):
        found = traction(law, gaps, UP, (share * 1.5 / EPS_T, 0.0, 0.0))
        assert found.status == status and abs(found.T[0] - share * 1.5) < 1e-15


def samples(count):
    rng = np.random.default_rng(3)
    for _ in range(count):
        n, w = rng.normal(size=3), rng.normal(size=3) * 10.0 ** rng.uniform(-3, 0)
        press = rng.uniform(-0.2, 0.05)
        eps_n, gaps = EPS_N * 10.0 ** rng.uniform(-1, 1), Gaps(press, press)
        friction = (SMOOTH, SOME, FALLING, CAPPED)[rng.integers(4)]
        yield friction, law_under(gaps, friction, eps_n), gaps, tuple(n / np.linalg.norm(n)), tuple(w)


def test_friction_stays_on_its_cone_and_dissipates():
    seen = set()
    for given, law, gaps, n, w in samples(400):
        found = traction(law, gaps, n, w)
        seen.add(found.status)
        T, trial, friction = (np.array(part) for part in (found.T, found.trial, found.tangential))
        assert found.N <= 0.0  # no adhesion
        most = given.mu * abs(found.N)
        if given.exponent != 0.0:
            most = min(most * (abs(found.N) / 0.5) ** (-1 / 3), given.shear) if found.N else 0.0
        assert np.linalg.norm(friction) <= most * (1 + 1e-15)  # rounding of a power, a root and a quotient
        # rounding of the way's part along n, times eps_t
        assert abs(friction @ n) < 1e-14 * EPS_T * max(np.linalg.norm(w), 1e-3)
        np.testing.assert_allclose(T - friction, found.N * np.array(n), rtol=0, atol=1e-14 * max(1.0, np.abs(T).max()))
        slip = (trial - friction) / law.eps_t  # the way that the anchor follows
        assert friction @ slip >= 0.0
        assert (found.status == SLIP) == bool(slip.any())
    assert seen == {OPEN, CLOSED, STICK, SLIP}


def test_the_law_does_not_know_the_frame():
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for name in POINTS:
        here, by = numbers(at(name))
        there, turned = numbers(at(name, n=Q @ NORMAL, w=Q @ WAY, along=Q @ POINTS[name][1].along))
        assert here.status == there.status
        # rounding of a rotated vector, times eps
        np.testing.assert_allclose(there.T, Q @ here.T, rtol=0, atol=1e-13)
        for part in ("g", "eps_n"):
            np.testing.assert_allclose(getattr(turned, part), Q @ getattr(by, part), rtol=0, atol=1e-13)
        for part in ("n", "w"):
            np.testing.assert_allclose(getattr(turned, part), Q @ getattr(by, part) @ Q.T, rtol=0, atol=1e-13)

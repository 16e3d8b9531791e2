"""Shape functions of quad4 and tri3 against their defining properties."""

import numpy as np
import pytest

from fenics_contact.kernels import facets

INSIDE = {3: [(0.2, 0.3), (0.0, 0.0), (0.5, 0.5)], 4: [(0.2, -0.7), (-1.0, 1.0), (0.0, 0.0)]}


def shapes(m, s, t):
    return tuple(np.array(f) for f in (facets.shape(m, s, t), facets.shape_gradient(m, s, t), facets.shape_mixed(m)))


@pytest.mark.parametrize("m", [3, 4])
def test_each_function_is_one_at_its_own_corner_and_zero_at_the_others(m):
    for i in range(m):
        N, _, _ = shapes(m, *facets.corner(m, i))
        assert np.array_equal(N, np.eye(4)[i])


@pytest.mark.parametrize("m", [3, 4])
def test_functions_sum_to_one_and_derivatives_to_zero(m):
    for s, t in INSIDE[m]:
        N, dN, d2N = shapes(m, s, t)
        # sums of four terms of size one: a few roundings
        assert abs(N.sum() - 1.0) < 1e-15
        assert np.abs(dN.sum(axis=1)).max() < 1e-15
        assert d2N.sum() == 0.0


@pytest.mark.parametrize("m", [3, 4])
def test_derivatives_are_central_differences(m):
    h = 0.125  # a power of two: the functions are at most bilinear, so central differences are exact up to rounding
    for s, t in INSIDE[m]:
        _, dN, d2N = shapes(m, s, t)
        plus, minus = shapes(m, s + h, t), shapes(m, s - h, t)
        assert np.allclose(dN[0], (plus[0] - minus[0]) / (2 * h), atol=1e-15, rtol=0)
        assert np.allclose(d2N, (plus[1][1] - minus[1][1]) / (2 * h), atol=1e-15, rtol=0)
        plus, minus = shapes(m, s, t + h), shapes(m, s, t - h)
        assert np.allclose(dN[1], (plus[0] - minus[0]) / (2 * h), atol=1e-15, rtol=0)


@pytest.mark.parametrize("m", [3, 4])
def test_patch_is_the_interpolation_and_its_normal_the_cross_product(m):
    xf = np.random.default_rng(m).normal(size=(4, 3))
    c, n = np.empty((4, 3)), np.empty(3)
    facets.patch(m, xf, c)
    for s, t in INSIDE[m]:
        N, dN, _ = shapes(m, s, t)
        assert np.allclose(c[0] + c[1] * s + c[2] * t + c[3] * s * t, N[:m] @ xf[:m], atol=1e-14)  # rounding only
        r1, r2 = dN[:, :m] @ xf[:m]
        length = facets.patch_normal(c, s, t, n)
        assert np.allclose(n * length, np.cross(r1, r2), atol=1e-13)
        assert abs(np.linalg.norm(n) - 1.0) < 1e-15


@pytest.mark.parametrize("m", [3, 4])
def test_counter_clockwise_corners_look_outward(m):
    xf = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    c, n = np.empty((4, 3)), np.empty(3)
    facets.patch(m, xf, c)
    facets.patch_normal(c, 0.1, 0.2, n)
    assert np.array_equal(n, [0.0, 0.0, 1.0])


def test_a_facet_without_area_has_a_zero_normal():
    c, n = np.empty((4, 3)), np.full(3, np.nan)
    facets.patch(4, np.zeros((4, 3)), c)
    assert facets.patch_normal(c, 0.0, 0.0, n) == 0.0
    assert np.array_equal(n, np.zeros(3))


@pytest.mark.parametrize("m", [3, 4])
def test_compiled_equals_plain_python(m):
    xf = np.random.default_rng(7).normal(size=(4, 3))
    for s, t in INSIDE[m]:
        for function in (facets.shape, facets.shape_gradient):
            assert function(m, s, t) == function.py_func(m, s, t)  # same operations in the same order, no fastmath
        a, b, na, nb = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(3), np.zeros(3)
        facets.patch(m, xf, a)
        facets.patch.py_func(m, xf, b)
        facets.patch_normal(a, s, t, na)
        facets.patch_normal.py_func(b, s, t, nb)
        assert np.array_equal(a, b) and np.allclose(na, nb, atol=1e-15, rtol=0)

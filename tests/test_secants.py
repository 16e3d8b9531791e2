"""Solves with one factorisation that learn from one another."""

from types import SimpleNamespace

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact.solvers.secants import Secants

pytestmark = pytest.mark.serial
RNG = np.random.default_rng(7)
N = 12
A, TANGENT = np.diag(np.linspace(2.0, 6.0, N)) + 0.3 * RNG.normal(size=(N, N)), np.diag(np.full(N, 4.0))


def residual(x):
    return A @ x + 0.1 * x**3 - 1.0


def vector(values):
    return PETSc.Vec().createWithArray(np.array(values), comm=PETSc.COMM_SELF)


def secants(held=()):
    def put_forces(values, value):
        values[list(held)] = value

    return Secants(SimpleNamespace(supports=SimpleNamespace(put_forces=put_forces)))


def solved(x):
    """What a solve with the tangent at hand gives at x."""
    return vector(np.linalg.solve(TANGENT, -residual(x))), np.zeros((1, 6))


def test_they_are_broyden_s_updates_of_the_tangent():
    """The increments of the dense B+ = B + (y - B s) s' / s's, which they never make."""
    learnt, x, B = secants(), np.zeros(N), TANGENT.copy()
    for k in range(8):
        du, dq = solved(x)
        if k:
            learnt.improve(du, dq)
        else:
            learnt.begin(du, dq)
        s = np.linalg.solve(B, -residual(x))
        np.testing.assert_allclose(du.array, s, rtol=1e-9, atol=1e-14)
        B += np.outer(residual(x + s) - residual(x) - B @ s, s) / (s @ s)
        x = x + s


def steps_to(tolerance, learnt):
    x, count = np.zeros(N), 0
    while np.linalg.norm(residual(x)) > tolerance and count < 200:
        du, dq = solved(x)
        if learnt and count:
            learnt.improve(du, dq)
        elif learnt:
            learnt.begin(du, dq)
        x, count = x + du.array, count + 1
    return count


def test_they_save_solves():
    assert steps_to(1e-10, secants()) < steps_to(1e-10, None) < 200


def test_what_supports_move_by_is_no_part_of_what_is_learnt():
    """An increment that is all of a support's teaches nothing, a tool goes along with the bodies, and a solve that repeats
    the last one is not lengthened without an end."""
    learnt = secants(held=[0])
    learnt.begin(vector(np.eye(N)[0]), np.ones((1, 6)))
    du, dq = vector(np.eye(N)[1]), np.full((1, 6), 2.0)
    learnt.improve(du, dq)
    np.testing.assert_array_equal(du.array, np.eye(N)[1])
    du, dq = vector(0.5 * np.eye(N)[1]), np.full((1, 6), 1.0)
    learnt.improve(du, dq)  # half of the last one is left to do: as much again
    np.testing.assert_allclose(du.array, np.eye(N)[1])
    np.testing.assert_allclose(dq, 2.0)
    du, dq = vector(np.eye(N)[1]), np.zeros((1, 6))
    learnt.improve(du, dq)
    np.testing.assert_array_equal(du.array, np.eye(N)[1])

"""What a tangent takes of the pressures that nodes begin with: no more than the last solve foresaw of all."""

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact.contact.node_laws import bending
from fenics_contact.types import Bools, Floats

AREA = np.array([1.0, 2.0, 1.0, 1.0])  # mm^2


def felt(foreseen: Floats, taken: Floats, pressed: Bools) -> Floats:
    """Forces (ns,) that bend with the surfaces [N]."""
    return bending(foreseen, taken, pressed, AREA, MPI.COMM_SELF) * np.maximum(taken, 0.0) * AREA


def test_what_goes_on_pressing_is_taken_as_foreseen() -> None:
    """Where nobody opens."""
    p = np.array([1.0, 2.0, 0.5, 3.0])
    assert felt(p, p, np.full(4, True)) == pytest.approx(p * AREA, rel=1e-15)


def test_what_pulled_is_taken_off_those_that_pressed_against_it() -> None:
    """Two nodes press with 5 and 3 N, two that open were to pull with 4 and 3.9 N: 0.1 N are left, in the same parts."""
    foreseen = np.array([5.0, -2.0, 3.0, -3.9])
    forces = felt(foreseen, foreseen, np.full(4, True))
    assert forces.sum() == pytest.approx(0.1, rel=1e-12)
    assert forces[0] / forces[2] == pytest.approx(5.0 / 3.0)
    # in all they were to pull
    assert felt(foreseen - 1.0, foreseen, np.full(4, True)) == pytest.approx(0.0)


def test_what_closes_presses_no_more_than_what_pressed() -> None:
    """It is pressed by no solve yet."""
    pressed = np.array([True, False, True, False])
    forces = felt(np.array([1e-5, 0.0, 2e-5, 0.0]), np.array([1e-5, 40.0, 2e-5, 1e-6]), pressed)
    assert forces == pytest.approx([1e-5, 4e-5, 2e-5, 1e-6])
    assert felt(np.zeros(4), np.full(4, 40.0), np.full(4, False)) == pytest.approx(0.0)  # at a first touch

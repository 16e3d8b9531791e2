"""The types of tuples are those that Numba finds, and found once."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, typeof

from fenics_contact.kernels import argument_types
from fenics_contact.kernels.law import SMOOTH, Friction


class Pair(NamedTuple):
    first: float
    second: np.ndarray


def frozen():
    array = np.zeros((2, 3))
    array.flags.writeable = False
    return array


ARRAYS = tuple(np.zeros(3) for _ in range(6))
FRICTION = SMOOTH._replace(mu=0.3, along=(1.0, 0.0, 0.0))
VALUES = {
    "arrays": ARRAYS,
    "integers first": (np.zeros(3, dtype=np.int64), *ARRAYS[1:]),
    "singles": tuple(array.astype(np.float32) for array in ARRAYS),
    "rows": (np.zeros((3, 4)), *ARRAYS[1:]),
    "columns": (np.zeros((3, 4)).T, *ARRAYS[1:]),
    "strided": (np.zeros((3, 4))[:, ::2], *ARRAYS[1:]),
    "read only": (frozen(), *ARRAYS[1:]),
    "numbers": (1, 2.0, True),
    "large number": (2**40, 2**63),
    "nested": (ARRAYS, (1.0, ARRAYS)),
    "named": (Pair(1.0, ARRAYS[0]), 2),
    "law": (ARRAYS[0], FRICTION, 1e-9),
    "numpy's numbers": (np.float64(1.0), np.int32(1), np.bool_(True)),
    "others": (None, 1j, "word"),
    "empty": (),
}


@pytest.mark.parametrize("name", VALUES)
def test_types_are_those_that_numba_finds(name):
    value = VALUES[name]
    one = tuple(typeof(part) for part in value)  # by Numba itself, but for tuples
    found = typeof(value)
    assert tuple(found) == one
    assert typeof(value) is found


def test_named_tuples_keep_their_names():
    assert typeof(FRICTION).instance_class is Friction and typeof((FRICTION, 1.0))[0] == typeof(FRICTION)
    assert typeof(Pair(1.0, ARRAYS[0])) != typeof((1.0, ARRAYS[0]))


def test_a_form_is_worked_out_once(monkeypatch):
    counted, numbas = [], argument_types._worked_out

    def worked_out(value, context):
        counted.append(value)
        return numbas(value, context)

    monkeypatch.setattr(argument_types, "_worked_out", worked_out)
    monkeypatch.setattr(argument_types, "_known", {})

    @njit
    def total(arrays, law):
        return arrays[0][0] + arrays[5][0] + law[0]

    for i in range(200):
        assert total(tuple(np.full(3, float(i)) for _ in range(6)), (1.0, FRICTION)) == 2.0 * i + 1.0
    assert 0 < len(counted) <= 4  # two forms, and the tuple within Friction

"""Numba's types of the tuples that kernels take, each found once.

Numba 0.56 forgets what it has found of a tuple with five arrays or more, or with a NamedTuple, and works out its type anew
in nearly every call.  Kernels take several such tuples: in scenes of 2 000 unknowns that was an eighth of the run's time.
"""

from typing import Any

import numpy as np
from numba.core.typing.typeof import Purpose
from numba.extending import typeof_impl

_worked_out = typeof_impl.dispatch(tuple)  # as Numba does it
_known: dict[object, Any] = {}


class _Unknown(Exception):
    """A value whose form does not tell its type."""


def _form(value: Any) -> object:
    """What the Numba type of an array, a number, or a tuple of these depends on."""
    kind = type(value)
    if kind is np.ndarray:
        return value.dtype, value.ndim, value.flags.num
    if isinstance(value, tuple):
        return kind, *map(_form, value)
    if kind is float or kind is bool or (kind is int and -(2**31) < value < 2**31):
        return kind
    raise _Unknown


@typeof_impl.register(tuple)
def typeof_tuple(value: tuple[Any, ...], context: Any) -> Any:
    """The type of a tuple that is an argument, by its form."""
    try:
        form = _form(value)
    except _Unknown:
        return _worked_out(value, context)
    if context.purpose is not Purpose.argument:
        return _worked_out(value, context)
    if form not in _known:
        _known[form] = _worked_out(value, context)
    return _known[form]

"""The user's functions, of the load parameter, points or the state: asked alike on all ranks, their answers checked."""

import numbers
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.agreement import agreed, alike
from fenics_contact.types import Floats, Ints64
from fenics_contact.values import SceneError, finite, function

FEW = 8  # nodes at which a function of points is sampled

# reached at t = 1, or a function of t
Drive = float | Sequence[float] | Floats | Callable[[float], Any]
Path = Callable[[float], Floats]


def ramp(comm: MPI.Comm, value: Drive, what: str, shape: tuple[int, ...] = (3,)) -> Path:
    """Value reached at t = 1, or a function of t, as a function of t, which all ranks call."""
    if callable(value):
        function(value, what, "value(t)")
        return lambda t: alike(
            comm, f"{what} at t = {t:g}", lambda: finite(value(t), f"{what} at t = {t:g}", shape), SceneError
        )
    end = finite(value, what, shape)
    return lambda t: t * end


def row_of(path: Path, i: int) -> Path:
    """Row i of a function of t."""
    return lambda t: path(t)[i]


def number_of(comm: MPI.Comm, what: str, function: Callable[[Any], float], state: object) -> float:
    """function(state) of the user's as one float, the same on all ranks. Collective."""
    return alike(comm, what, lambda: _number(function(state), what), SceneError)


def _number(value: object, what: str) -> float:
    if isinstance(value, numbers.Real) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return float(value)
    given = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else repr(value)
    raise SceneError(f"{what} gives {given}; it must give one number")


class AtPoints:
    """A user's function value(X, t) at the nodes of a surface: every rank calls it with all of them, in one order.

    So a rank that has none asks nothing impossible, and what the function makes of its points together, e.g. X.max(), is the
    same on any number of ranks. keys (n,): numbers of this rank's nodes that no partition changes; X (n, 3) [length].
    """

    def __init__(self, comm: MPI.Comm, what: str, value: Callable[[Floats, float], Any], keys: Ints64, X: Floats) -> None:
        self._comm, self._what, self._value = comm, what, value
        parts = comm.allgather((keys, X))
        known, first = np.unique(np.concatenate([part[0] for part in parts]), return_index=True)
        self._X = np.concatenate([part[1] for part in parts])[first]
        self._mine = np.searchsorted(known, keys)

    def everywhere(self, t: float) -> Floats:
        """Values (all nodes of the surface,) [length], the same on all ranks. Collective."""
        with agreed(self._comm, f"{self._what} at t = {t:g}", SceneError):
            values = np.asarray(self._value(self._X.copy(), t))
            values = np.full(len(self._X), values) if values.ndim == 0 else values
            if values.shape != (len(self._X),) or values.dtype.kind not in "iuf":
                raise SceneError(
                    f"{self._what}: its function gives {values.dtype} of shape {values.shape} for {len(self._X)} points X "
                    "(n, 3); it must give one number per point, or one for all"
                )
            if not np.all(np.isfinite(values)):
                raise SceneError(f"{self._what} is not finite at t = {t:g}; mend its function")
        return values

    def few(self, t: float) -> Floats:
        """Values at a few nodes, the same on any number of ranks, and their sum [length]. Collective."""
        values = self.everywhere(t)
        return np.append(values[:: max(len(values) // FEW, 1)], values.sum())

    def __call__(self, t: float) -> Floats:
        """Values (n,) [length] at this rank's nodes. Collective."""
        return self.everywhere(t)[self._mine]

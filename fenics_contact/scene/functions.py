"""The user's functions, of the load parameter, points or the state: asked alike on all ranks, their answers checked."""

import numbers

import numpy as np

from fenics_contact.agreement import agreed, alike
from fenics_contact.values import SceneError, finite, function

FEW = 8  # nodes at which a function of points is sampled


def ramp(comm, value, what, shape=(3,)):
    """Value reached at t = 1, or a function of t, as a function of t, which all ranks call."""
    if callable(value):
        function(value, what, "value(t)")
        return lambda t: alike(
            comm, f"{what} at t = {t:g}", lambda: finite(value(t), f"{what} at t = {t:g}", shape), SceneError
        )
    end = finite(value, what, shape)
    return lambda t: t * end


def number_of(comm, what, function, state):
    """function(state) of the user's as one float, the same on all ranks. Collective."""
    return alike(comm, what, lambda: _number(function(state), what), SceneError)


def _number(value, what):
    if isinstance(value, numbers.Real) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return float(value)
    given = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else repr(value)
    raise SceneError(f"{what} gives {given}; it must give one number")


class AtPoints:
    """A user's function value(X, t) at the nodes of a surface: every rank calls it with all of them, in one order.

    So a rank that has none asks nothing impossible, and what the function makes of its points together, e.g. X.max(), is the
    same on any number of ranks. keys (n,): numbers of this rank's nodes that no partition changes; X (n, 3) [length].
    """

    def __init__(self, comm, what, value, keys, X):
        self._comm, self._what, self._value = comm, what, value
        parts = comm.allgather((keys, X))
        known, first = np.unique(np.concatenate([part[0] for part in parts]), return_index=True)
        self._X = np.concatenate([part[1] for part in parts])[first]
        self._mine = np.searchsorted(known, keys)

    def everywhere(self, t):
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

    def few(self, t):
        """Values at a few nodes, the same on any number of ranks, and their sum [length]. Collective."""
        values = self.everywhere(t)
        return np.append(values[:: max(len(values) // FEW, 1)], values.sum())

    def __call__(self, t):
        """Values (n,) [length] at this rank's nodes. Collective."""
        return self.everywhere(t)[self._mine]

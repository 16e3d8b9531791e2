"""The user's functions, of the load parameter, points or the state: asked alike on all ranks, their answers checked."""

import inspect
import numbers
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self, cast

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.agreement import alike
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.types import Floats, Ints, Ints64, Space
from fenics_contact.values import SceneError, finite, function

FEW = 8  # nodes at which a function of points is sampled

# reached at t = 1, or a function of t
Drive = float | Sequence[float] | Floats | Callable[[float], Any]
Path = Callable[[float], Floats]
Place = Callable[[Floats, float], Any]  # a function value(X, t) of places (n, 3)
Places = tuple[Ints64, Floats]  # of nodes: keys (n,), numbers that no partition changes, and X (n, 3) [length]


@dataclass(frozen=True)
class Ramp:
    """What grows with t from zero to `end` at t = 1."""

    end: Floats

    def __call__(self, t: float) -> Floats:
        return t * self.end


class Spread(ABC):
    """A function of t whose value may differ from place to place."""

    @abstractmethod
    def __call__(self, t: float) -> Floats:
        """Value, or values (n, ...) at this rank's places. Collective."""

    @abstractmethod
    def everywhere(self, t: float) -> Floats:
        """Value, or values at all places, the same on all ranks. Collective."""

    @abstractmethod
    def few(self, t: float) -> Floats:
        """Value, or values at a few places, the same on any number of ranks, and their sum. Collective."""


def thinned(values: Floats) -> Floats:
    """A few of values (n, ...), and the sum of all."""
    return np.append(values[:: max(len(values) // FEW, 1)].ravel(), values.sum(axis=0))


def ramp(comm: MPI.Comm, value: Drive, what: str, shape: tuple[int, ...] = (3,)) -> Path:
    """Value reached at t = 1, or a function of t, as a function of t, which all ranks call."""
    if callable(value):
        if takes_place(value):
            raise SceneError(
                f"{what}: its function is one of places, value(X, t), but this is one value for the whole: give value(t), "
                "or state what differs from place to place by traction, pressure, body_force or prescribe"
            )
        function(value, what, "value(t)")
        return lambda t: alike(
            comm, f"{what} at t = {t:g}", lambda: finite(value(t), f"{what} at t = {t:g}", shape), SceneError
        )
    return Ramp(finite(value, what, shape))


def load_path(
    space: Space,
    parts: Ints | None,
    value: Drive | Place,
    what: str,
    shape: tuple[int, ...],
    dim: int | None = None,
) -> tuple[Callable[[float], Floats], Ints | None]:
    """path(t) of a load, and where its value is a function value(X, t) the local nodes (n,) that the path gives values at:
    all that the parts of any rank have, facets or what has the dimension `dim`, or without parts all. Collective."""
    if not callable(value) or not takes_place(value):
        return ramp(space.mesh.comm, cast(Drive, value), what, shape), None
    marks, X = compat.Function(space), space.tabulate_dof_coordinates()
    marks.x.array.reshape(-1, 3)[... if parts is None else compat.locate_blocks(space, parts, dim)] = 1.0
    compat.sum_to_owners(marks)
    compat.copy_to_ghosts(marks)
    nodes = np.flatnonzero(marks.x.array[::3]).astype(np.int32)
    return AtPoints(space.mesh.comm, what, cast(Place, value), (node_keys(space)[nodes], X[nodes]), shape), nodes


def takes_place(value: Callable[..., Any]) -> bool:
    """Whether a function is one of (X, t), and not of t alone."""
    try:
        signature = inspect.signature(value)
    except ValueError:  # one of C, which does not say
        return False
    known = [_binds(signature, count) for count in (1, 2)]
    return known == [False, True]


def _binds(signature: inspect.Signature, count: int) -> bool:
    try:
        signature.bind(*range(count))
    except TypeError:
        return False
    return True


def whole(path: Callable[[float], Floats], t: float) -> Floats:
    """A path's value, or its values at all nodes, the same on all ranks. Collective."""
    return path.everywhere(t) if isinstance(path, Spread) else path(t)


def sample(path: Callable[[float], Floats], t: float) -> Floats:
    """A path's value, or of values at nodes a few and their sum: the same on any number of ranks. Collective."""
    return path.few(t) if isinstance(path, Spread) else path(t)


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


class AtPoints(Spread):
    """A user's function value(X, t) at nodes: every rank calls it with all of them, in one order.

    So a rank that has none asks nothing impossible, and what the function makes of its points together, e.g. X.max(), is the
    same on any number of ranks. places: of this rank's nodes; wanted (m,): keys of the nodes, of any rank, whose values this
    one takes; by default its own.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        what: str,
        value: Callable[[Floats, float], Any],
        places: Places,
        shape: tuple[int, ...] = (),
        wanted: Ints64 | None = None,
    ) -> None:
        self._comm, self._what, self._value, self._shape = comm, what, value, shape
        self._checked: Callable[[Floats, float], Floats] | None = None
        parts = comm.allgather(places)
        known, first = np.unique(np.concatenate([part[0] for part in parts]), return_index=True)
        self._X = np.concatenate([part[1] for part in parts])[first]
        self.count = len(known)
        self.mine = np.searchsorted(known, places[0] if wanted is None else wanted)  # which of all places are this rank's

    def under(self, checked: Callable[[Floats, float], Floats]) -> Self:
        """The same function whose values at t go through checked(values, t), which may refuse them."""
        self._checked = checked
        return self

    def everywhere(self, t: float) -> Floats:
        """Values (all places, ...) of the shape asked for."""
        return alike(self._comm, f"{self._what} at t = {t:g}", lambda: self._asked(t), SceneError)

    def _asked(self, t: float) -> Floats:
        values, wanted = np.asarray(self._value(self._X.copy(), t)), (len(self._X), *self._shape)
        values = np.broadcast_to(values, wanted).copy() if values.shape == self._shape else values
        if values.shape != wanted or values.dtype.kind not in "iuf":
            one = f"one row of shape {self._shape}" if self._shape else "one number"
            raise SceneError(
                f"{self._what}: its function gives {values.dtype} of shape {values.shape} for {len(self._X)} points X "
                f"(n, 3); it must give {one} per point, or one for all"
            )
        if not np.all(np.isfinite(values)):
            raise SceneError(f"{self._what} is not finite at t = {t:g}; mend its function")
        return values if self._checked is None else self._checked(values, t)

    def few(self, t: float) -> Floats:
        return thinned(self.everywhere(t))

    def __call__(self, t: float) -> Floats:
        return self.everywhere(t)[self.mine]

"""What the values of a statement must be: numbers, counts, vectors, names, functions; else a SceneError that names them."""

import inspect
import math
import re
from collections.abc import Callable
from numbers import Real
from typing import Any, TypeGuard, TypeVar

import numpy as np

from fenics_contact.types import Floats

LONGEST = 80  # characters of a wrong value that an error shows

F = TypeVar("F", bound=Callable[..., Any])


class SceneError(ValueError):
    """The scene cannot be computed as stated; the message names the thing and the remedy. Raised on all ranks."""


class FolderError(ValueError):
    """A file of the output folder cannot be written, or must not be; raised on all ranks."""


def shown(value: object) -> str:
    """A value as an error shows it: short, and without addresses, which differ from rank to rank."""
    words = re.sub(" at 0x[0-9a-f]+", "", repr(value))
    if len(words) > LONGEST and isinstance(value, np.ndarray) and value.ndim:
        return f"array of shape {value.shape}, from {shown(value[0].tolist())} to {shown(value[-1].tolist())}"
    return words if len(words) <= LONGEST else f"{words[:LONGEST]}..."


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a real number: no text, no truth value, no array but of no dimension."""
    if isinstance(value, np.ndarray):
        return value.ndim == 0 and value.dtype.kind in "iuf"
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def positive(value: object, what: str, zero: bool = False, most: float = math.inf, more: str = "") -> float:
    """The number itself, finite, above zero (or zero where that is allowed) and up to `most`."""
    if is_number(value) and math.isfinite(value) and (value > 0.0 or (zero and value == 0.0)) and value <= most:
        return value
    wanted = "zero or a positive number" if zero else "a positive number"
    wanted += f" up to {most:g}" if math.isfinite(most) else ""
    raise SceneError(f"{what} = {shown(value)} must be {wanted}{more}")


def count(value: object, what: str, least: int = 1, remedy: str = "") -> int:
    """The value as an int, where it is a whole number of at least `least`."""
    if not (is_number(value) and math.isfinite(value) and value == int(value) and value >= least):
        raise SceneError(f"{what} = {shown(value)} must be a whole number of at least {least}{remedy}")
    return int(value)


def finite(value: object, what: str, shape: tuple[int, ...] = ()) -> Floats:
    """The value as an array of finite numbers: one, with shape (), or as many as shape (n,) says."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.empty(0, dtype=object)
    if array.shape != shape or (array.size and array.dtype.kind not in "iuf") or not np.all(np.isfinite(array)):
        wanted = {(): "one finite number", (3,): "three finite numbers"}.get(shape, "finite numbers")
        raise SceneError(f"{what} must be {wanted}, not {shown(value)}")
    return array.astype(float)


def function(value: F, what: str, form: str) -> F:
    """The value itself, a function that can be called as `form` says, e.g. "value(X, t)"."""
    if not callable(value):
        raise SceneError(f"{what} must be a function {form}, not {shown(value)}")
    try:
        signature = inspect.signature(value)
    except ValueError:  # one of C, which does not say
        return value
    try:
        signature.bind(*form[form.index("(") + 1 : -1].split(", "))
    except TypeError:
        raise SceneError(f"{what}: its function takes {signature}, but is called as {form}") from None
    return value


def flag(value: object, what: str) -> bool:
    """The value, which is True or False, or SceneError."""
    if not isinstance(value, bool | np.bool_):
        raise SceneError(f"{what} = {shown(value)}: give True or False")
    return bool(value)


def text(value: object, what: str) -> str:
    """The value itself, a text that is not empty."""
    if not isinstance(value, str) or not value:
        raise SceneError(f"{what} = {shown(value)} must be a name, as text")
    return value


def group_names(group: object, what: str = "surface") -> tuple[str, ...]:
    """Names of a group: a name, or several, each once."""
    several = (group,) if isinstance(group, str) else group
    if not isinstance(several, list | tuple) or not several or not all(isinstance(name, str) for name in several):
        raise SceneError(f"{what}: {shown(group)} is no name of a surface group, nor a tuple of such names")
    return tuple(dict.fromkeys(several))


def quoted(group: object) -> str:
    """A group as stated, a name or several, for a message."""
    return " and ".join(f"'{name}'" for name in (group if isinstance(group, list | tuple) else (group,)))


def axis_letters(letters: object, what: str, most: int = 3) -> str:
    """The value itself: one of x, y, z, or up to `most` of them."""
    if not isinstance(letters, str) or not 1 <= len(letters) <= most or set(letters) - set("xyz"):
        wanted = "one of x, y, z" if most == 1 else "x, y, z or several of these, as text"
        raise SceneError(f"{what}: axis {shown(letters)} is not {wanted}")
    return letters

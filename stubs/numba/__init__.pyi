# Numba has no types: a compiled function is called as the one it is made of.
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

def njit(**options: Any) -> Callable[[F], F]: ...

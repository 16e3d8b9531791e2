"""Compiled kernels come from Numba's cache without what only compiling needs.

Numba imports all that it can compile for, SciPy's linear algebra among it, before it loads the first kernel: 0.16 s of CPU
time. Before it compiles one it does so anyway.
"""

from typing import Any

from numba.core.caching import FunctionCache

_loaded = FunctionCache.load_overload  # as Numba does it
_OURS = __package__ + "."


def load_overload(cache: FunctionCache, signature: Any, context: Any) -> Any:
    """The compiled kernel for a signature, None where the cache has none."""
    if not cache._py_func.__module__.startswith(_OURS):
        return _loaded(cache, signature, context)
    with cache._guard_against_spurious_io_errors():
        return cache._load_overload(signature, context)


FunctionCache.load_overload = load_overload

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

class FunctionCache:
    _py_func: Callable[..., Any]
    load_overload: Any
    def _load_overload(self, sig: Any, target_context: Any) -> Any: ...
    def _guard_against_spurious_io_errors(self) -> AbstractContextManager[None]: ...

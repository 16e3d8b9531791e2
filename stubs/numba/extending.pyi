from functools import _SingleDispatchCallable
from typing import Any

typeof_impl: _SingleDispatchCallable[Any]

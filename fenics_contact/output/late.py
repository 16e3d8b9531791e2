"""Modules loaded when something of theirs is first used: Matplotlib takes a quarter of a second, and few runs draw."""

from importlib import import_module
from typing import Any


class Late:
    """Stands for a module by name."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(import_module(self._name), attribute)


matplotlib: Any = Late("matplotlib")
agg: Any = Late("matplotlib.backends.backend_agg")
animations: Any = Late("matplotlib.animation")
cm: Any = Late("matplotlib.cm")
collections: Any = Late("matplotlib.collections")
colors: Any = Late("matplotlib.colors")
figures: Any = Late("matplotlib.figure")
patches: Any = Late("matplotlib.patches")
paths: Any = Late("matplotlib.path")
tickers: Any = Late("matplotlib.ticker")

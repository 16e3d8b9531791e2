"""Seconds spent by stage, so that the stages and the rest add up to the wall time."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

STAGES = ("compile", "search", "projection", "contact kernel", "insertion", "bulk tangent", "residual", "factorisation",
          "solve", "output")  # fmt: skip


class Timers:
    """`with timers("stage"):` adds the wall time of the block, less that of stages inside it, to `seconds["stage"]`."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._start = time.perf_counter()
        self._inner: list[float] = []  # of every open stage: what stages inside it took

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        self._inner.append(0.0)
        try:
            yield
        finally:
            spent = time.perf_counter() - start
            self.seconds[stage] += spent - self._inner.pop()
            if self._inner:
                self._inner[-1] += spent

    def table(self) -> dict[str, float]:
        """Seconds of all stages since the timers were made; "other" is what no stage claims, "total" the sum."""
        total = time.perf_counter() - self._start
        stages = {stage: self.seconds[stage] for stage in STAGES} | self.seconds
        return {**stages, "other": total - sum(stages.values()), "total": total}

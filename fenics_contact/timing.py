"""Seconds spent by stage."""

import time
from collections import defaultdict
from contextlib import contextmanager


class Timers:
    """`with timers("stage"):` adds the wall time of the block to `seconds["stage"]`."""

    def __init__(self):
        self.seconds = defaultdict(float)

    @contextmanager
    def __call__(self, stage):
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start

"""How a worker is told to work for a timed slice: one JSON line in, one out. Plain Python."""

import json
import os
import sys
import time
from collections.abc import Iterator
from typing import Any


def pin(core: int) -> None:
    """Keep this process on one core; before jax or torch is imported and counts them."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})


def requests() -> Iterator[dict[str, Any]]:
    """What is asked for, until the asker goes away; sleeps in between."""
    for line in sys.stdin:
        yield json.loads(line)


def answer(**news: Any) -> None:
    print(json.dumps(news), flush=True)


class Watch:
    """Started when made. Beside the time it tells what the process had of its core."""

    def __init__(self):
        self.began, self.busy = time.perf_counter(), time.process_time()

    def answer(self, steps: int, **besides: float) -> None:
        seconds = time.perf_counter() - self.began
        answer(steps=steps, seconds=seconds, busy=time.process_time() - self.busy, **besides)

"""Flights in real time on machines that may be busy: if one stood still, they fly again."""

import threading
import time

import pytest

STILL = 0.03  # s for which a machine that flies in real time may not have stood still
TRIES = 3
LOOPS, SLOW = 1_000_000, 0.4  # of a plain loop: how many, and s that they may take, usually 0.04


class Stalls:
    """Measures for how long this machine stood still, at most. Use it with `with`."""

    def __enter__(self):
        self.longest = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()

    def _watch(self):
        before = time.monotonic()
        while not self._over.wait(0.01):
            now = time.monotonic()
            self.longest, before = max(self.longest, now - before - 0.01), now


def loops():
    """How long a plain loop takes, in seconds."""
    began = time.perf_counter()
    for _ in range(LOOPS):
        pass
    return time.perf_counter() - began


def in_real_time(fly, tmp_path):
    """Let it fly, in a folder of its own; again if it fails while the machine stands still."""
    if (took := loops()) > SLOW:
        pytest.skip(f"a plain loop takes {took:.2f} s here: this machine is too slow to fly")
    longest = 0.0
    for number in range(TRIES):
        with Stalls() as stalls:
            try:
                return fly(tmp_path / f"try-{number}")
            except AssertionError:
                longest = stalls.longest
                if longest < STILL:
                    raise
    return pytest.skip(f"this machine stands still for {longest:.2f} s: too busy to fly")

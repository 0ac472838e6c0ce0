"""Ctrl-C ends a command at once, also while it waits for something that was compiled."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from skydog.commands.flags import STOPPED


@contextmanager
def heard() -> Iterator[None]:
    """Whoever wants to end in another way, as a training does, sets a handler of its own."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Python calls a handler between two of its instructions, and compiled code may run for
    # minutes: a thread is woken at once.
    wakes, woken = os.pipe()
    os.set_blocking(woken, False)
    before = signal.signal(signal.SIGINT, _stop)
    others = signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
    listener = threading.Thread(target=_listen, args=(wakes,), name="Ctrl-C", daemon=True)
    listener.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(others)
        signal.signal(signal.SIGINT, before)
        os.close(woken)
        listener.join()
        os.close(wakes)


def _listen(wakes: int) -> None:
    while number := os.read(wakes, 1):
        if number[0] == signal.SIGINT and signal.getsignal(signal.SIGINT) is _stop:
            _stop()


def _stop(*_: object) -> None:
    # At once and without unwinding: files are written whole or not at all, and an exception
    # that is raised inside a callback of jax gets lost.
    show_cursor = "\x1b[?25h" if sys.stderr.isatty() else ""  # a progress bar hides it
    print(f"{show_cursor}\nskydog: stopped", file=sys.stderr, flush=True)
    os._exit(STOPPED)

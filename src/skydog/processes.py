"""Processes of our own: Ctrl-C, which a terminal sends to all of them, is the parent's to hear."""

import signal
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess

STOPS = (signal.SIGINT, signal.SIGTERM)


def start(process: BaseProcess) -> None:
    """Start a process that hears no signal to stop: its parent tells it, or is gone."""
    # It unblocks the signals when it starts, so it starts before they are blocked.
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)  # which a child inherits
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

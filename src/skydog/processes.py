"""Processes of our own: their signals, their cores, and what they set before they import jax."""

import os
import platform
import signal
import zlib
from collections.abc import Collection
from contextlib import suppress
from functools import cache
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path

STOPS = (signal.SIGINT, signal.SIGTERM)


def start(process: BaseProcess) -> None:
    """Start a process that hears no signal to stop: its parent tells it, or is gone.

    A terminal sends Ctrl-C to all processes: it is the parent's to hear.
    """
    # It unblocks the signals when it starts, so it starts before they are blocked.
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)  # which a child inherits
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def cores() -> set[int]:
    """The cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def pin(chosen: Collection[int]) -> None:
    """Run this thread, and those that it starts, on the chosen cores alone."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, chosen)


@cache
def one_thread() -> None:
    """Let XLA compute in one thread for good, on whatever core is free.

    It makes as many threads as there are cores, once, so it has to see one while it starts.
    """
    free = cores()
    pin({min(free)})
    import jax

    jax.devices()
    threads = Path("/proc/self/task")
    for thread in threads.iterdir() if threads.exists() else ():
        with suppress(OSError):  # it has ended
            os.sched_setaffinity(int(thread.name), free)


def settle() -> None:
    """Set what a process of ours computes with, before it imports jax."""
    _own_settings()
    _cache_compiled()


def _own_settings() -> None:
    """Let no setting that other programs want reach ours: the same command gives the same figures.

    Workers inherit them. What a user may want of a command stays: the platform, caches, logs.
    """
    stays = ("PLATFORM", "CACHE", "LOG_COMPILES", "DUMP", "VISIBLE_DEVICES")
    for name in [name for name in os.environ if name.startswith(("JAX_", "EQX_"))]:
        if not any(part in name for part in stays):
            del os.environ[name]


def _cache_compiled() -> None:
    """Let jax keep what it compiles, for the next call and for the workers of this one.

    In the user's own cache folder, which nobody else may write to, since what lies there is run;
    a folder for each kind of processor, since homes are shared between machines.
    """
    with suppress(OSError, RuntimeError):  # a home that cannot be written has no cache
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        cache = home / "skydog" / f"compiled-{_processor()}"
        cache.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
        # XLA warns, in pages, that its own tuning hints are no features of the processor. What
        # goes wrong in earnest is raised, too. 1 is what jax sets where nobody has.
        if os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1") == "1":
            os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"


def _processor() -> str:
    """A mark of what the processor can do."""
    text = Path("/proc/cpuinfo")
    lines = text.read_text().splitlines() if text.exists() else [platform.processor()]
    able = next((line for line in lines if line.startswith(("flags", "Features"))), lines[0])
    return f"{platform.machine()}-{zlib.crc32(able.encode()):08x}"

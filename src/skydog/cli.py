"""The command `skydog`: it gathers the commands, and owns signals and streams."""

import os
import platform
import signal
import sys
import zlib
from contextlib import suppress
from pathlib import Path

import tyro
from tyro.conf import OmitArgPrefixes

from skydog.commands.export import export
from skydog.commands.flags import STOPPED
from skydog.commands.herd import herd
from skydog.commands.lab import lab
from skydog.commands.presets import presets
from skydog.commands.replay import replay
from skydog.commands.reproduce import reproduce
from skydog.commands.test import test
from skydog.commands.train import train
from skydog.commands.twin import twin
from skydog.commands.watch import watch
from skydog.errors import Refusal

COMMANDS = (herd, train, test, twin, lab, reproduce, replay, watch, export, presets)
CONFIG = (OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)


def main() -> None:
    """Run the command line; a `Refusal` is one line and exit code 2."""
    _cache_compiled()
    # At once and without unwinding: files are written whole or not at all, and an exception
    # that is raised inside a callback of jax gets lost. Trainings listen for themselves.
    before = signal.signal(signal.SIGINT, _stop)
    app = tyro.extras.SubcommandApp()
    for command in COMMANDS:
        app.command(command)
    try:
        code = app.cli(
            prog="skydog",
            description="Aerial shepherding: one drone herds a swarm of ground robots.\n\n"
            "Example: skydog herd",
            config=CONFIG,
        )
    except Refusal as refusal:
        print(f"skydog: {refusal}", file=sys.stderr)
        code = 2
    finally:
        signal.signal(signal.SIGINT, before)
    sys.exit(code)


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


def _stop(*_: object) -> None:
    print("\nskydog: stopped", file=sys.stderr, flush=True)
    os._exit(STOPPED)


if __name__ == "__main__":
    main()

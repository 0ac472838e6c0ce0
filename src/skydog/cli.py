"""The command `skydog`: it gathers the commands, and owns signals and streams."""

import difflib
import errno
import os
import platform
import sys
import traceback
import zlib
from contextlib import suppress
from pathlib import Path

import tyro
from tyro.conf import OmitArgPrefixes

from skydog import __version__
from skydog.commands import interrupts, streams
from skydog.commands.bench import bench
from skydog.commands.compare import compare
from skydog.commands.export import export
from skydog.commands.fit import fit
from skydog.commands.flags import Misused
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

COMMANDS = (
    *(herd, train, test, compare, bench, twin, lab, reproduce),
    *(replay, watch, fit, export, presets),
)
REFUSED = 2
UNWRITTEN = (errno.ENOSPC, errno.EIO, errno.EBADF, errno.EFBIG)
CONFIG = (OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)


def main() -> None:
    """Run the command line; a `Refusal` is one line and exit code 2."""
    streams.own()
    _own_settings()
    _cache_compiled()
    with interrupts.heard():
        code = _run(sys.argv[1:])
    sys.exit(streams.finish(code))


def _run(arguments: list[str]) -> int:
    try:
        return _command(arguments)
    except (Refusal, Misused) as refusal:
        print(f"skydog: {refusal}", file=sys.stderr)
    except BrokenPipeError:
        return streams.broken()
    except Exception as problem:
        if isinstance(problem, OSError) and problem.filename is None and problem.errno in UNWRITTEN:
            return streams.failed(problem)
        platform = os.environ.get("JAX_PLATFORMS")
        if platform and any(
            "xla_bridge" in at.filename for at in traceback.extract_tb(problem.__traceback__)
        ):
            said = f"jax cannot compute on JAX_PLATFORMS={platform}"
            print(f"skydog: {said}; unset it, or try JAX_PLATFORMS=cpu", file=sys.stderr)
            return REFUSED
        if not isinstance(problem, MemoryError) and "RESOURCE_EXHAUSTED" not in str(problem):
            raise
        print(
            "skydog: out of memory; try fewer --cases, --sheep or --steps, or a larger --every",
            file=sys.stderr,
        )
    return REFUSED


def _command(arguments: list[str]) -> int:
    if arguments in (["--version"], ["-V"]):
        print(f"skydog {__version__}")
        return 0
    names = [command.__name__ for command in COMMANDS]
    if arguments and arguments[0] not in names and not arguments[0].startswith("-"):
        near = difflib.get_close_matches(arguments[0], names, 1)
        hint = f"did you mean skydog {near[0]}?" if near else f"choose from {', '.join(names)}"
        raise Refusal(f"no command is called {arguments[0]!r:.60}; {hint}")
    if arguments[:1] in (["test"], ["twin"]) and len(arguments) > 2:
        command, *names = arguments[:3]
        if not any(name.startswith("-") for name in names):
            raise Refusal(
                f"skydog {command} flies one shepherd, got {' and '.join(names)}; "
                f"to compare them: skydog compare {' '.join(names)}"
            )
    app = tyro.extras.SubcommandApp()
    for command in COMMANDS:
        app.command(command)
    try:
        code = app.cli(
            prog="skydog",
            description="Aerial shepherding: one drone herds a swarm of ground robots.\n\n"
            "Example: skydog herd",
            args=arguments,
            config=CONFIG,
        )
    except SystemExit as left:  # tyro has shown a help, or what it could not read
        return left.code if isinstance(left.code, int) else 0
    return code or 0


def _own_settings() -> None:
    """Let no setting that other programs want reach ours: the same command gives the same figures.

    Workers inherit them. What a user may want of a command stays: the platform, caches, logs.
    """
    stays = ("PLATFORM", "CACHE", "LOG_COMPILES", "DUMP", "VISIBLE_DEVICES")
    for name in [name for name in os.environ if name.startswith(("JAX_", "EQX_"))]:
        if not any(part in name for part in stays):
            del os.environ[name]
    os.environ["MPLBACKEND"] = "agg"


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


if __name__ == "__main__":
    main()

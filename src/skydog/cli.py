"""The command `skydog`: it gathers the commands, and owns signals and streams."""

import difflib
import errno
import os
import sys
import traceback

import tyro
from tyro.conf import OmitArgPrefixes

from skydog import __version__, processes
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
    processes.settle()
    os.environ["MPLBACKEND"] = "agg"
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


if __name__ == "__main__":
    main()

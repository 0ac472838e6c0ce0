"""`skydog replay`: show missions again, as a page, a GIF or an MP4."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from skydog import files
from skydog.commands import flags
from skydog.commands.flags import File
from skydog.errors import Refusal

if TYPE_CHECKING:
    from skydog.world.trace import Trace


def replay(
    traces: Positional[Annotated[tuple[flags.Trace, ...], arg(metavar="TRACE")]],
    out: File = Path("replay.html"),
) -> int:
    """Show missions again: an animated page for the browser, a GIF or an MP4.

    Example: skydog replay runs/herd/traces/H-DDPG-4x4.safetensors -o flock.mp4

    Args:
        traces: Traces of missions, which skydog herd and skydog test --out write; or flight logs,
            each by its folder or its .mcap file.
        out: The page (.html); or a film of the missions side by side (.gif or .mp4).
    """
    from skydog.commands import console
    from skydog.view import replay as view

    if not traces:
        raise Refusal("replay needs a trace; try skydog replay runs/herd/traces/*.safetensors")
    stems = [path.stem for path in traces]
    named = {path.stem if stems.count(path.stem) == 1 else str(path): path for path in traces}
    view.save(out, {name: _mission(path) for name, path in named.items()})
    console.print_path(out)
    return 0


def _mission(path: Path) -> "Trace":
    if files.is_folder(path) or path.suffix == ".mcap":
        from skydog.lab import flightlog

        return flightlog.load(path)[0]
    from skydog.world import trace

    return trace.load(path)[0]

"""A replay: missions to play, pause and scrub, in one page that needs nothing else."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from skydog import files
from skydog.errors import Refusal
from skydog.study import metrics
from skydog.study.report import document
from skydog.view.animation import gif, mp4
from skydog.view.figures import extent
from skydog.view.page import filled
from skydog.world import herding
from skydog.world.mission import Trace


def save(path: Path, traces: dict[str, Trace]) -> None:
    """Write the missions, by name, as a page (`.html`) or a film (`.gif`, `.mp4`).

    Raises `Refusal` for another suffix, and for an MP4 if PyAV is missing.
    """
    if path.suffix == ".html":
        files.write_text(path, page(traces))
    elif path.suffix == ".gif":
        files.write_bytes(path, gif(traces))
    elif path.suffix == ".mp4":
        files.write_bytes(path, mp4(traces))
    else:
        raise Refusal(
            f"no replay is written as {path.suffix!r}; "
            f"name {path.stem}.html, {path.stem}.gif or {path.stem}.mp4"
        )


def page(traces: dict[str, Trace]) -> str:
    """A self-contained HTML page that replays the missions; opens by a double click."""
    play = "<script>document.querySelector('.replay').start()</script>"
    return document("Herding replay", player(traces) + play)


def player(traces: dict[str, Trace]) -> str:
    """The replay as a fragment to put inside any page; takes its ink from the page's text."""
    missions = [_mission(name, trace) for name, trace in traces.items()]
    data = json.dumps(missions, allow_nan=False, separators=(",", ":"))
    # A name may hold `</script>`: JSON can spell it without a `<`.
    return filled("replay.html", missions=data.replace("<", "\\u003c"))


def _mission(name: str, trace: Trace) -> dict[str, Any]:
    """What the page draws: metres and seconds, up to the instant that accomplished it."""
    until = int(metrics.steps(trace)) + 1
    sheep, dogs, subgoal = (np.asarray(a)[:until] for a in (trace.sheep, trace.dogs, trace.subgoal))
    flights = np.linalg.norm(np.diff(dogs, axis=0, prepend=dogs[:1]), axis=-1).sum(axis=1)
    return {
        "name": name,
        "size": _rounded(trace.world.arena.size),
        "goal": _rounded(herding.goal(trace.world.arena)),
        "radius": _rounded(trace.world.arena.goal_radius),
        "sensing": _rounded(trace.world.flock.sensing),
        "gathered": _rounded(herding.gathered_radius(trace.world.flock, sheep.shape[1])),
        "extent": _rounded(extent(trace.world, trace.dogs, trace.subgoal)),
        "accomplished": bool(metrics.success(trace)),
        "time": _rounded(trace.time[:until]),
        "flown": _rounded(np.cumsum(flights)),
        "sheep": _rounded(sheep),
        "dogs": _rounded(dogs),
        "subgoal": _rounded(subgoal),
        "drives": np.asarray(trace.drives)[:until].tolist(),
    }


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, np.float64), 3).tolist()

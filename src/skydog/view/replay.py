"""A replay: missions to play, pause and scrub, in one page that needs nothing else."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from skydog import files
from skydog.errors import Refusal, one_line
from skydog.study.report import document
from skydog.view import ground
from skydog.view.animation import gif, mp4
from skydog.view.figures import extent
from skydog.view.ground import rounded
from skydog.view.page import filled, read
from skydog.world.trace import Poses, Trace, frames, how_it_ended, last_instant, step_numbers


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


def beside(traces: dict[str, Trace]) -> str:
    """The missions side by side and to one scale, as a fragment: they are played together."""
    missions = [_mission(name, trace) for name, trace in traces.items()]
    lowest, highest = zip(*(mission["extent"] for mission in missions), strict=True)
    extent = [min(lowest), max(highest)]
    players = "".join(_player([{**mission, "extent": extent}]) for mission in missions)
    return f'<div class="beside">{players}</div>'


def player(traces: dict[str, Trace]) -> str:
    """The replay as a fragment to put inside any page; takes its ink from the page's text."""
    return _player([_mission(name, trace) for name, trace in traces.items()])


def _player(missions: list[dict[str, Any]]) -> str:
    data = json.dumps(missions, allow_nan=False, separators=(",", ":"))
    # A name may hold `</script>`: JSON can spell it without a `<`.
    return filled("replay.html", missions=data.replace("<", "\\u003c"), strip=read("strip.js"))


def _mission(name: str, whole: Trace) -> dict[str, Any]:
    """What the page draws: metres and seconds, up to the instant that accomplished it."""
    # Metres flown at every instant, also where the sheep were not recorded.
    flown = np.linalg.norm(np.diff(whole.dogs, axis=0, prepend=whole.dogs[:1]), axis=-1)
    flown = np.cumsum(flown.sum(axis=1))
    trace = frames(whole)
    until = last_instant(trace) + 1
    recorded = slice(None) if whole.recorded is None else np.asarray(whole.recorded)
    limits = extent(trace.world, trace.dogs, trace.subgoal)
    sheep, dogs, subgoal = (np.asarray(a)[:until] for a in (trace.sheep, trace.dogs, trace.subgoal))
    return {
        "name": one_line(name),
        **ground.numbers(trace.world, sheep.shape[1], limits[1] - limits[0]),
        "extent": rounded(limits),
        "ending": how_it_ended(whole),
        "time": rounded(trace.time[:until]),
        "step": step_numbers(trace)[:until].tolist(),
        "flown": rounded(flown[recorded][:until]),
        "sheep": rounded(sheep),
        "dogs": rounded(dogs),
        "subgoal": rounded(subgoal),
        "drives": np.asarray(trace.drives)[:until].tolist(),
        "poses": None if trace.poses is None else _poses(trace.poses, until),
    }


def _poses(poses: Poses, until: int) -> dict[str, Any]:
    """How dogs and sheep stand: metres, degrees for the dogs, radians for the sheep's yaw."""
    roll, pitch, _ = np.moveaxis(np.degrees(poses.attitude[:until]), -1, 0)
    return {
        "altitude": rounded(poses.altitude[:until]),
        "setpoint": rounded(poses.setpoint[:until, :, 2]),
        "roll": rounded(roll, 1),
        "pitch": rounded(pitch, 1),
        "yaw": rounded(poses.yaw[:until]),
    }

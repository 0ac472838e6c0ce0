"""Missions in the twin as films: one camera sees the arena, another follows the first drone."""

import io
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from skydog import files
from skydog.errors import Refusal
from skydog.flight import profiles
from skydog.twin.stage import HEIGHT, WIDTH, Scenes, Stage
from skydog.view.animation import RATE, STANDS, Picture, encode
from skydog.world import trace as traces
from skydog.world.trace import Trace

LONGEST = 30.0  # s of film; a longer mission is shown faster than it was
SPEEDS = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 60, 100)


def save(
    path: Path,
    trace: Trace,
    profile: str = "tum-simulator",
    rovers: str = "kobuki",
    title: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write one mission that was flown in the twin as a film, H.264 that any browser plays.

    `profile` and `rovers` are what flew it, as `Twin` has them. The film shows 25 frames a second
    in real time, or so much faster that it lasts 30 s; its last frame stands 1.5 s more.
    `progress` is told the frames that are done, of how many. Raises `Refusal` for a mission
    without poses, for a path that is no MP4, and if PyAV or OpenGL is missing.
    """
    if path.suffix != ".mp4":
        raise Refusal(f"a film is written as MP4, got {path}; name {path.stem}.mp4")
    scenes, speed = scenes_of(trace)
    files.folder(path.parent)  # what cannot be written is refused before it is drawn
    with _stage(trace, scenes, speed, profile, rovers, title) as stage:
        content = encode(_pictures(stage, len(scenes.time), progress), WIDTH, HEIGHT)
    files.write_bytes(path, content)


def _pictures(
    stage: Stage, frames: int, progress: Callable[[int, int], None] | None
) -> Iterator[Picture]:
    """Each frame; the last one stands."""
    for frame in range(frames):
        picture = stage.draw(frame)
        yield from [picture] * (1 if frame < frames - 1 else 1 + STANDS)
        if progress is not None:
            progress(frame + 1, frames)


def still(
    trace: Trace,
    at: float,
    profile: str = "tum-simulator",
    rovers: str = "kobuki",
    title: str = "",
) -> bytes:
    """The frame of the film that is nearest to `at` seconds of the mission, as PNG."""
    scenes, speed = scenes_of(trace)
    frame = int(np.argmin(np.abs(scenes.time - at)))
    with _stage(trace, scenes, speed, profile, rovers, title) as stage:
        png = io.BytesIO()
        Image.fromarray(stage.draw(frame)).save(png, "PNG")
        return png.getvalue()


def scenes_of(trace: Trace) -> tuple[Scenes, int]:
    """What each frame shows, until the mission ended, and how many times real time that is.

    Raises `Refusal` for a mission without poses, and for a stack of missions.
    """
    if trace.poses is None:
        raise Refusal(
            "this mission was flown without physics and has no poses to film; fly it with "
            "skydog twin, or show it with skydog replay"
        )
    if np.ndim(trace.time) != 1:
        raise Refusal(f"a film shows one mission, got a stack of shape {trace.time.shape[:-1]}")
    trace = traces.frames(trace)
    poses: Any = trace.poses
    sheep = np.asarray(trace.sheep, float)
    dogs = np.concatenate([trace.dogs, poses.altitude[..., None]], axis=-1, dtype=float)
    end = min(traces.last_instant(trace), _last_move(sheep, dogs))
    known = np.asarray(trace.time, float)[: end + 1]
    whole = known[-1] - known[0]
    speed = next((fast for fast in SPEEDS if whole <= fast * LONGEST), math.ceil(whole / LONGEST))
    frames = math.ceil(round(whole * RATE / speed, 3))
    time = np.minimum(known[0] + np.arange(frames + 1) * speed / RATE, known[-1])
    # Times have single precision: without a little more a frame would show the instant before.
    before = np.searchsorted(known, time + 1e-6 * whole, "right") - 1
    after = np.minimum(before + 1, end)
    share = (time - known[before]) / np.maximum(known[after] - known[before], 1e-9)

    def between(values: np.ndarray) -> np.ndarray:
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return (1.0 - weight) * values[before] + weight * values[after]

    return Scenes(
        time=time,
        step=traces.step_numbers(trace)[before],
        dogs=between(dogs),
        attitude=between(np.unwrap(poses.attitude, axis=0)),
        sheep=between(sheep),
        yaw=between(np.unwrap(poses.yaw, axis=0)),
        subgoal=np.asarray(trace.subgoal)[before],
        drives=np.asarray(trace.drives)[before],
    ), speed


def _last_move(*bodies: np.ndarray) -> int:
    """The instant after which nobody moves: a mission that failed stands until it is over."""
    moves = np.any([np.any(np.diff(who, axis=0), axis=(1, 2)) for who in bodies], axis=0)
    return int(np.flatnonzero(moves).max(initial=-1)) + 1


def _stage(
    trace: Trace, scenes: Scenes, speed: int, profile: str, rovers: str, title: str
) -> Stage:
    pace = "real time" if speed == 1 else f"{speed} times real time"
    texts = title, pace, traces.how_it_ended(trace)
    return Stage(profiles.uav(profile), profiles.rover(rovers), trace.world, scenes, texts)

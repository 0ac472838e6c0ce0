"""A trace: what a mission recorded, and as a file."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from skydog import files, numerics
from skydog.arrays import load_arrays, save_arrays
from skydog.errors import Refusal
from skydog.world import serialise
from skydog.world.params import World

ENDINGS = (
    "accomplished",
    "out of time",
    "upset",  # a rover lies on its side or its back
    "UAV down",
    "left the cage",
    "stopped by the supervisor",
)
"""How a mission can end, as `Ending.how` numbers it."""

ACCOMPLISHED, OUT_OF_TIME, UPSET, DOWN, LEFT, STOPPED = range(6)

KIND = "trace"
LARGEST = 1 << 28  # bytes of a file
LONGEST = 2**31 - 1  # steps


class Poses(eqx.Module):
    """What is recorded of bodies with physics besides positions. Metres, radians, m/s, rad/s."""

    altitude: Float[Array, "*batch instants dogs"]
    attitude: Float[Array, "*batch instants dogs 3"]  # roll, pitch, yaw
    setpoint: Float[Array, "*batch instants dogs 3"]  # of the position
    yaw: Float[Array, "*batch instants sheep"]
    speed: Float[Array, "*batch instants sheep"]  # v as commanded
    turn_rate: Float[Array, "*batch instants sheep"]  # ω as commanded


class Ending(eqx.Module):
    """How a mission ended, and after how many steps it would have been out of time."""

    how: Int[Array, "*batch"]  # of `ENDINGS`
    steps: Int[Array, "*batch"]  # that it was given


class Trace(eqx.Module):
    """Everything a mission recorded, instant by instant; the last instant commands nothing.

    After the mission is accomplished the world stands still, so that missions of different
    lengths share one shape. Metres, seconds, m/s.

    Of a large flock the sheep may be recorded at some instants only: `recorded` numbers them,
    and `centre` is the flock's centre at every instant, so that no metric needs the others.
    """

    world: World
    time: Float[Array, "*batch instants"]
    sheep: Float[Array, "*batch recorded sheep 2"]
    dogs: Float[Array, "*batch instants dogs 2"]
    subgoal: Float[Array, "*batch instants dogs 2"]
    drives: Bool[Array, "*batch instants dogs"]  # the behaviour: driving, else collecting
    # What the shepherd asked for, within the limits of the dog.
    command: Float[Array, "*batch instants dogs 2"]
    accomplished: Bool[Array, "*batch instants"]
    ending: Ending | None = None  # None: accomplished, or out of time with the last instant
    poses: Poses | None = None  # of bodies with physics
    recorded: Int[Array, "*batch recorded"] | None = None  # None: every instant
    centre: Float[Array, "*batch instants 2"] | None = None


def frames(trace: Trace) -> Trace:
    """One mission, reduced to the instants at which its sheep were recorded: to be drawn."""
    if trace.recorded is None:
        return trace
    at = trace.recorded
    # The world stands still after the mission: nothing of it is lost to the last instant.
    parts = {name: getattr(trace, name)[at] for name in _EVERY_INSTANT}
    poses = None
    if trace.poses is not None:
        poses = Poses(**{f.name: getattr(trace.poses, f.name)[at] for f in fields(Poses)})
    return replace(trace, **parts, poses=poses, recorded=None, centre=None)


def beginning(trace: Trace, steps: int) -> Trace:
    """The first `steps` steps of one mission, or all if it has fewer: `frames` of them."""
    recorded = jnp.arange(len(trace.time)) if trace.recorded is None else trace.recorded
    recorded = recorded[recorded <= steps]
    return frames(replace(trace, recorded=recorded, sheep=trace.sheep[: len(recorded)]))


def how_it_ended(trace: Trace) -> str:
    """How one mission ended: one of `ENDINGS`."""
    if trace.ending is not None:
        return ENDINGS[int(trace.ending.how)]
    return ENDINGS[ACCOMPLISHED if np.any(trace.accomplished) else OUT_OF_TIME]


def step_numbers(trace: Trace) -> Int[np.ndarray, " instants"]:
    """The number of the step at each instant of one mission, also of its `frames`."""
    return np.rint(np.asarray(trace.time) / float(trace.world.arena.dt)).astype(int)


def last_instant(trace: Trace) -> int:
    """The instant at which one mission was accomplished, or else its last."""
    done = np.asarray(trace.accomplished)
    return int(np.argmax(done)) if done.any() else len(done) - 1


# The arrays of a trace and the shape of each: I instants, R of them with the sheep, N sheep,
# M dogs. What stands after a dot is a part that a trace may lack.
_SHAPES = {
    "time": "I",
    "sheep": "RN2",
    "dogs": "IM2",
    "subgoal": "IM2",
    "drives": "IM",
    "command": "IM2",
    "accomplished": "I",
    "recorded": "R",
    "centre": "I2",
    "poses.altitude": "IM",
    "poses.attitude": "IM3",
    "poses.setpoint": "IM3",
    "poses.yaw": "IN",
    "poses.speed": "IN",
    "poses.turn_rate": "IN",
}
_EVERY_INSTANT = ("time", "dogs", "subgoal", "drives", "command", "accomplished")
_REQUIRED = (*_EVERY_INSTANT, "sheep")
_THINNED = ("recorded", "centre")
_POSES = tuple(name for name in _SHAPES if name.startswith("poses."))
_KINDS = {"drives": np.bool_, "accomplished": np.bool_, "recorded": np.int32}  # else float32


@numerics.ours()
def save(path: Path, trace: Trace, shepherd: str) -> None:
    """Write one mission, up to the instant at which it was accomplished, and who flew it.

    Raises `Refusal` for a stack of missions: take one out of it first; and for a mission that
    is larger than `load` would read.
    """
    done = np.asarray(trace.accomplished)
    if done.ndim != 1:
        raise Refusal(f"a trace file holds one mission, got a stack of shape {done.shape}")
    until = last_instant(trace) + 1
    arrays = {name: array for name in _SHAPES if (array := _array(trace, name)) is not None}
    if trace.recorded is not None:
        # Whoever is done stands still: what was recorded later is as the last instant.
        recorded, kept = np.unique(np.minimum(arrays["recorded"], until - 1), return_index=True)
        arrays |= {"recorded": recorded.astype(np.int32), "sheep": arrays["sheep"][kept]}
    arrays = {
        name: array[:until] if _SHAPES[name][0] == "I" or trace.recorded is None else array
        for name, array in arrays.items()
    }
    size = sum(array.nbytes for array in arrays.values())
    if size > 0.9 * LARGEST:
        raise Refusal(
            f"a trace of {size:,} bytes is larger than a file may be ({LARGEST:,}); "
            "record fewer instants, with --every"
        )
    sheep = arrays["sheep"].shape[1]
    card: dict[str, Any] = {
        "kind": KIND,
        "shepherd": shepherd,
        "world": files.plain(serialise.flatten(trace.world, sheep)),
    }
    if trace.ending is not None:
        card["ending"] = ENDINGS[int(trace.ending.how)]
        card["steps"] = int(trace.ending.steps)
    save_arrays(path, arrays, card)


@numerics.ours()
def load(path: Path) -> tuple[Trace, str]:
    """Read one mission and who flew it. Raises `Refusal` for a file that is no trace."""
    arrays, card = load_arrays(path, KIND, LARGEST)
    parts: list[str] = [*_REQUIRED]
    for optional in (_THINNED, _POSES):
        parts += optional if any(name in arrays for name in optional) else ()
    thinned = "recorded" in parts
    sizes = {"2": 2, "3": 3}
    for name in parts:
        _check(path, name, arrays.get(name), sizes, _SHAPES[name] if thinned else _full(name))
    instants = sizes["I"]
    if thinned:
        at = arrays["recorded"]
        if at[0] != 0 or at[-1] >= instants or np.any(np.diff(at.astype(np.int64)) <= 0):
            raise Refusal(f"{path} is not a full trace: its sheep are recorded at no such instants")
    if not isinstance(card.get("world"), dict):
        raise Refusal(f"{path} is not a full trace: its card names no world")
    known = {name: jnp.asarray(arrays[name]) for name in parts}
    poses = {name.removeprefix("poses."): known.pop(name) for name in _POSES if name in known}
    trace = Trace(
        world=serialise.unflatten(card["world"]),
        **known,
        poses=Poses(**poses) if poses else None,
        ending=_ending(path, card, instants),
    )
    return trace, str(card.get("shepherd", "unknown"))


def _array(trace: Trace, name: str) -> np.ndarray | None:
    part: Any = trace
    for step in name.split("."):
        part = None if part is None else getattr(part, step)
    return None if part is None else np.asarray(part, _KINDS.get(name, np.float32))


def _full(name: str) -> str:
    return _SHAPES[name].replace("R", "I")


def _check(
    path: Path, name: str, found: np.ndarray | None, sizes: dict[str, int], shape: str
) -> None:
    if found is None or found.ndim != len(shape):
        raise Refusal(f"{path} is not a full trace: {name} is missing or misshapen")
    for letter, size in zip(shape, found.shape, strict=True):
        if size != sizes.setdefault(letter, size) or size == 0:
            raise Refusal(f"{path} is not a full trace: {name} has shape {found.shape}")
    if found.dtype != _KINDS.get(name, np.float32):
        raise Refusal(f"{path} is not a full trace: {name} holds {found.dtype}")
    if found.dtype == np.float32 and not np.all(np.abs(found) <= serialise.LARGEST):
        raise Refusal(f"{path} is not a full trace: {name} is out of bounds")


def _ending(path: Path, card: dict[str, Any], instants: int) -> Ending | None:
    """How the mission ended, if the file says so; older ones do not."""
    if "ending" not in card:
        return None
    how, steps = card["ending"], card.get("steps")
    if how not in ENDINGS or type(steps) is not int or not instants - 1 <= steps <= LONGEST:
        raise Refusal(f"{path} is not a full trace: it ended {how!r:.60} of {steps!r:.60} steps")
    return Ending(how=jnp.asarray(ENDINGS.index(how)), steps=jnp.asarray(steps))

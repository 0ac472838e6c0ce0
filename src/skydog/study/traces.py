"""A trace as a file, so that a mission can be shown and measured again."""

from dataclasses import fields
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from skydog import files
from skydog.errors import Refusal
from skydog.world import params
from skydog.world.mission import Trace

KIND = "trace"
LARGEST = 1 << 28  # bytes

# The shape of each array: I instants, N sheep, M dogs.
_SHAPES = {
    "time": "I",
    "sheep": "IN2",
    "dogs": "IM2",
    "subgoal": "IM2",
    "drives": "IM",
    "command": "IM2",
    "accomplished": "I",
}


def save(path: Path, trace: Trace, shepherd: str) -> None:
    """Write one mission, up to the instant at which it was accomplished, and who flew it.

    Raises `Refusal` for a stack of missions: take one out of it first.
    """
    done = np.asarray(trace.accomplished)
    if done.ndim != 1:
        raise Refusal(f"a trace file holds one mission, got a stack of shape {done.shape}")
    until = int(np.argmax(done)) + 1 if done.any() else len(done)
    arrays = {
        f.name: np.asarray(getattr(trace, f.name)) for f in fields(trace) if f.name in _SHAPES
    }
    card = {"kind": KIND, "shepherd": shepherd, "world": files.plain(params.flatten(trace.world))}
    files.save_arrays(path, {name: array[:until] for name, array in arrays.items()}, card)


def load(path: Path) -> tuple[Trace, str]:
    """Read one mission and who flew it. Raises `Refusal` for a file that is no trace."""
    arrays, card = files.load_arrays(path, KIND, LARGEST)
    sizes = {"2": 2}
    for name, shape in _SHAPES.items():
        found = arrays.get(name)
        if found is None or found.ndim != len(shape):
            raise Refusal(f"{path} is no whole trace: {name} is missing or misshapen")
        for letter, size in zip(shape, found.shape, strict=True):
            if size != sizes.setdefault(letter, size) or size == 0:
                raise Refusal(f"{path} is no whole trace: {name} has shape {found.shape}")
        flags = shape in ("I", "IM") and name != "time"
        if found.dtype != (np.bool_ if flags else np.float32):
            raise Refusal(f"{path} is no whole trace: {name} holds {found.dtype}")
        if not flags and not np.all(np.abs(found) <= params.LARGEST):
            raise Refusal(f"{path} is no whole trace: {name} is out of bounds")
    if not isinstance(card.get("world"), dict):
        raise Refusal(f"{path} is no whole trace: its card names no world")
    world = params.unflatten(card["world"])
    known = {name: jnp.asarray(arrays[name]) for name in _SHAPES}
    return Trace(world=world, **known), str(card.get("shepherd", "unknown"))

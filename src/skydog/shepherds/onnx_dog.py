"""An ONNX file that `skydog export` wrote, flown as a shepherd."""

import json
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from skydog import files
from skydog.errors import Refusal
from skydog.shepherds.foreign import Foreign
from skydog.world.params import World
from skydog.world.state import State

LARGEST = 1 << 26  # bytes


class OnnxDog(eqx.Module):
    """Flies as its file says, which holds the world that it was written for: one dog."""

    session: Foreign = eqx.field(static=True)

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        if len(state.dogs) != 1:
            raise Refusal(f"{self.session.called} flies one dog, not {len(state.dogs)}")
        if world.obstacles is not None:
            raise Refusal(
                f"{self.session.called} knows of no obstacles; fly the sheepdog that it was made of"
            )
        return self.session(state.dogs, state.sheep)


def read(path: Path) -> tuple[OnnxDog, dict[str, Any]]:
    """The shepherd of a file, and its card, which tells what arena and goal the file is for.

    Raises `Refusal` for a file that `skydog export` did not write.
    """
    content = files.read_bytes(path, "ONNX file", LARGEST)
    try:
        import onnxruntime
    except ImportError:
        raise Refusal(f"{path} needs onnxruntime; run: pip install 'skydog[onnx]'") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # so small a graph is slower on more
    try:
        session = onnxruntime.InferenceSession(content, options)
        told = session.get_modelmeta().custom_metadata_map
        card, world = json.loads(told["card"]), json.loads(told["world"])
        size = float(world["arena.size"])
        goal = [float(world["arena.goal_x"]), float(world["arena.goal_y"])]
        law = world["flock.law"]
    except Exception as problem:
        raise Refusal(
            f"{path} is no file of skydog export --onnx: {type(problem).__name__}; for another "
            "policy see skydog.from_policy"
        ) from problem

    def fly(dogs: np.ndarray, sheep: np.ndarray) -> np.ndarray:
        return np.asarray(session.run(["velocity"], {"sheep": sheep, "dog": dogs[:, 0]})[0])

    flies = {"goals": goal, "arenas": [size, size], "flock": law}
    card = {**card, "name": path.stem, "arena": size, "taught_for": flies}
    return OnnxDog(Foreign(fly, None, str(path))), card

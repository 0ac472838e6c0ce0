"""A sheepdog's skills with NumPy alone. Run: python examples/numpy_sheepdog.py [FILE]"""

import json
import sys
from pathlib import Path

import numpy as np

ZOO = Path(__file__).parents[1] / "src/skydog/shepherds/zoo"
STEPS = np.array([[-1, 0], [1, 0], [0, -1], [0, 1]], np.float32)  # what DHRL chooses among


def read(path):
    """The weights and biases in a sheepdog's file, by name, and its card."""
    raw = Path(path).read_bytes()
    start = 8 + int.from_bytes(raw[:8], "little")
    header = json.loads(raw[8:start])
    card = json.loads(header.pop("__metadata__")["skydog"])
    body = {name: raw[start:][slice(*told["data_offsets"])] for name, told in header.items()}
    return {n: np.frombuffer(body[n], "<f4").reshape(header[n]["shape"]) for n in body}, card


def act(weights, card, skill, observation, xi=1.0):
    """The velocity as a share of the speed limit, from what `card["observes"]` names (m)."""
    x, depth = xi * np.asarray(observation, np.float32), sum(skill in n for n in weights) // 2
    off = (x[..., :2] - x[..., 2:]) * (card.get("frame") == "folded")  # else no axis is turned
    sign, swap = np.where(off < 0, -1, 1), np.abs(off[..., 1:]) > np.abs(off[..., :1])
    x = x * np.concatenate([sign, sign], -1)
    x = np.where(swap, x[..., [1, 0, 3, 2]], x).astype(np.float32)
    for layer in range(depth):
        x = x if layer == 0 else np.maximum(x, 0)
        x = x @ weights[f"{skill}.{layer}.weight"].T + weights[f"{skill}.{layer}.bias"]
    x = STEPS[np.argmax(x, axis=-1)] if card["policy"] == "chooser" else np.tanh(x)
    x = np.where(swap, x[..., ::-1], x) * sign
    return x if card["policy"] == "chooser" or xi == 1.0 else np.tanh(x / xi)


def main(path=ZOO / "h-ddpg-4x4.safetensors"):
    """Ask both skills of a file what to do a metre behind the flock, at their subgoal."""
    weights, card = read(path)
    return {skill: act(weights, card, skill, [1, 0, 0, 0]) for skill in ("collect", "drive")}


if __name__ == "__main__":
    print(main(*map(Path, sys.argv[1:])))

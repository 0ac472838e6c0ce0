# pyright: reportMissingImports=false
"""What a policy of another library costs: `.venv-peers/bin/python benchmarks/foreign.py`.

The policy is an untrained PPO of Stable-Baselines3, 64-64. It never arrives, so that all steps are
flown. Beside it: the same missions with a dog that hovers, which is compiled.
"""

import statistics
import tempfile
import time
from pathlib import Path

import equinox as eqx
import gymnasium
import jax
import torch
from stable_baselines3 import PPO

import skydog
import skydog.envs
from skydog.study import evaluate
from skydog.study.cases import cases

REPEATS = 5


class Hover(eqx.Module):
    def __call__(self, world, state):
        return 0.0 * state.dogs


def seconds(world, shepherd, starts) -> float:
    """What all missions take, compiled before."""
    begun = time.perf_counter()
    jax.block_until_ready(evaluate.fly(world, shepherd, starts, 1000, None, None))
    return time.perf_counter() - begun


def main() -> None:
    torch.set_num_threads(1)
    world = skydog.preset("paper")
    env = gymnasium.make("skydog/Herd-v0", observation="full")
    with tempfile.TemporaryDirectory() as folder:
        PPO("MlpPolicy", env, seed=0, device="cpu").save(Path(folder) / "ppo")
        model = PPO.load(Path(folder) / "ppo", device="cpu")
    spent = 0.0

    def predict(seen):
        nonlocal spent
        begun = time.perf_counter()
        actions = model.predict(seen, deterministic=True)
        spent += time.perf_counter() - begun
        return actions

    policy, hover = skydog.from_policy(predict, observation="full"), Hover()
    print("| missions | all (s) | predict alone (s) | ratio | compiled dog (s) | first time (s) |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for count in (30, 1000):
        starts = cases(world, count)
        first = seconds(world, policy, starts)
        seconds(world, hover, starts)
        rows = []
        for _ in range(REPEATS):
            spent = 0.0
            whole = seconds(world, policy, starts)
            rows.append((whole, spent, whole / spent, seconds(world, hover, starts)))
        middle = [f"{statistics.median(column):.2f}" for column in zip(*rows, strict=True)]
        print(f"| {count:,} | {' | '.join(middle)} | {first:.1f} |")


if __name__ == "__main__":
    main()

# pyright: reportMissingImports=false
"""Train Stable-Baselines3's PPO, SAC and TD3 by their recipes, and judge them: docs/recipes.md.

    python benchmarks/recipes.py --out docs/recipes.md [--only ppo-herd] [--seeds 5 6 7]

Needs `pip install 'skydog[sb3]'`. A training has one thread. What it comes to is kept in `--runs`:
the policy as a zip, its progress, its figures. A training that is there is not done again.
"""

import argparse
import json
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import recipes_page

from skydog import files, from_policy, preset
from skydog.envs.vector import HerdingVectorEnv
from skydog.shepherds.options import ObservationKind
from skydog.study import cases, evaluate, statistics

JUDGED = (5, 6, 7)  # seeds of trainings; the recipes were tuned with 0 to 4
ON_THE_WAY, AT_THE_END = 1_000_003, 2_000_003  # seeds of starts: of 200, and of 1,000


@dataclass(frozen=True)
class Recipe:
    """How an algorithm is trained on a task."""

    algorithm: str
    task: str
    worlds: int
    steps: int
    every: int  # steps between evaluations
    numbers: dict[str, Any]
    noise: float | None = None  # SD of the noise on TD3's actions, in shares of the speed limit
    net: tuple[int, ...] = field(default=(64, 64))

    @property
    def name(self) -> str:
        return f"{self.algorithm.lower()}-{self.task}"

    def code(self, seed: int) -> str:
        """The program that makes the model: what the page prints is what was run."""
        lines = [
            f"from stable_baselines3 import {self.algorithm}",
            "from skydog.envs.sb3 import HerdingVecEnv, Metres",
            "",
            f'worlds = HerdingVecEnv({self.worlds}, "{self.task}", observation="full")',
        ]
        numbers = {name: json.dumps(value) for name, value in self.numbers.items()}
        if self.noise is not None:
            lines.insert(1, "from stable_baselines3.common.noise import NormalActionNoise")
            numbers["action_noise"] = f"NormalActionNoise([0.0, 0.0], {[self.noise] * 2})"
        numbers["seed"] = str(seed)
        policy = f'{{"net_arch": {list(self.net)}, "features_extractor_class": Metres}}'
        lines += [f"policy = {policy}", f"model = {self.algorithm}("]
        given = ['"MlpPolicy"', "worlds", *(f"{name}={value}" for name, value in numbers.items())]
        lines += [f"    {each}," for each in (*given, "policy_kwargs=policy")]
        return "\n".join([*lines, ")"])


PPO = {"learning_rate": 3e-4, "n_steps": 256, "batch_size": 512, "gamma": 0.99}
SAC = {
    "learning_rate": 1e-3,
    "learning_starts": 5_000,
    "buffer_size": 300_000,
    "gradient_steps": 2,
    "gamma": 0.98,
    "tau": 0.01,
    "ent_coef": "auto_0.01",
}
TD3 = {
    "learning_rate": 1e-3,
    "learning_starts": 5_000,
    "buffer_size": 300_000,
    "gradient_steps": 2,
    "gamma": 0.98,
    "tau": 0.01,
}
RECIPES = (
    Recipe("PPO", "herd", 64, 4_000_000, 200_000, PPO),
    Recipe("SAC", "herd", 32, 300_000, 20_000, SAC),
    Recipe("TD3", "herd", 32, 400_000, 20_000, TD3, noise=0.6),
    Recipe("PPO", "drive", 64, 2_000_000, 100_000, PPO),
    Recipe("SAC", "drive", 32, 300_000, 20_000, SAC),
    Recipe("TD3", "drive", 32, 400_000, 20_000, TD3, noise=0.6),
)


def episodes(
    predict: Any, task: str, seed: int, count: int, observation: ObservationKind = "full"
) -> dict[str, np.ndarray]:
    """Success, steps and return of one episode in each of so many worlds."""
    limit = 1000 if task == "herd" else None
    worlds = HerdingVectorEnv(count, task, observation=observation, max_episode_steps=limit)
    seen, _ = worlds.reset(seed=seed)
    over, success = np.zeros(count, bool), np.zeros(count, bool)
    steps, total = np.zeros(count), np.zeros(count)
    while not over.all():
        seen, reward, terminated, truncated, info = worlds.step(predict(seen))
        total += np.where(over, 0.0, reward)
        ended = (terminated | truncated) & ~over
        success, steps = (
            np.where(ended, info[name], before)
            for name, before in (("success", success), ("steps", steps))
        )
        over |= ended
    return {"success": success, "steps": steps, "return": total}


def figures(flown: dict[str, np.ndarray]) -> dict[str, Any]:
    """Success with its interval, and means with theirs."""
    share, interval = statistics.share(int(flown["success"].sum()), len(flown["success"]))
    means = {name: statistics.summary(flown[name]) for name in ("steps", "return")}
    return {"success": share, "success_ci95": interval, "cases": len(flown["success"]), **means}


def train(recipe: Recipe, seed: int, folder: Path) -> dict[str, Any]:
    """Train, keep the best policy of those evaluated on the way, and judge it on other starts."""
    import torch
    from stable_baselines3.common.callbacks import BaseCallback

    torch.set_num_threads(1)
    made: dict[str, Any] = {}
    exec(recipe.code(seed), made)
    model, kept = made["model"], folder / f"{recipe.name}-{seed}.zip"
    began = time.process_time(), time.monotonic()
    rows: list[dict[str, Any]] = []

    def predict(seen: np.ndarray) -> np.ndarray:
        return model.predict(seen, deterministic=True)[0]

    def rank(row: dict[str, Any]) -> tuple[float, float]:
        herds = recipe.task == "herd"
        return (row["success"], -row["steps"]) if herds else (row["return"], 0.0)

    class OnTheWay(BaseCallback):
        due = 0

        def _on_step(self) -> bool:
            if self.num_timesteps < self.due:
                return True
            self.due += recipe.every
            flown = episodes(predict, recipe.task, ON_THE_WAY, 200)
            row = {name: float(values.mean()) for name, values in flown.items()}
            row |= {"step": self.num_timesteps, "cpu": time.process_time() - began[0]}
            row |= {"wall": time.monotonic() - began[1]}
            if not rows or rank(row) > max(map(rank, rows)):
                model.save(kept)
            rows.append(row)
            print(f"{recipe.name} {seed}:", {k: round(v, 3) for k, v in row.items()}, flush=True)
            return True

    model.learn(recipe.steps, callback=OnTheWay())
    spent = {"cpu": time.process_time() - began[0], "wall": time.monotonic() - began[1]}
    model = type(model).load(kept)
    return {"rows": rows, **spent, "judged": judge(predict, recipe.task)}


def judge(predict: Any, task: str, observation: ObservationKind = "full") -> dict[str, Any]:
    """What a policy does in 1,000 episodes: of missions the cases that ship, of lessons others."""
    if task != "herd":
        return figures(episodes(predict, task, AT_THE_END, 1_000, observation))
    world = preset("paper", arena=4.0)
    return evaluate.row(
        evaluate.fly(world, from_policy(predict, observation), cases.shipped(world, "random"))
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="the page to write, such as docs/recipes.md")
    parser.add_argument("--runs", type=Path, default=Path("runs/recipes"))
    parser.add_argument("--only", nargs="*", help="the recipes to train, such as ppo-herd")
    parser.add_argument("--seeds", nargs="*", type=int, default=JUDGED)
    given = parser.parse_args()
    files.folder(given.runs)
    recipes = [each for each in RECIPES if given.only is None or each.name in given.only]
    for seed in given.seeds:
        for recipe in recipes:
            kept = given.runs / f"{recipe.name}-{seed}.json"
            if not kept.exists():
                found = train(recipe, seed, given.runs)
                files.write_text(kept, json.dumps(files.plain(found), indent=1) + "\n")
    if given.out:
        files.write_text(given.out, recipes_page.page(RECIPES, given.runs))


if __name__ == "__main__":
    main()

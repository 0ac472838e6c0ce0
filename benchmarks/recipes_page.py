"""docs/recipes.md, from what `recipes.py` kept."""

import json
import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from scaling import processor

from skydog import Strombom, load, preset
from skydog.study import cases, evaluate
from skydog.study.report import figure, markdown_table, share

TARGET = 0.995  # of the missions
REACH = 0.1  # metres that a dog flies in a step
COMMAND = "python benchmarks/recipes.py --out docs/recipes.md"

INTRODUCTION = """\
# Recipes for Stable-Baselines3

Numbers with which PPO, SAC and TD3 of [Stable-Baselines3](https://stable-baselines3.readthedocs.io)
learn [`Herd-v0` and `Drive-v0`](envs.md), and what each training came to. One network flies the
whole mission: it has no subgoals, no gate and no scale factor. So it herds only what it was trained
for: three sheep, to this goal, in an arena of 4 m. The [glossary](glossary.md) explains the words.

Made by `{command}` (`pip install 'skydog[sb3]'`)
on {where}.

- Each training had one thread. **Minutes are those of the processor**, compiling and evaluations
  included. The machine was shared with other work: on a quiet machine the processor needs less.
- The recipes were tuned with the seeds 0 to 4. The seeds below are others.
- Every policy is evaluated on the way, in 200 episodes, and the best is kept. *First* is the first
  evaluation in which at least {target:.1%} of the missions succeeded.
- The policy that was kept is judged in 1,000 episodes that were used for nothing else. Brackets
  are 95 % intervals.
"""

HERD = """
## Herd-v0

Judged in the 1,000 random starts that ship (`--cases 1000 --starts random` of `skydog test`). The
last two rows are shepherds of ours, in the same missions.

{table}"""

DRIVE = """
## Drive-v0

The lesson *drive*, in arenas of 3 to 40 m. An episode has 50 steps and does not end when the dog
arrives, so what counts is the return. *Straight* is a rule, in the same episodes: a dog that flies
straight to its subgoal.

{table}"""

PROGRAMS = """
## The recipes

What is not in the table is as Stable-Baselines3 has it.

{table}
The programs for `Herd-v0`; for `Drive-v0`, write `"drive"` and the steps of the table. To keep the
best policy of several on the way, as was done here, give `learn` an
[`EvaluationCallback`](envs.md#stable-baselines3).
"""


def page(recipes: Sequence[Any], folder: Path) -> str:
    """The page, of the trainings that are in the folder."""
    where = (
        f"{processor()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        + ", ".join(f"{name} {version(name)}" for name in ("stable-baselines3", "torch", "jax"))
    )
    text = INTRODUCTION.format(command=COMMAND, where=where, target=TARGET)
    missing = [each.name for each in recipes if not list(folder.glob(f"{each.name}-*.json"))]
    if missing:
        text += f"- Not trained to the end here, and so in no table: {', '.join(missing)}.\n"
    text += HERD.format(table=herd(recipes, folder)) + DRIVE.format(table=drive(recipes, folder))
    text += PROGRAMS.format(table=numbers(recipes))
    return text + "".join("\n" + program(each) for each in recipes if each.task == "herd")


def program(recipe: Any) -> str:
    """Train and save, as a block."""
    end = f'model.learn({recipe.steps:_})\nmodel.save("{recipe.name}.zip")'
    return f"<!-- not run: needs stable-baselines3 -->\n```python\n{recipe.code(0)}\n{end}\n```\n"


def numbers(recipes: Sequence[Any]) -> str:
    """The hyperparameters, a column a recipe; what is not there is Stable-Baselines3's own."""
    shown = [
        {
            "worlds": recipe.worlds,
            "steps": f"{recipe.steps:,}",
            "layers": "-".join(map(str, recipe.net)),
            **recipe.numbers,
            **({"noise on actions, SD": recipe.noise} if recipe.noise is not None else {}),
        }
        for recipe in recipes
    ]
    names = list(dict.fromkeys(name for one in shown for name in one))
    head = ["", *(f"{recipe.algorithm}, {recipe.task}" for recipe in recipes)]
    return markdown_table(
        head, [[name, *(str(one.get(name, "")) for one in shown)] for name in names]
    )


def kept(recipes: Sequence[Any], folder: Path, task: str) -> list[tuple[str, dict[str, Any]]]:
    """The trainings on a task, by algorithm and seed."""
    found = []
    for recipe in recipes:
        if recipe.task == task:
            for path in sorted(folder.glob(f"{recipe.name}-*.json")):
                seed = path.stem.rsplit("-", 1)[1]
                found.append((f"{recipe.algorithm}, seed {seed}", json.loads(path.read_text())))
    return found


def minutes(seconds: float) -> str:
    return f"{seconds / 60:.1f}"


def herd(recipes: Sequence[Any], folder: Path) -> str:
    """A row a training, and our own shepherds below."""
    rows = []
    for name, found in kept(recipes, folder, "herd"):
        first = next((row for row in found["rows"] if row["success"] >= TARGET), None)
        came = [f"{first['step']:,}", minutes(first["cpu"])] if first else ["never", "—"]
        all_of_it = [f"{found['rows'][-1]['step']:,}", minutes(found["cpu"])]
        rows.append([name, *came, *all_of_it, *missions(found["judged"])])
    world = preset("paper", arena=4.0)
    for name, shepherd in (("H-DDPG-4x4", load("h-ddpg-4x4")), ("Strömbom", Strombom())):
        flown = evaluate.fly(world, shepherd, cases.shipped(world, "random"))
        rows.append([name, *["—"] * 4, *missions(evaluate.row(flown))])
    head = ["", "first: steps", "first: minutes", "steps", "minutes", "success", "steps a mission"]
    return markdown_table([*head, "distance (m)"], rows)


def missions(row: dict[str, Any]) -> list[str]:
    low, high = row["success_ci95"]
    success = f"{share(row['success'])} [{100 * low:.1f}, {100 * high:.1f}]"
    return [success, figure(row["steps"], ".0f"), figure(row["distance"], ".1f")]


def drive(recipes: Sequence[Any], folder: Path) -> str:
    """A row a training, and the rule below."""
    from recipes import judge

    rows = [
        [name, f"{found['rows'][-1]['step']:,}", minutes(found["cpu"]), *lesson(found["judged"])]
        for name, found in kept(recipes, folder, "drive")
    ]
    rows.append(["Straight", "—", "—", *lesson(judge(straight, "drive", "compact"))])
    head = ["", "steps", "minutes", "return", "came to the subgoal"]
    return markdown_table(head, rows)


def straight(seen: np.ndarray) -> np.ndarray:
    """Of the compact observation: to the subgoal, and no further than to it."""
    return np.clip(-seen[:, 2:4] / REACH, -1.0, 1.0)


def lesson(row: dict[str, Any]) -> list[str]:
    return [figure(row["return"], ".2f"), share(row["success"])]

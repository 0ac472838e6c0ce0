"""How cost grows with sheep, worlds and seeds, on whatever device jax runs: `scaling.py --help`.

Needs skydog, with the jax of the device, and nothing else.
"""

import argparse
import os
import platform
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from skydog import files
from skydog.learning import ddpg, train
from skydog.learning.lessons import Lesson
from skydog.world import mission, neighbours
from skydog.world.presets import preset

SHEEP = (3, 10, 30, 100, 300, 1_000, 3_000, 10_000, 30_000, 100_000)
WORLDS = (1, 16, 256, 1_024, 4_096, 16_384, 65_536)
SEEDS = (1, 4, 16, 64, 256, 1_024, 4_096)
SECONDS = 1.0  # about how long each is timed, three times
SPACING = 4.0  # metres of pasture a sheep, on each side: one density for all flocks


def main() -> None:
    """Time one flock, many worlds and many trainings, and print and write what was found."""
    parser = argparse.ArgumentParser(
        description="Time skydog's worlds and trainings on the device that jax runs on.",
        epilog="Example: python benchmarks/scaling.py --out docs/scaling.md",
    )
    parser.add_argument("--out", type=Path, help="where to write the tables, as Markdown")
    parser.add_argument("--most", type=int, default=10**6, help="leave out what is larger")
    given = parser.parse_args()
    device = jax.devices()[0]
    where = f"{device.platform}: {device.device_kind}, {len(jax.devices())} of them"
    if device.platform == "cpu":
        where += f", {processor()}, {len(_cores())} cores"
    print(f"Running on {where}.", flush=True)
    tables = [
        ("One flock", "sheep", "steps/s", SHEEP, flock),
        ("Worlds of 3 sheep in one call", "worlds", "mission steps/s in all", WORLDS, worlds),
        (
            "Trainings in one call",
            "seeds",
            "environment steps/s, one update each, in all",
            SEEDS,
            seeds,
        ),
    ]
    lines = [
        "# How cost grows",
        "",
        f"Measured on {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by `python benchmarks/scaling.py` on "
        f"{where}; skydog {version('skydog')}, jax {jax.__version__}, Python "
        f"{platform.python_version()}; cells {'by numba' if _cells() else 'missing'}. Each figure "
        "is the median of three timings; compiling is not counted.",
        "",
    ]
    costs: dict[str, list[tuple[int, float]]] = {}
    for title, what, unit, sizes, measure in tables:
        print(f"\n{title}: {unit}", flush=True)
        found = []
        for size in (size for size in sizes if size <= given.most):
            try:
                found.append((size, measure(size)))
            except Exception as problem:  # out of memory, mostly: what fits is told
                print(f"  {size:>8,}  {type(problem).__name__}", flush=True)
                break
            print(f"  {size:>8,}  {found[-1][1]:>16,.0f}", flush=True)
        lines += [f"## {title}", "", f"| {what} | {unit} | exponent |", "| --: | --: | --: |"]
        before: tuple[int, float] | None = None
        for size, speed in found:
            slope = ""
            if before:
                # One call does `size` worlds or seeds: its cost is what all of them take.
                each = 1.0 if measure is flock else size / before[0]
                cost = each * before[1] / speed
                slope = f"{np.log(cost) / np.log(size / before[0]):.2f}"
            lines.append(f"| {size:,} | {speed:,.0f} | {slope} |")
            before = size, speed
        lines.append("")
        costs[what] = [(size, (1.0 if measure is flock else size) / speed) for size, speed in found]
    lines += ["![What a step costs, against size](scaling.png)", ""]
    lines.append("The exponent says how cost scales from the row before: 1 is linear.")
    if given.out:
        draw(costs, given.out.with_suffix(".png"))
        files.write_text(given.out, "\n".join([*lines, ""]))


def draw(costs: dict[str, list[tuple[int, float]]], path: Path) -> None:
    """What a step of everything costs, against size, both in logarithms; beside it, exponent 1."""
    figure = Figure(figsize=(3.0 * len(costs), 2.6), layout="constrained")
    panels = figure.subplots(1, len(costs), squeeze=False)[0]
    for axes, (what, points) in zip(panels, costs.items(), strict=True):
        sizes, seconds = np.array(points, float).T
        axes.loglog(sizes, seconds, "o-", color="#0072B2", markersize=3, label="measured")
        line = seconds[-1] * sizes / sizes[-1]
        axes.loglog(sizes, line, ":", color="#444444", label="linear")
        axes.set(xlabel=what, ylabel="seconds a step")
        axes.legend(frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def flock(sheep: int) -> float:
    """Steps a second of one world of so many sheep, at one density, with a dog in their midst."""
    world = preset("strombom2014", 1e4, sheep)
    world = replace(world, arena=replace(world.arena, size=SPACING * sheep**0.5))
    state = mission.start(
        world.arena.size * jax.random.uniform(jax.random.key(0), (sheep, 2)),
        0.5 * world.arena.size * jnp.ones((1, 2)),
    )
    velocity = jnp.array([[0.3, 0.1]])

    def on(state: mission.State, steps: int) -> mission.State:
        key = jax.random.key(1)

        def step(state: mission.State, now: jax.Array):
            return mission.step(world, state, velocity, jax.random.fold_in(key, now)), None

        return jax.lax.scan(step, state, jnp.arange(steps))[0]

    return _speed(jax.jit(on, static_argnames="steps"), state)


def worlds(count: int) -> float:
    """Mission steps a second of so many worlds of 3 sheep, all worlds together."""
    world = preset("paper")
    keys = jax.random.split(jax.random.key(0), count)
    states = jax.vmap(lambda key: mission.reset(world, key))(keys)
    velocity = jnp.array([[0.3, 0.1]])
    forward = mission.step if count == 1 else jax.vmap(mission.step, in_axes=(None, 0, None))
    if count == 1:
        states = jax.tree.map(lambda leaf: leaf[0], states)

    def on(states: mission.State, steps: int) -> mission.State:
        def step(states: mission.State, _: None):
            return forward(world, states, velocity), None

        return jax.lax.scan(step, states, length=steps)[0]

    return count * _speed(jax.jit(on, static_argnames="steps"), states)


def seeds(count: int) -> float:
    """Steps a second of so many trainings of the drive lesson, all trainings together."""
    # A memory a tenth as large as usual: thousands of whole ones fit into few machines.
    lesson, config = Lesson(preset("paper"), "drive"), ddpg.Config(memory=10_000)
    if count == 1:  # as `skydog train` runs it
        one = train.init(lesson, config, jax.random.key(0))

        def alone(training: train.Training, steps: int) -> train.Training:
            return train.advance(lesson, config, training, jax.random.key(1), steps)[0]

        return _speed(alone, one)
    keys = jax.random.split(jax.random.key(0), count)
    trainings = jax.jit(jax.vmap(lambda key: train.init(lesson, config, key)))(keys)

    def on(trainings: Any, steps: int) -> Any:
        return jax.vmap(lambda one, key: train.advance(lesson, config, one, key, steps)[0])(
            trainings, keys
        )

    return count * _speed(jax.jit(on, static_argnames="steps", donate_argnums=0), trainings)


def _speed(on: Callable[..., Any], state: Any) -> float:
    """Steps a second: as many in a call as last about `SECONDS`, in doublings from ten."""
    steps = 10
    while True:
        state = on(state, steps=steps)  # compiles
        jax.block_until_ready(state)
        began = time.perf_counter()
        state = on(state, steps=steps)
        jax.block_until_ready(state)
        took = time.perf_counter() - began
        if took > SECONDS / 4 or steps > 10**7:
            break
        steps = int(steps * min(10.0, max(2.0, 0.6 * SECONDS / took)))
    speeds = []
    for _ in range(3):
        began = time.perf_counter()
        state = on(state, steps=steps)
        jax.block_until_ready(state)
        speeds.append(steps / (time.perf_counter() - began))
    return float(np.median(speeds))


def _cells() -> bool:
    return jax.default_backend() == "cpu" and neighbours.compiled() is not None


def _cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def processor() -> str:
    """What the machine calls its processor."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


if __name__ == "__main__":
    main()

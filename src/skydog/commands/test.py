"""`skydog test`: fly a shepherd through cases, and print how good it is."""

from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from skydog.commands import flags
from skydog.commands.flags import (
    Cases,
    Dogs,
    Every,
    Goal,
    GoalRadius,
    Json,
    MaybeArena,
    MaybeMix,
    MaybeOut,
    MaybeScene,
    MaybeSheep,
    Nearness,
    OwnWorld,
    Preset,
    Seed,
    Steps,
)
from skydog.errors import Refusal
from skydog.shepherds.options import AtPoint
from skydog.study.options import Starts

if TYPE_CHECKING:
    from jaxtyping import PRNGKeyArray

    from skydog.world.mission import Fly, Shepherd
    from skydog.world.params import World
    from skydog.world.state import State


def test(
    shepherd: Positional[flags.Shepherd],
    preset: Preset = "paper",
    world: OwnWorld = None,
    scene: MaybeScene = None,
    arena: MaybeArena = None,
    goal: Goal = None,
    goal_radius: GoalRadius = None,
    sheep: MaybeSheep = None,
    dogs: Dogs = 1,
    mix: MaybeMix = None,
    nearness: Nearness = None,
    cases: Cases = 30,
    starts: Starts | None = None,
    seed: Seed = 0,
    steps: Steps | None = None,
    at_point: AtPoint = "constant",
    out: MaybeOut = None,
    every: Every = 1,
    as_json: Json = False,
) -> int:
    """Fly a shepherd through test cases, and print how good it is.

    Name a sheepdog by its file, its run folder, or its name if it ships with skydog, such as
    h-ddpg-4x4. In an arena of another size than the one it was trained in, its inputs and
    commands are scaled by ξ, as in the paper.

    Example: skydog test runs/herd --arena 6 --goal 6,6 --cases 1000 --starts random

    Args:
        shepherd: A sheepdog's file, run folder or name; a rule: strombom, elfiqi, arc, team,
            rearmost, lama or ring; your own code, FILE.py:NAME or package.module:NAME; FILE.onnx
            of skydog export; or a zip of Stable-Baselines3, such as ppo:FILE.zip. Code and zips
            are run: name only what you trust. See docs/compare.md.
        preset: The world of the missions; see skydog presets.
        world: Your own world instead: the name of a world, or of a function of arena and sheep,
            in a Python file, which is run. See docs/own.md.
        scene: Obstacles to herd around: gate, corridor, u-trap, maze, clutter, or a file in TOML
            or GeoJSON. See docs/scenes.md.
        arena: Side of the arena in metres; the world's own if not given. In a scene it grows with
            the flock.
        goal: The goal's position in metres, such as 4,4; the world's own if not given.
        goal_radius: The goal's radius 𝔻 in metres; the world's own if not given.
        sheep: Sheep in the flock; as many as the world has if not given, 3 in a preset.
        dogs: Dogs, which all fly the same shepherd.
        mix: Other kinds of sheep and their shares of the flock, such as loner=0.2,noisy=0.1:
            stubborn, short-sighted, loner, noisy, follower, slow. See docs/mixed.md.
        nearness: Which stray a dog collects: the one with the greatest (distance from the flock's
            centre - nearness * distance from the dog). 0 takes the furthest, as in the paper; 1
            prefers one near the dog. If not given: 0 beside the paper's figures, else the world's.
        cases: How many missions.
        starts: `paper`: only the dogs start at random; `random`: the sheep too, opposite the
            goal, or where the scene says; `anywhere`: the sheep start anywhere in the arena. If
            not given: paper, and random in a scene.
        seed: Random seed of the starts and the noise.
        steps: Maximum steps per mission; a mission that needs more has failed. If not given: 1000,
            and 5000 in a scene.
        at_point: Whether strombom flies past its subgoal at full speed, or stops there.
        out: Where to write results.json and a trace per mission, if given.
        every: With --out, record the sheep at every n-th step; 10 makes files ten times smaller.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog.commands import console, missions
    from skydog.shepherds import named, scope, store
    from skydog.shepherds.strombom import Strombom
    from skydog.study import cases as draws
    from skydog.study import evaluate

    flown = missions.asked(
        preset,
        world,
        scene,
        arena,
        goal,
        goal_radius,
        sheep,
        dogs,
        mix,
        nearness,
        starts,
        steps,
    )
    where, sheep = flown.world, flown.sheep
    rule = shepherd == "strombom"
    steers, card = (Strombom(at_point=at_point), {}) if rule else named.read(shepherd)
    if card.get("own_world") and world is None:
        console.say(
            f"{shepherd} was trained in a world of your own; here it flies in {preset}. "
            f"Add --world {card['own_world']} to fly it there."
        )
    console.say_beyond(shepherd, scope.beyond(card, where, sheep))
    name = evaluate.scenario(steers, where, store.called(shepherd, card), sheep, dogs)
    name = missions.title(name, preset, world, scene, mix)
    drawn = draws.cases(where, cases, flown.starts, seed, sheep, dogs)
    key = evaluate.noise_key(where, seed)
    named.trial(shepherd, steers, where, drawn)
    # The metrics need the sheep at the start and at the end alone; a trace's file shows more.
    fly = partial(evaluate.fly, every=None if out is None else every)
    results = run(name, steers, where, drawn, flown.steps, key, out, fly)
    console.show(results, as_json, flown.as_paper)
    return 0


def run(
    name: str,
    shepherd: "Shepherd",
    world: "World",
    starts: "State",
    steps: int,
    key: "PRNGKeyArray | None",
    out: Path | None,
    fly: "Fly",
) -> dict[str, Any]:
    """Fly a shepherd from every start; return the row of figures by its name.

    `fly` flies the missions. With `out`, the results and every mission's trace are written there.
    """
    from skydog import files
    from skydog.commands import console
    from skydog.study import evaluate, report
    from skydog.world import trace as traces

    with nullcontext() if out is None else files.claimed(out):
        if out is not None and files.exists(out / report.RESULTS):
            raise Refusal(f"{out} holds results already; choose another --out")
        flown = fly(world, shepherd, starts, steps, key)
        console.say_over(flown)
        results = {name: evaluate.row(flown)}
        if out is not None:
            report.write(out, results)
            for case in range(len(starts.sheep)):
                path = out / "traces" / f"{name}-{case + 1}.safetensors"
                traces.save(path, evaluate.one_case(flown, case), name)
    return results

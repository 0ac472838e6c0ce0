"""`skydog compare`: shepherds on the same cases, in one table."""

import json
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from skydog.commands import flags
from skydog.commands.flags import (
    Cases,
    Dogs,
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
from skydog.study.options import Starts

if TYPE_CHECKING:
    from skydog.commands.missions import Missions
    from skydog.twin import Twin
    from skydog.world.state import State

PROFILE, DISTURB = "tum-simulator", "none"  # as `skydog twin` has them


def compare(
    shepherds: Positional[flags.Shepherds],
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
    twin: bool = False,
    profile: Annotated[str, arg(metavar="NAME|FILE.toml")] = PROFILE,
    disturb: Annotated[str, arg(metavar="NAME")] = DISTURB,
    out: MaybeOut = None,
    as_json: Json = False,
) -> int:
    """Fly shepherds through the same cases, and print one table, with differences to the first.

    With --out, the folder has the table, every mission and a figure. Rows are kept as they are
    flown: after Ctrl-C the same command continues, and with another shepherd it flies that one.

    Example: skydog compare strombom h-ddpg-4x4 my_dog.py:dog ppo:model.zip --cases 100

    Args:
        shepherds: Each a sheepdog's file, run folder or name; a rule: strombom, strombom-arrive,
            elfiqi, arc, team, rearmost, lama or ring; your own code, FILE.py:NAME or
            package.module:NAME; FILE.onnx of skydog export; or a zip of Stable-Baselines3 with its
            algorithm: a2c, ddpg, ppo, sac or td3. Code and zips are run: name only what you
            trust. See docs/compare.md.
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
        mix: Other kinds of sheep and their shares of the flock, such as loner=0.2,noisy=0.1. See
            docs/mixed.md.
        nearness: Which stray a dog collects; see skydog test --help.
        cases: How many missions each flies.
        starts: How sheep start; see skydog test --help.
        seed: Random seed of the starts and the noise.
        steps: Maximum steps per mission; a mission that needs more has failed. If not given: 1000,
            and 5000 in a scene.
        twin: Fly in the physics twin, in the preset paper-physical if none is given. Starts are
            those that robots can take: `paper`, or `random` if not given. See skydog twin.
        profile: With --twin, the drone: tum-simulator, ardrone2, crazyflie, or a file like theirs.
        disturb: With --twin, the disturbances: none, mild or lab.
        out: Where to write results.json, results.md, results.csv and the figure, if given.
        as_json: Print the results as JSON instead of a table.
    """
    if len(shepherds) < 2:
        raise Refusal("compare needs two shepherds or more; try skydog compare strombom h-ddpg-4x4")
    if not twin and (profile, disturb) != (PROFILE, DISTURB):
        raise Refusal("--profile and --disturb are of the twin; add --twin, or leave them out")
    import jax

    from skydog.commands import console, missions
    from skydog.shepherds import scope
    from skydog.study import compare as study
    from skydog.view import comparison, figures
    from skydog.world import loading

    if twin and preset == "paper" and world is None:
        preset = "paper-physical"
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
    entries = study.entries(shepherds)
    fly, drawn = None, cases
    if twin:
        fly, drawn = _twin(flown, cases, starts, seed, dogs, profile, disturb)
    asked = study.asked(flown.world, drawn, flown.starts, seed, flown.sheep, dogs, flown.steps)
    if fly is not None:
        asked.about["flown by"] = str(fly)
        asked = asked._replace(key=jax.random.key(seed))
    if world is not None:
        asked.about["SHA-256 of the world's file"] = loading.digest(world)
    for name, entry in entries.items():
        console.say_beyond(name, scope.beyond(dict(entry.card), flown.world, flown.sheep))
    if out is not None:
        console.say("Ctrl-C keeps the rows that are flown; the same command continues.")
    found = study.flown(entries, asked, out, fly, console.track)
    if out is not None:
        figures.save(comparison.figure(found), out / "comparison")
        console.say(f"Everything is in {out}; see {out / 'comparison.png'}.")
    if as_json:
        print(json.dumps(found.plain(), indent=2))
    else:
        console.print_table(found.table())
    return 0


def _twin(
    flown: "Missions",
    cases: int,
    starts: Starts | None,
    seed: int,
    dogs: int,
    profile: str,
    disturb: str,
) -> "tuple[Twin, State]":
    """The twin, and starts that can be flown in it. Raises `Refusal` for what cannot be."""
    from skydog.flight import profiles
    from skydog.twin import Twin
    from skydog.twin import starts as draws

    if starts == "anywhere":
        raise Refusal("rovers do not start anywhere in the twin; try --starts random")
    kind = "paper" if starts == "paper" else "spaced"
    fly = Twin(profile, disturb=disturb)
    fly.check()
    uav, rover = profiles.uav(profile), profiles.rover(fly.rovers)
    return fly, draws.draw(flown.world, cases, kind, uav, rover, seed, flown.sheep, dogs)

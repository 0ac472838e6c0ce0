"""`skydog twin`: fly a shepherd in the physics twin, and print how good it is."""

from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from skydog.commands import flags
from skydog.commands.flags import (
    Cases,
    Dogs,
    FlightSteps,
    Goal,
    GoalRadius,
    Json,
    MaybeArena,
    MaybeFilm,
    MaybeOut,
    MaybePreset,
    MaybeScene,
    MaybeSheep,
    OwnWorld,
    Seed,
    Speed,
    Threads,
    Wait,
    one_world,
    own_sheep,
    world_of,
)
from skydog.errors import Refusal
from skydog.flight.options import Steering
from skydog.shepherds.options import AtPoint
from skydog.study.options import FlyableStarts

if TYPE_CHECKING:
    from skydog.world.trace import Trace


def twin(
    shepherd: Positional[flags.Shepherd],
    preset: MaybePreset = None,
    world: OwnWorld = None,
    scene: MaybeScene = None,
    arena: MaybeArena = None,
    goal: Goal = None,
    goal_radius: GoalRadius = None,
    sheep: MaybeSheep = None,
    dogs: Dogs = 1,
    profile: Annotated[str, arg(metavar="NAME|FILE.toml")] = "tum-simulator",
    rovers: Annotated[str, arg(metavar="NAME|FILE.toml")] = "kobuki",
    disturb: Annotated[str, arg(metavar="NAME")] = "none",
    wait: Wait = None,
    steering: Steering = "reference",
    starts: FlyableStarts = "spaced",
    cases: Cases = 30,
    seed: Seed = 0,
    speed: Speed = 1.0,
    steps: FlightSteps | None = None,
    at_point: AtPoint = "constant",
    threads: Threads = 0,
    out: MaybeOut = None,
    video: MaybeFilm = None,
    as_json: Json = False,
) -> int:
    """Fly a shepherd in the physics twin: a quadrotor and rovers with wheels, in MuJoCo.

    Drones take off from the floor. Controllers fly what the shepherd decides, and rovers drive
    as the flock's law says. If a robot crashes, the mission ends and has failed.

    Example: skydog twin h-ddpg-6x6 --profile ardrone2 --disturb lab --speed 0.17 --video flight.mp4

    Args:
        shepherd: A sheepdog's file, run folder or name; a rule: strombom, elfiqi, arc, team,
            rearmost, lama or ring; your own code, FILE.py:NAME or package.module:NAME; FILE.onnx
            of skydog export; or a zip of Stable-Baselines3, such as ppo:FILE.zip. Code and zips
            are run: name only what you trust. See docs/compare.md.
        preset: The world of the missions, paper-physical if not given; see skydog presets.
        world: Your own world instead: the name of a world, or of a function of arena and sheep,
            in a Python file, which is run. See docs/own.md.
        scene: Obstacles to herd around: gate, corridor, u-trap, maze, clutter, or a file in TOML
            or GeoJSON. Rovers collide with them, and drones fly above. See docs/scenes.md.
        arena: Side of the arena in metres; the world's own if not given. In a scene it grows with
            the flock.
        goal: The goal's position in metres, such as 4,4; the world's own if not given.
        goal_radius: The goal's radius 𝔻 in metres; the world's own if not given.
        sheep: Rovers in the flock; as many as the world has if not given, 3 in a preset.
        dogs: Drones, which all fly the same shepherd, each at its own height.
        profile: The drone: tum-simulator, ardrone2, crazyflie, or a file like theirs.
        rovers: The rovers: kobuki, or a file like it.
        disturb: The disturbances: none, mild or lab.
        wait: Take the next set-point only when the drone is nearer than this to the last one, as
            in the paper's laboratory; if not given, take one at every step.
        steering: How rovers obey a force. `reference` and `track` follow a set-point, `turn` turns
            towards the force first; with `reference` the shepherd sees the set-points.
        starts: `spaced`: the rovers start at random opposite the goal, or where the scene says;
            `paper`: where the paper's cases have them. Starts in which rovers overlap or pads are
            not clear are drawn again.
        cases: How many missions.
        seed: Random seed of the starts and of the disturbances.
        speed: Dogs and sheep move at this share of the world's speeds. The paper's laboratory
            flew at about a sixth.
        steps: Maximum steps per mission; a mission that needs more has failed. If not given: 1000,
            and 5000 in a scene.
        at_point: Whether strombom flies past its subgoal at full speed, or stops there.
        threads: Cores to fly on, 0 for all. The results do not depend on it.
        out: Where to write results.json and a trace per mission, if given.
        video: Where to write a film of the first mission, if given.
        as_json: Print the results as JSON instead of a table.
    """
    import jax

    from skydog import files
    from skydog.commands import console, missions
    from skydog.commands.test import run
    from skydog.flight import profiles
    from skydog.shepherds import named, scope, store
    from skydog.shepherds.strombom import Strombom
    from skydog.study import evaluate, report
    from skydog.twin import Twin
    from skydog.twin import starts as draws
    from skydog.world import presets

    if preset is not None:
        one_world(preset, world)
    chosen = preset or ("paper-physical" if world is None else "paper")
    sheep = own_sheep(world, sheep)
    where = world_of(chosen, world, arena, sheep, dogs, goal, goal_radius, scene=scene)
    steps = steps or missions.longest(scene)
    where = presets.at_speed(where, speed)
    if video is not None and video.suffix != ".mp4":
        raise Refusal(f"a film is written as MP4, got {video}; try --video {video.stem}.mp4")
    if video is not None:
        files.folder(video.parent)  # what cannot be written is refused before anything is flown
    rule = shepherd == "strombom"
    steers, card = (Strombom(at_point=at_point), {}) if rule else named.read(shepherd)
    console.say_beyond(shepherd, scope.beyond(card, where, sheep))
    uav, rover = profiles.uav(profile), profiles.rover(rovers)
    Twin(profile, rovers, disturb, wait, steering, threads=threads).check()
    drawn = draws.draw(where, cases, starts, uav, rover, seed, sheep, dogs)
    called = store.called(shepherd, card)
    name = f"{evaluate.scenario(steers, where, called, sheep, dogs)}-{uav.name}"
    name = missions.title(name, "paper", world, scene, None)
    with console.missions(cases) as update:
        fly = Twin(profile, rovers, disturb, wait, steering, threads=threads, progress=update)
        kept: list[Trace] = []

        def flown(*mission: Any) -> "Trace":
            kept.append(fly(*mission))
            return kept[0]

        results = run(name, steers, where, drawn, steps, jax.random.key(seed), out, flown)
    console.say_endings(kept[0])
    if as_json:
        console.show(results, as_json)
    else:
        console.print_table(report.metrics_table(results))
    if video is not None:
        console.film(video, evaluate.one_case(kept[0], 0), profile, rovers)
    return 0

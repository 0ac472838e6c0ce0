"""`skydog watch`: the live view in the browser."""

from tyro.conf import Positional

from skydog.commands import flags
from skydog.commands.flags import (
    Dogs,
    Goal,
    GoalRadius,
    MaybeArena,
    MaybeMix,
    MaybeScene,
    MaybeSheep,
    OwnWorld,
    Port,
    Preset,
    goal_of,
    one_world,
    own_sheep,
)


def watch(
    shepherd: Positional[flags.Shepherd] = "h-ddpg-4x4",
    preset: Preset = "paper",
    world: OwnWorld = None,
    scene: MaybeScene = None,
    arena: MaybeArena = None,
    goal: Goal = None,
    goal_radius: GoalRadius = None,
    sheep: MaybeSheep = None,
    dogs: Dogs = 1,
    mix: MaybeMix = None,
    host: str = "127.0.0.1",
    port: Port = 8020,
    open_browser: bool = False,
) -> int:
    """Play with a flock in the browser: drag the dog or the goal, or fly against the sheepdog.

    Serves a page on this machine until Ctrl-C. On the page you can choose the shepherd, the world,
    the arena, sheep, dogs, speed and noise. You can pause, step, and race against the sheepdog.

    Example: skydog watch h-ddpg-4x4 --sheep 12 --open-browser

    Args:
        shepherd: A sheepdog's file, run folder or name; a rule: strombom, elfiqi, arc, team,
            rearmost, lama or ring; your own code, FILE.py:NAME or package.module:NAME; FILE.onnx
            of skydog export; or a zip of Stable-Baselines3, such as ppo:FILE.zip. Code and zips
            are run: name only what you trust. See docs/compare.md.
        preset: The world that pages begin with; see skydog presets.
        world: Your own world to begin with: the name of a world, or of a function of arena and
            sheep, in a Python file, which is run. See docs/own.md.
        scene: Obstacles to begin with: gate, corridor, u-trap, maze, clutter, or a file in TOML or
            GeoJSON. See docs/scenes.md.
        arena: Side of the arena in metres; if not given, as large as the flock needs.
        goal: The goal's position in metres, such as 4,4; the world's own if not given.
        goal_radius: The goal's radius 𝔻 in metres; the world's own if not given.
        sheep: Sheep in the flock, 1 to 200; as many as the world has if not given.
        dogs: Dogs, 1 to 8.
        mix: Other kinds of sheep and their shares of the flock in every world of the page, such as
            loner=0.2,noisy=0.1. See docs/mixed.md.
        host: The address to listen at. Other computers can reach all addresses except 127.0.0.1;
            0.0.0.0 means all addresses of this machine. See docs/watch.md.
        port: The port to listen at; 0 means any free port.
        open_browser: Open the page in the browser at once.
    """
    from skydog.view import live
    from skydog.world import loading, mixing, presets

    one_world(preset, world)
    worlds = dict(presets.PRESETS)
    if world is not None:
        preset = loading.title(world)
        preset = f"{preset} (yours)" if preset in worlds else preset
        worlds = {preset: loading.maker(world), **worlds}
    sheep = own_sheep(world, sheep)
    if mix:
        worlds = {name: mixing.maker(make, mix) for name, make in worlds.items()}
    shepherds = live.policies(shepherd)
    with live.serve(
        shepherds,
        shepherd,
        preset,
        arena,
        sheep,
        dogs,
        host,
        port,
        worlds,
        goal_of(goal),
        goal_radius,
        live.cards(shepherds),
        scene,
    ) as server:
        print(f"{server.url}  (Ctrl-C ends)", flush=True)
        if open_browser:
            import webbrowser

            webbrowser.open(server.url)
        server.wait()
    return 0

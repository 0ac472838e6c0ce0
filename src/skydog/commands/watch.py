"""`skydog watch`: the live view in the browser."""

from typing import Annotated

from tyro.conf import Positional, arg

from skydog.commands.flags import MaybeArena, OwnWorld, Preset, one_world


def watch(
    shepherd: Positional[Annotated[str, arg(metavar="SHEEPDOG|strombom")]] = "h-ddpg-4x4",
    preset: Preset = "paper",
    world: OwnWorld = None,
    arena: MaybeArena = None,
    sheep: int = 3,
    dogs: int = 1,
    host: str = "127.0.0.1",
    port: int = 8020,
    open_browser: bool = False,
) -> int:
    """Play with a flock in the browser: drag the dog or the goal, or fly against the sheepdog.

    Serves a page at an address of this machine until Ctrl-C. On the page, choose who flies, the
    world, the arena, sheep, dogs, speed and noise; pause, step, and race the sheepdog.

    Example: skydog watch h-ddpg-4x4 --sheep 12 --open-browser

    Args:
        shepherd: A sheepdog's file, run folder or name, or the rule dog, strombom.
        preset: The world that pages begin with; see skydog presets.
        world: A world of your own to begin with: a file of Python, which is run, and the name
            in it of a world, or of a function of arena and sheep that makes one.
        arena: Side of the arena in metres; as wide as the flock needs if not given.
        sheep: Sheep in the flock, 1 to 200.
        dogs: Dogs, 1 to 8.
        host: The address to listen at; another than 127.0.0.1 lets others in.
        port: The port to listen at; 0 is any that is free.
        open_browser: Open the page in the browser at once.
    """
    from skydog.view import live
    from skydog.world import loading, presets

    def ready(url: str) -> None:
        print(f"{url}  (Ctrl-C ends)", flush=True)
        if open_browser:
            import webbrowser

            webbrowser.open(url)

    one_world(preset, world)
    worlds = dict(presets.PRESETS)
    if world is not None:
        preset = loading.title(world)
        worlds = {preset: loading.maker(world)} | worlds
    policies = live.policies(shepherd)
    live.serve(policies, shepherd, preset, arena, sheep, dogs, host, port, ready, worlds)
    return 0

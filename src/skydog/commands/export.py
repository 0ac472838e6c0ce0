"""`skydog export`: write a sheepdog as one file that flies without skydog."""

from pathlib import Path

from tyro.conf import Positional

from skydog.commands import flags
from skydog.commands.flags import (
    Goal,
    GoalRadius,
    MaybeArena,
    MaybeFile,
    MaybeScene,
    Nearness,
    Preset,
    world_of,
)
from skydog.errors import Refusal


def export(
    sheepdog: Positional[flags.Sheepdog],
    onnx: bool = False,
    out: MaybeFile = None,
    preset: Preset = "paper",
    scene: MaybeScene = None,
    arena: MaybeArena = None,
    goal: Goal = None,
    goal_radius: GoalRadius = None,
    nearness: Nearness = None,
) -> int:
    """Write a sheepdog as one file that flies without skydog.

    An ONNX file contains the gate, both skills and the dog's limits. Its inputs are positions in
    metres, its output is a velocity in m/s, for one dog and any number of sheep. The world is part
    of the file, so another arena needs another file. See docs/export.md.

    Example: skydog export h-ddpg-4x4 --onnx -o dog.onnx --arena 6

    Args:
        sheepdog: Its file, run folder or name, such as h-ddpg-4x4.
        onnx: As ONNX, the only format so far.
        out: The file; if not given, the sheepdog's name, or its run folder's, and .onnx.
        preset: The world that it will fly in; see skydog presets.
        scene: Refused: an ONNX file has no map of the way around obstacles.
        arena: Side of the arena in metres; if not given, that of its training.
        goal: The goal's position in metres, such as 4,4; the preset's own if not given.
        goal_radius: The goal's radius 𝔻 in metres; the preset's own if not given. The file
            states it, but the dog's flight does not depend on it.
        nearness: Which stray is collected: 0 the furthest, 1 prefers one near the dog; the
            preset's own if not given. See skydog test --help.
    """
    if not onnx:
        raise Refusal("export needs a format; add --onnx")
    if scene is not None:
        raise Refusal(
            "an ONNX file has no map of the way around obstacles; leave out --scene, or call the "
            "sheepdog from Python, as in docs/scenes.md"
        )
    from skydog.commands import console
    from skydog.shepherds import exporting, scope, store

    dog, card = store.read(sheepdog)
    if card.get("own_world"):
        console.say(f"{sheepdog} was trained in {card['own_world']}; the file holds {preset}.")
    size = float(dog.arena) if arena is None else arena
    world = world_of(preset, None, size, 3, 1, goal, goal_radius, nearness)
    console.say_beyond(sheepdog, scope.beyond(card, world, None))
    file = store.find(Path(sheepdog))
    own = file.absolute().parent.name if file.name == store.FILE else file.stem
    out = out or Path(f"{own}.onnx")
    exporting.export(out, dog, world, card)
    console.print_path(out)
    return 0

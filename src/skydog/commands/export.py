"""`skydog export`: write a sheepdog as one file that flies without skydog."""

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from skydog.commands.flags import MaybeArena, Preset
from skydog.errors import Refusal


def export(
    sheepdog: Positional[Annotated[str, arg(metavar="SHEEPDOG")]],
    onnx: bool = False,
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="FILE")] = None,
    preset: Preset = "paper",
    arena: MaybeArena = None,
) -> int:
    """Write a sheepdog as one file that flies without skydog.

    An ONNX file holds the gate, both skills and the dog's limits: positions in metres go in, and
    a velocity in m/s comes out, for one dog and any number of sheep. The world is inside, so
    that another arena is another file. See docs/export.md.

    Example: skydog export h-ddpg-4x4 --onnx -o dog.onnx --arena 6

    Args:
        sheepdog: Its file, run folder or name, such as h-ddpg-4x4.
        onnx: As ONNX, the only format so far.
        out: The file; if not given, the sheepdog's name, or its run folder's, and .onnx.
        preset: The world that it is to fly in; see skydog presets.
        arena: Side of the arena in metres; the one that it learnt in if not given.
    """
    if not onnx:
        raise Refusal("export needs a format; add --onnx")
    from skydog.commands import console
    from skydog.shepherds import exporting, store
    from skydog.world import presets

    dog, card = store.read(sheepdog)
    if card.get("own_world"):
        console.say(f"{sheepdog} was trained in {card['own_world']}; the file holds {preset}.")
    world = presets.preset(preset, float(dog.arena) if arena is None else arena)
    file = store.find(Path(sheepdog))
    own = file.absolute().parent.name if file.name == store.FILE else file.stem
    out = out or Path(f"{own}.onnx")
    exporting.export(out, dog, world, card)
    print(out)
    return 0

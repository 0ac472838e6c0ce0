"""Flags that several commands have, and what a command exits with. Free to import."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from skydog.errors import Refusal

if TYPE_CHECKING:
    from skydog.world.params import World

STOPPED = 130  # what a shell says of a command that Ctrl-C ended

Out = Annotated[Path, arg(metavar="FOLDER")]
MaybeOut = Annotated[Path | None, arg(metavar="FOLDER")]
Preset = Annotated[str, arg(metavar="NAME")]
MaybePreset = Annotated[str | None, arg(metavar="NAME")]
Arena = Annotated[float, arg(metavar="METRES")]
MaybeArena = Annotated[float | None, arg(metavar="METRES")]
OwnWorld = Annotated[str | None, arg(metavar="FILE.py:NAME")]
MaybeSheep = Annotated[int | None, arg(metavar="INT")]
Goal = Annotated[str | None, arg(metavar="X,Y")]
GoalRadius = Annotated[float | None, arg(metavar="METRES")]
Nearness = Annotated[float | None, arg(metavar="SHARE")]
Json = Annotated[bool, arg(name="json")]


def own_sheep(own: str | None, sheep: int | None) -> int:
    """The sheep of a flock: as many as asked for, or as many as the world has by itself."""
    if sheep is not None:
        return sheep
    if own is None:
        return 3
    from skydog.world import loading

    return loading.sheep_of(loading.maker(own))


def goal_of(goal: str | None) -> tuple[float, float] | None:
    """The place X,Y in metres. Raises `Refusal` for what is none."""
    if goal is None:
        return None
    try:
        x, y = map(float, goal.split(","))
    except ValueError:
        raise Refusal(f"a goal is X,Y in metres, got {goal!r:.60}; try --goal 4,4") from None
    return x, y


def world_of(
    preset: str,
    own: str | None,
    arena: float | None,
    sheep: int,
    dogs: int = 1,
    goal: str | None = None,
    goal_radius: float | None = None,
    nearness: float | None = None,
) -> "World":
    """The preset's world, or the one of your own, FILE.py:NAME. Raises `Refusal`."""
    from skydog.world import loading, mission, presets

    asked = arena, sheep, goal_of(goal), goal_radius
    if own is None:
        world = presets.preset(preset, *asked)
    else:
        one_world(preset, own)
        world = mission.check(presets.make(loading.maker(own), *asked), sheep, max(dogs, 1))
    return world if nearness is None else presets.with_nearness(world, nearness)


def one_world(preset: str, own: str | None) -> None:
    """Raise `Refusal` for a preset and a world of one's own at once; `paper` may be a default."""
    if own is not None and preset != "paper":
        raise Refusal(f"--preset {preset} and --world {own} are two worlds; leave one of them out")

"""The missions that flags ask for: world, starts and steps. Of `skydog test` and `compare`."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from skydog.commands.flags import one_world, own_sheep, world_of

if TYPE_CHECKING:
    from skydog.study.options import Starts
    from skydog.world.params import World


class Missions(NamedTuple):
    """What is flown. `as_paper`: the cases are those that the paper tests."""

    world: "World"
    sheep: int
    starts: "Starts"
    steps: int
    as_paper: bool


def asked(
    preset: str,
    world: str | None,
    scene: str | None,
    arena: float | None,
    goal: str | None,
    goal_radius: float | None,
    sheep: int | None,
    dogs: int,
    mix: dict[str, float] | None,
    nearness: float | None,
    starts: "Starts | None",
    steps: int | None,
) -> Missions:
    """What the flags come to; those not given have the defaults of `skydog test --help`."""
    from skydog.world import presets

    one_world(preset, world)
    sheep = own_sheep(world, sheep)
    where = world_of(preset, world, arena, sheep, dogs, goal, goal_radius, nearness, scene, mix)
    steps = steps or longest(scene)
    starts = starts or ("paper" if scene is None else "random")
    as_paper = (preset, world, scene, starts, dogs) == ("paper", None, None, "paper", 1)
    as_paper = as_paper and not mix
    as_paper = as_paper and presets.has_own_goal(where, preset, sheep) and not nearness
    if as_paper:
        where = presets.furthest_first(where)
    return Missions(where, sheep, starts, steps, as_paper)


def longest(scene: str | None) -> int:
    """The most steps of a mission, if none are asked for."""
    return 1000 if scene is None else 5000


def title(
    name: str, preset: str, world: str | None, scene: str | None, mix: dict[str, float] | None
) -> str:
    """The name of a row, with what is not as in the paper's world."""
    from skydog.world import loading

    if world is not None or preset != "paper":
        name += f"-{preset if world is None else loading.title(world)}"
    if scene is not None:
        name += f"-{Path(scene).stem}"
    return name + "".join(f"-{share:g}-{kind}" for kind, share in (mix or {}).items())

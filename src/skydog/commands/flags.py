"""Flags that several commands have, and what a command exits with. Free to import."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from skydog import files, quantities
from skydog.errors import Refusal, short
from skydog.quantities import Quantity
from skydog.shepherds import finding
from skydog.world.options import KIND_NAMES, PRESET_NAMES, SCENE_NAMES

if TYPE_CHECKING:
    from skydog.world.params import World

STOPPED = 130  # what a shell says of a command that Ctrl-C ended


class Misused(Exception):
    """A flag's value that was refused. No ValueError: tyro would frame it in a box of its own."""


def number(quantity: Quantity, metavar: str) -> PrimitiveConstructorSpec[Any]:
    """How the command line reads a number, or a number that may be left out."""
    return _one_word(quantity.checked, metavar)


def _path(word: str) -> Path:
    if not word:
        raise Refusal("a path is empty; name a file or a folder, or leave the option out")
    return Path(word)


def _preset(word: str) -> str:
    if word not in PRESET_NAMES:
        raise Refusal(f"no preset is called {short(word)}; choose from {', '.join(PRESET_NAMES)}")
    return word


def _scene(word: str) -> str:
    if word not in SCENE_NAMES and not files.exists(_path(word)):
        raise Refusal(
            f"no scene is called {short(word)}, and no file; choose from {', '.join(SCENE_NAMES)}"
        )
    return word


def _mix(word: str) -> dict[str, float]:
    mix: dict[str, float] = {}
    for part in word.split(","):
        name, _, share = part.partition("=")
        if name not in KIND_NAMES or name in mix:
            raise Refusal(
                f"{short(part)} is no other kind of sheep and its share; try loner=0.2, "
                f"or one of {', '.join(KIND_NAMES)}"
            )
        mix[name] = quantities.SHARE.checked(share)
    return mix


def _shepherd(word: str) -> str:
    finding.check(word)
    return word


def _sheepdog(word: str) -> str:
    if word not in finding.RULES:
        finding.find(Path(word.removeprefix(finding.TEAM)))
    return word


def _there(word: str) -> Path:
    if not files.exists(_path(word)):
        raise Refusal(f"cannot read {word}: there is no such file; check the path")
    return Path(word)


def _one_word(read: Callable[[str], Any], metavar: str) -> PrimitiveConstructorSpec[Any]:
    def from_words(words: list[str]) -> Any:
        try:
            return read(words[0])
        except Refusal as refusal:
            raise Misused(str(refusal)) from None

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=from_words,
        is_instance=lambda value: True,
        str_from_instance=lambda value: [str(value)],
    )


def _on(word: str) -> str:
    from skydog.learning import ray_cluster

    return ray_cluster.checked(word)


def _words(read: Callable[[str], Any], metavar: str) -> PrimitiveConstructorSpec[Any]:
    def from_words(words: list[str]) -> Any:
        try:
            return tuple(map(read, words))
        except Refusal as refusal:
            raise Misused(str(refusal)) from None

    return PrimitiveConstructorSpec(
        nargs="*",
        metavar=f"{metavar} ...",
        instance_from_str=from_words,
        is_instance=lambda value: True,
        str_from_instance=list,
    )


Out = Annotated[Path, _one_word(_path, "FOLDER")]
MaybeOut = Annotated[Path | None, _one_word(_path, "FOLDER")]
File = Annotated[Path, _one_word(_path, "FILE"), arg(aliases=["-o"])]
MaybeFile = Annotated[Path | None, _one_word(_path, "FILE"), arg(aliases=["-o"])]
MaybeFilm = Annotated[Path | None, _one_word(_path, "FILE.mp4")]
Preset = Annotated[str, _one_word(_preset, "NAME")]
MaybePreset = Annotated[str | None, _one_word(_preset, "NAME")]
MaybeScene = Annotated[str | None, _one_word(_scene, "NAME|FILE")]
MaybeMix = Annotated[dict[str, float] | None, _one_word(_mix, "KIND=SHARE,...")]
Shepherd = Annotated[str, _one_word(_shepherd, "SHEPHERD")]
Shepherds = Annotated[tuple[str, ...], _words(_shepherd, "SHEPHERD")]
Sheepdog = Annotated[str, _one_word(_sheepdog, "SHEEPDOG")]
Trace = Annotated[Path, _one_word(_there, "TRACE")]
Tracks = Annotated[Path, _one_word(_there, "TRACKS.csv|.dat|.mat")]
Arena = Annotated[float, number(quantities.ARENA, "METRES")]
MaybeArena = Annotated[float | None, number(quantities.ARENA, "METRES")]
OwnWorld = Annotated[str | None, arg(metavar="FILE.py:NAME|FILE.json")]
MaybeSheep = Annotated[int | None, number(quantities.SHEEP, "INT")]
Dogs = Annotated[int, number(quantities.DOGS, "INT")]
Cases = Annotated[int, number(quantities.CASES, "INT")]
Steps = Annotated[int, number(quantities.STEPS, "INT")]
FlightSteps = Annotated[int, number(quantities.FLIGHT_STEPS, "INT")]
Every = Annotated[int, number(quantities.EVERY, "INT")]
Seed = Annotated[int, number(quantities.SEED, "INT")]
Seeds = Annotated[int, number(quantities.SEEDS, "INT")]
TrainingSteps = Annotated[int, number(quantities.TRAINING, "INT")]
Episodes = Annotated[int, number(quantities.EPISODES, "INT")]
Goal = Annotated[str | None, arg(metavar="X,Y")]
GoalRadius = Annotated[float | None, number(quantities.GOAL_RADIUS, "METRES")]
Nearness = Annotated[float | None, number(quantities.NEARNESS, "SHARE")]
Speed = Annotated[float, number(quantities.SPEED, "SHARE")]
MaybeStep = Annotated[float | None, number(quantities.STEP, "SECONDS")]
Wait = Annotated[float | None, number(quantities.WAIT, "METRES")]
Port = Annotated[int, number(quantities.PORT, "INT")]
Threads = Annotated[int, number(quantities.THREADS, "INT")]
MaybeOn = Annotated[str | None, _one_word(_on, "ray|ray://HOST:PORT")]
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
    scene: str | None = None,
    mix: dict[str, float] | None = None,
) -> "World":
    """The preset's world, or the one of your own, FILE.py:NAME, in a scene. Raises `Refusal`."""
    from skydog.world import loading, mission, mixing, presets

    asked = arena, sheep, goal_of(goal), goal_radius, scene
    if own is None:
        world = presets.preset(preset, *asked)
    else:
        one_world(preset, own)
        world = mission.check(presets.make(loading.maker(own), *asked), sheep, max(dogs, 1))
    world = mixing.mixed(world, sheep, mix or {})
    return world if nearness is None else presets.with_nearness(world, nearness)


def one_world(preset: str, own: str | None) -> None:
    """Raise `Refusal` for a preset and a world of one's own at once; `paper` may be a default."""
    if own is not None and preset != "paper":
        raise Refusal(f"--preset {preset} and --world {own} are two worlds; leave one of them out")

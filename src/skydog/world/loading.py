"""A world of your own, by the name that stands on a command line: FILE.py:NAME, or FILE.json."""

import hashlib
import inspect
import json
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

from skydog import files, quantities, references
from skydog.errors import Refusal
from skydog.world import serialise
from skydog.world.laws.terms import Weighted
from skydog.world.params import World

LARGEST = 1 << 24  # bytes of a file


def maker(reference: str) -> Callable[..., World]:
    """The function of `arena` and `sheep` that makes the world FILE.py:NAME, or FILE.json.

    NAME is such a function, as the presets are, or a `World`, of which `arena` sets the side.
    The file is run as the Python that it is: only load files that you trust. FILE.json is what
    `write` wrote, and is not run. Raises `Refusal` for a file or a name that is not there, that
    fails, or that is no world.
    """
    if reference.endswith(".json"):
        return _sized(*_read(Path(reference)), reference)
    file, name = _split(reference)
    module = references.run(file.resolve())
    found = getattr(module, name, None)
    if isinstance(found, World):
        return _sized(found, _count(found), f"{name} of {file.name}")
    if not callable(found):
        worlds = [each for each, value in vars(module).items() if isinstance(value, World)]
        worlds += [
            each
            for each, value in vars(module).items()
            if inspect.isfunction(value) and value.__module__ == module.__name__
        ]
        there = f"it has {', '.join(worlds)}" if worlds else "it has no world and no function"
        kind = "" if found is None else f", {name} is {found!r:.40}"
        raise Refusal(f"{file} has no world called {name!r}{kind}; {there}")
    try:
        inspect.signature(found).bind(arena=1.0, sheep=1)
    except TypeError as problem:
        raise Refusal(
            f"{name} in {file} is called with arena=METRES and sheep=NUMBER: {problem}"
        ) from None

    @wraps(found)
    def made(**given: Any) -> World:
        try:
            world = found(**given)
        except Refusal:
            raise
        except Exception as problem:
            raise references.failed(f"{name} in {file}", file, problem) from problem
        if not isinstance(world, World):
            raise Refusal(f"{name} in {file} returned {world!r:.60}, which is no skydog.World")
        return world

    made.__doc__ = inspect.getdoc(found) or f"{name} of {file.name}"
    return made


def write(path: Path, world: World, sheep: int) -> None:
    """Write a world of laws that ship, for `sheep` sheep, as a file for --world.

    Raises `Refusal` for a law of one's own, which no file can hold.
    """
    plain = serialise.flatten(world)
    own = [name for name in plain.values() if str(name).startswith(serialise.OWN)]
    if own:
        raise Refusal(f"{own[0]} is a law that no file can hold; fly it with --world FILE.py:NAME")
    card = {"kind": "world", "sheep": sheep, "world": plain}
    files.write_text(path, json.dumps(card, indent=2, allow_nan=False) + "\n")


def _read(file: Path) -> tuple[World, int]:
    """The world of a file that `write` wrote, and its sheep. Raises `Refusal`."""
    content = files.read_bytes(file, "world's file", LARGEST)
    try:
        card = json.loads(content)
    except (ValueError, RecursionError):
        card = None
    if not isinstance(card, dict) or card.get("kind") != "world":
        raise Refusal(f"{file} is no world of skydog; skydog fit writes one")
    values = card.get("world")
    world = serialise.unflatten(values if isinstance(values, dict) else {})
    return world, quantities.SHEEP.checked(card.get("sheep"))


def _sized(found: World, count: int, called: str) -> Callable[..., World]:
    """The function that makes a world, with an arena of any side."""

    def sized(arena: float | None = None, sheep: int = count) -> World:
        size = found.arena.size if arena is None else arena
        return replace(found, arena=replace(found.arena, size=size))

    sized.__doc__ = called
    return sized


def sheep_of(maker: Callable[..., World]) -> int:
    """How many sheep a function that makes worlds has by itself; 3 if it does not say."""
    own = inspect.signature(maker).parameters.get("sheep")
    return own.default if own is not None and isinstance(own.default, int) else 3


def title(reference: str) -> str:
    """What the world FILE.py:NAME is called in tables: its file's name, and NAME if not `world`."""
    if reference.endswith(".json"):
        return Path(reference).stem
    file, name = _split(reference)
    return file.stem if name == "world" else f"{file.stem}-{name}"


def digest(reference: str) -> str:
    """The SHA-256 of the file in FILE.py:NAME: a changed law is another world."""
    file = Path(reference) if reference.endswith(".json") else _split(reference)[0]
    return hashlib.sha256(files.read_bytes(file, "world's file", LARGEST)).hexdigest()


def _split(reference: str) -> tuple[Path, str]:
    named = references.split(reference)
    if named is None:
        raise Refusal(
            f"a world of your own is named FILE.py:NAME or FILE.json, got {reference!r:.100}; "
            "try --world my_flock.py:world"
        )
    return named


def _count(world: World) -> int:
    """The sheep of a world, if any parameter has one number per sheep; else 3."""
    flock = vars(world.flock).values() if isinstance(world.flock, Weighted) else ()
    return next((np.size(each) for each in (world.sheep.speed, *flock) if np.ndim(each) == 1), 3)

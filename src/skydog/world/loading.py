"""A world of your own, by the name that stands on a command line: FILE.py:NAME."""

import hashlib
import inspect
import sys
import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from skydog.errors import Refusal
from skydog.world.params import World


def maker(reference: str) -> Callable[..., World]:
    """The function of `arena` and `sheep` that makes the world FILE.py:NAME.

    NAME is such a function, as the presets are, or a `World`, of which `arena` sets the side.
    The file is run as the Python that it is: name no file that you would not run. Raises
    `Refusal` for a file or a name that is not there, that fails, or that is no world.
    """
    file, name = _split(reference)
    module = _run(file.resolve())
    found = getattr(module, name, None)
    if isinstance(found, World):

        def sized(arena: float | None = None, sheep: int = 3) -> World:
            size = found.arena.size if arena is None else arena
            return replace(found, arena=replace(found.arena, size=size))

        sized.__doc__ = f"{name} of {file.name}"
        return sized
    if not callable(found):
        worlds = [each for each, value in vars(module).items() if isinstance(value, World)]
        worlds += [
            each
            for each, value in vars(module).items()
            if inspect.isfunction(value) and value.__module__ == module.__name__
        ]
        there = f"it has {', '.join(worlds)}" if worlds else "it has no world and no function"
        raise Refusal(f"{file} has no world called {name!r}; {there}")

    def made(**given: Any) -> World:
        try:
            world = found(**given)
        except TypeError as problem:
            raise Refusal(
                f"{name} in {file} is to be called with arena= and sheep= and return a world: "
                f"{problem}"
            ) from problem
        if not isinstance(world, World):
            raise Refusal(f"{name} in {file} returned {world!r:.60}, which is no skydog.World")
        return world

    made.__doc__ = inspect.getdoc(found) or f"{name} of {file.name}"
    return made


def title(reference: str) -> str:
    """What the world FILE.py:NAME is called in tables: its file's name, and NAME if not `world`."""
    file, name = _split(reference)
    return file.stem if name == "world" else f"{file.stem}-{name}"


def digest(reference: str) -> str:
    """The SHA-256 of the file in FILE.py:NAME: a changed law is another world."""
    file, _ = _split(reference)
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _split(reference: str) -> tuple[Path, str]:
    path, colon, name = reference.rpartition(":")
    file = Path(path)
    if not colon or file.suffix != ".py" or not name.isidentifier():
        raise Refusal(
            f"a world of your own is named FILE.py:NAME, got {reference!r:.100}; "
            "try --world my_flock.py:world"
        )
    if not file.is_file():
        raise Refusal(f"there is no file {file}; check the path")
    return file, name


@cache
def _run(file: Path) -> ModuleType:
    # Once a process: two runs would define two classes of each law, which jax tells apart.
    name = f"own_{file.stem}"
    spec = spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # as for any script, files beside it can be imported
    try:
        spec.loader.exec_module(module)
    except Exception as problem:
        lines = [
            frame.lineno
            for frame in traceback.extract_tb(problem.__traceback__)
            if Path(frame.filename) == file
        ]
        at = f" in line {lines[-1]}" if lines else ""
        raise Refusal(f"{file} failed{at}: {type(problem).__name__}: {problem}") from problem
    return module

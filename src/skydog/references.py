"""Code that a user names, FILE.py:NAME or package.module:NAME: it is run as any Python is."""

import importlib
import inspect
import os
import sys
import traceback
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from skydog import files
from skydog.errors import Refusal

FORMS = "FILE.py:NAME or package.module:NAME"


def split(reference: str) -> tuple[Path, str] | None:
    """The file and the name in FILE.py:NAME; None for what is of another form.

    Raises `Refusal` if there is no such file.
    """
    path, colon, name = reference.rpartition(":")
    file = Path(path)
    if not colon or file.suffix != ".py" or not name.isidentifier():
        return None
    if not files.exists(file):
        raise Refusal(f"there is no file {file}; check the path")
    return file, name


def split_module(reference: str) -> tuple[str, str] | None:
    """The module and the name in package.module:NAME; None for what is of another form.

    Raises `Refusal` if no such package is installed or lies in this folder.
    """
    module, colon, name = reference.rpartition(":")
    parts = module.split(".")
    if not colon or not all(part.isidentifier() for part in (*parts, name)):
        return None
    _look_here()
    if parts[0] not in sys.modules and find_spec(parts[0]) is None:
        raise Refusal(f"no package is called {parts[0]}; install it, or call skydog in its folder")
    return module, name


def load(reference: str) -> Any:
    """What FILE.py:NAME or package.module:NAME names; the file or the module is run.

    Raises `Refusal` for what is not there or fails.
    """
    if (in_file := split(reference)) is not None:
        (file, name), module = in_file, run(in_file[0].resolve())
        where = str(file)
    elif (in_module := split_module(reference)) is not None:
        where, name = in_module
        module = _imported(where)
    else:
        raise Refusal(f"code is named {FORMS}, got {reference!r:.100}; try my_dog.py:dog")
    found = getattr(module, name, None)
    if found is None:
        raise Refusal(f"{where} has no {name!r}; {_offered(module)}")
    return found


@cache
def run(file: Path) -> ModuleType:
    """The module of a file, which is run once a process. Raises `Refusal` if it fails.

    Two runs would define two classes of each law, which jax tells apart.
    """
    name = f"skydog_world_{file.stem}"  # which no file beside it has
    spec = spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # files beside it can be imported, after all libraries
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as problem:
        del sys.modules[name]
        if isinstance(problem, Refusal):
            raise
        raise failed(str(file), file, problem) from problem
    return module


def made(found: Any, reference: str, *given: Any) -> Callable[..., Any]:
    """What can be called with `given`: what was found, or what it makes when called without.

    Raises `Refusal` for what is neither.
    """
    if not inspect.isclass(found) and _takes(found, *given):
        return found
    if not _takes(found):
        raise Refusal(f"{reference} cannot be called with {len(given)} arguments, nor with none")
    try:
        thing: Any = found()
    except Refusal:
        raise
    except Exception as problem:
        raise failed(reference, _file(found), problem) from problem
    if not _takes(thing, *given):
        raise Refusal(f"{reference} made {thing!r:.60}, not a function of {len(given)} arguments")
    return thing


def name_of(function: Any) -> str | None:
    """The package.module:NAME by which a function can be found again; None if it cannot."""
    module, name = getattr(function, "__module__", None), getattr(function, "__qualname__", "")
    if not module or module == "__main__" or not name.isidentifier():
        return None
    return f"{module}:{name}" if getattr(sys.modules.get(module), name, None) is function else None


def failed(what: str, file: Path | None, problem: BaseException) -> Refusal:
    """A refusal that says how code of a user failed, and in which line of its file."""
    frames = traceback.extract_tb(problem.__traceback__)
    there = None if file is None else file.resolve()
    lines = [frame.lineno for frame in frames if Path(frame.filename) == there]
    at = f" in line {lines[-1]}" if lines else ""
    said = str(problem).strip().split("\n")[0]
    return Refusal(f"{what} failed{at}: {type(problem).__name__}: {said:.200}")


def _imported(module: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except Refusal:
        raise
    except (Exception, SystemExit) as problem:
        raise failed(module, None, problem) from problem


def _look_here() -> None:
    """A package in this folder can be named too, after all that are installed."""
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())


def _offered(module: ModuleType) -> str:
    own = [
        name
        for name, value in vars(module).items()
        if callable(value) and getattr(value, "__module__", None) == module.__name__
    ]
    return f"it has {', '.join(own)}" if own else "it has no function and no class"


def _takes(found: Any, *given: Any) -> bool:
    try:
        inspect.signature(found).bind(*given)
    except TypeError:
        return False
    except ValueError:  # built in, without a signature
        return callable(found)
    return True


def _file(found: Any) -> Path | None:
    try:
        return Path(inspect.getfile(found))
    except TypeError:
        return None

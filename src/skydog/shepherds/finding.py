"""What a shepherd's name means. Free to import, so that a mistyped name costs no time."""

import ast
from pathlib import Path
from typing import Literal

from skydog import files, references
from skydog.errors import Refusal

FILE = "sheepdog.safetensors"
ZOO = Path(__file__).parent / "zoo"
# See `skydog.shepherds.rules`.
RULES = ("strombom", "strombom-arrive", "elfiqi", "arc", "rearmost", "team", "lama", "ring")
TEAM = "team:"  # before a sheepdog's name: a team whose dogs fly with its skills
SAVED = "policy:"  # before the file of a policy that was saved: what it names is run
# Of Stable-Baselines3, those whose actions are numbers. Before a zip: what it pickles is run.
ALGORITHMS = ("a2c", "ddpg", "ppo", "sac", "td3")
OTHERS = (
    f"a shepherd is also a rule ({', '.join(RULES)}), a run folder or file, team:SHEEPDOG, "
    "FILE.py:NAME, package.module:NAME, FILE.onnx, or ppo:FILE.zip of Stable-Baselines3"
)

Kind = Literal["rule", "team", "saved", "zip", "onnx", "code", "sheepdog"]
"""What a shepherd can be: see `OTHERS`."""


def kind(name: str) -> Kind:
    """What kind of shepherd a name means; whether there is such a one, `check` tells."""
    head, colon, tail = name.partition(":")
    if name in RULES:
        return "rule"
    if name.startswith(TEAM):
        return "team"
    if name.startswith(SAVED):
        return "saved"
    if colon and (head in ALGORITHMS or tail.endswith(".zip")):
        return "zip"
    if name.endswith(".onnx"):
        return "onnx"
    where, colon, last = name.rpartition(":")
    module = all(part.isidentifier() for part in (*where.split("."), last))
    return "code" if colon and (module or where.endswith(".py")) else "sheepdog"


def check(name: str) -> None:
    """Raise `Refusal` for a shepherd that there is not. Runs no code of others."""
    which = kind(name)
    if not name.partition(":")[2 if which in ("team", "saved") else 0]:
        raise Refusal(f"{name!r} names no shepherd; {OTHERS}")
    if which in ("team", "saved"):
        find(Path(name.partition(":")[2]))
    elif which == "zip":
        _check_zip(*name.split(":", 1))
    elif which == "onnx":
        _there(Path(name))
    elif which == "code":
        if references.split(name) is None and references.split_module(name) is None:
            raise Refusal(f"code is named {references.FORMS}, got {name!r:.100}")
    elif which == "sheepdog":
        _check_sheepdog(Path(name))


def title(name: str) -> str:
    """What a shepherd is called in tables: the name in its code, or its name without a folder."""
    which = kind(name)
    if which == "code":
        return name.rpartition(":")[2]
    if which in ("zip", "saved"):
        head, _, tail = name.partition(":")
        return f"{head}-{Path(tail).stem}"
    return Path(name).stem if which == "onnx" else name


def anywhere(name: str) -> str:
    """The same name for every working folder: its file by the whole path."""
    which = kind(name)
    head, colon, tail = name.partition(":") if which in ("team", "saved", "zip") else ("", "", name)
    if which == "code":
        in_file = references.split(name)
        return name if in_file is None else f"{in_file[0].absolute()}:{in_file[1]}"
    named = which == "rule" or not files.exists(Path(tail))
    return name if named else f"{head}{colon}{Path(tail).absolute()}"


def ships() -> list[str]:
    """The names of the sheepdogs in the zoo, which come with the package."""
    return sorted(path.stem for path in ZOO.glob("*.safetensors"))


def find(path: Path) -> Path:
    """The file of a sheepdog that is named by its name in the zoo, its file or its run folder.

    Raises `Refusal` if there is none.
    """
    if not files.exists(path) and _plain(path):
        if path.name.lower() in ships():
            return ZOO / f"{path.name.lower()}.safetensors"
        raise Refusal(
            f"no sheepdog is called {path}, and no file or folder; those that ship are "
            + ", ".join(ships())
        )
    _there(path)
    if not files.is_folder(path):
        return path
    if files.exists(path / FILE):
        return path / FILE
    runs = sorted(run.parent.name for run in files.listed(path, f"*/{FILE}"))
    if runs:
        raise Refusal(f"{path} holds {len(runs)} sheepdogs; name one, such as {path / runs[0]}")
    raise Refusal(f"{path} holds no {FILE}; name a run folder of skydog herd or skydog train")


def _check_sheepdog(path: Path) -> None:
    try:
        find(path)
    except Refusal as refusal:
        if not _plain(path) or files.exists(path):
            raise
        raise Refusal(f"{refusal}; {OTHERS}") from None
    if path.suffix == ".py":
        raise Refusal(f"{path} is code: name what is in it, such as {path}:{_first(path)}")
    if path.suffix == ".zip":
        raise Refusal(f"a zip is named with its algorithm ({', '.join(ALGORITHMS)}): ppo:{path}")


def _check_zip(algorithm: str, path: str) -> None:
    if algorithm.lower() in ALGORITHMS and algorithm not in ALGORITHMS:
        raise Refusal(f"no algorithm is called {algorithm}; try {algorithm.lower()}:{path}")
    if algorithm not in ALGORITHMS:
        raise Refusal(
            f"a dog's action is two numbers, which {algorithm!r:.20} does not learn or skydog does "
            f"not know; a zip is of {', '.join(ALGORITHMS)}"
        )
    _there(Path(path))


def _there(path: Path) -> None:
    if not files.exists(path):
        raise Refusal(f"cannot read {path}: there is no such file; check the path")


def _plain(path: Path) -> bool:
    """Whether a path looks like a name."""
    return path.parent == Path() and not path.suffix


def _first(file: Path) -> str:
    """The first function or class of a Python file, which is not run; NAME if there is none."""
    try:
        tree = ast.parse(files.read_bytes(file, "Python file", 1 << 24))
    except (SyntaxError, ValueError, RecursionError):
        return "NAME"
    named = [node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    return next((name for name in named if name != "main"), "NAME")

"""Files that are never half written, and are read with bounds and never executed.

Arrays travel as safetensors with one JSON card in its header: a format without code in it,
that other tools read.
"""

import json
import math
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from skydog.errors import Refusal

CARD = "skydog"  # the header's key for the card
LARGEST_FILE = 1 << 30  # bytes; a checkpoint of eight full memories fits


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: a reader sees the old one or the new one.

    Raises `Refusal` if the folder cannot be written.
    """
    path = Path(path)
    folder(path.parent)
    try:
        handle, partial = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as problem:
        raise Refusal(f"cannot write {path}: {problem.strerror}; choose another folder") from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(partial, 0o644)
        os.replace(partial, path)
    except OSError as problem:
        raise Refusal(f"cannot write {path}: {problem.strerror}; choose another folder") from None
    finally:
        Path(partial).unlink(missing_ok=True)


def write_text(path: Path, content: str) -> None:
    """`write_bytes` for text, in UTF-8."""
    write_bytes(path, content.encode())


def folder(path: Path) -> Path:
    """The folder, made if need be. Raises `Refusal` if it cannot be written."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise Refusal(
            f"cannot write to {path}: {problem.strerror}; choose another folder"
        ) from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise Refusal(f"cannot write to {path}: permission denied; choose another folder")
    return path


def save_arrays(path: Path, arrays: dict[str, np.ndarray], card: dict[str, Any]) -> None:
    """Write named arrays and their card as one safetensors file."""
    packed = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    write_bytes(path, save(packed, metadata={CARD: json.dumps(card, allow_nan=False)}))


def load_arrays(
    path: Path, kind: str, largest: int = LARGEST_FILE
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read what `save_arrays` wrote, if its card says that it is a `kind`.

    Raises `Refusal` for a file that is missing, damaged, larger than `largest` bytes,
    foreign, of another kind, or that holds a number which is not finite.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise Refusal(f"{path} is a folder; name a file in it")
        if not path.is_file():
            raise Refusal(f"{path} is no regular file; name another")
        if size > largest:
            raise Refusal(f"{path} has {size:,} bytes, more than any {kind} ({largest:,})")
        content = path.read_bytes()
    except Refusal:
        raise
    except (OSError, ValueError) as problem:
        why = getattr(problem, "strerror", None) or problem
        raise Refusal(f"cannot read {path}: {why}; check the path") from None
    try:
        header = int.from_bytes(content[:8], "little")
        card = json.loads(
            json.loads(content[8 : 8 + header])["__metadata__"][CARD], parse_constant=_no_constant
        )
        arrays = load(content)
    except (SafetensorError, ValueError, KeyError, TypeError, RecursionError):
        raise Refusal(f"{path} is damaged or no {kind} of skydog; make it again") from None
    if not isinstance(card, dict) or card.get("kind") != kind:
        raise Refusal(f"{path} is no {kind} of skydog, its card says {_kind(card)!r}")
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.all(np.isfinite(array)):
            raise Refusal(f"{path} is damaged: {name} holds a number that is not finite")
    return arrays, card


def plain(value: Any) -> Any:
    """A tree of values as JSON would give it back: lists for tuples, text for keys.

    A number that is not finite becomes None, since JSON has none.
    """
    if isinstance(value, dict):
        return {str(name): plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _kind(card: Any) -> Any:
    return card.get("kind") if isinstance(card, dict) else card

"""Named arrays and a card as one file, which is never executed.

The format is safetensors, with one JSON card in its header: there is no code in it, and other
tools read it.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors import numpy as safetensors

from skydog import files
from skydog.errors import Refusal

CARD = "skydog"  # the header's key for the card


def save_arrays(path: Path, arrays: dict[str, np.ndarray], card: dict[str, Any]) -> None:
    """Write named arrays and their card as one safetensors file."""
    packed = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    files.write_bytes(
        path, safetensors.save(packed, metadata={CARD: json.dumps(card, allow_nan=False)})
    )


def load_arrays(
    path: Path, kind: str, largest: int = files.LARGEST_FILE
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read what `save_arrays` wrote, if its card says that it is a `kind`.

    Raises `Refusal` for a file that is missing, damaged, larger than `largest` bytes,
    foreign, of another kind, or that holds a number which is not finite.
    """
    content = files.read_bytes(path, kind, largest)
    try:
        header = int.from_bytes(content[:8], "little")
        card = json.loads(
            json.loads(content[8 : 8 + header])["__metadata__"][CARD], parse_constant=_no_constant
        )
        arrays = safetensors.load(content)
    except (SafetensorError, ValueError, KeyError, TypeError, RecursionError):
        raise _damaged(path, kind) from None
    _check(path, kind, card)
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.all(np.isfinite(array)):
            raise Refusal(f"{path} is damaged: {name} holds a number that is not finite")
    return arrays, card


def load_some(path: Path, kind: str, *names: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The card of what `save_arrays` wrote, and arrays by name; the others are not read.

    Raises `Refusal` for what is damaged, foreign, or of another kind.
    """
    try:
        with safe_open(path, framework="numpy") as file:
            card = json.loads(file.metadata()[CARD], parse_constant=_no_constant)
            arrays = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, RecursionError):
        raise _damaged(path, kind) from None
    _check(path, kind, card)
    return arrays, card


def kind_of(path: Path) -> str | None:
    """What the card of a file says that it is; None for a file that has no card."""
    try:
        with safe_open(path, framework="numpy") as file:
            return str(json.loads(file.metadata()[CARD])["kind"])
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _damaged(path: Path, kind: str) -> Refusal:
    return Refusal(f"{path} is damaged or no {kind} of skydog; make it again")


def _check(path: Path, kind: str, card: Any) -> None:
    found = card.get("kind") if isinstance(card, dict) else card
    if not isinstance(card, dict) or found != kind:
        raise Refusal(f"{path} is no {kind} of skydog, its card says {found!r}")

"""The shepherds that follow rules, by name; whatever else has a name is a trained sheepdog."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from skydog.shepherds import store
from skydog.shepherds.arc import Arc
from skydog.shepherds.elfiqi import ElFiqi
from skydog.shepherds.rearmost import Rearmost
from skydog.shepherds.strombom import Strombom
from skydog.world.mission import Shepherd

RULES: dict[str, Callable[[], Shepherd]] = {
    "strombom": Strombom,
    "strombom-arrive": lambda: Strombom(at_point="arrive"),
    "elfiqi": ElFiqi,
    "arc": Arc,
    "rearmost": Rearmost,
}
"""By the names in `finding.RULES`."""


def read(name: str | Path) -> tuple[Shepherd, dict[str, Any]]:
    """A shepherd by its name, and its card, which is empty for a rule.

    A name that no rule has is read by `store.read`. Raises `Refusal` as that does.
    """
    if (rule := RULES.get(str(name))) is not None:
        return rule(), {}
    return store.read(name)

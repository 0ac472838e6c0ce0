"""The shepherds that learn nothing, by their names."""

from typing import Any

from skydog.shepherds import store
from skydog.shepherds.lama import Lama
from skydog.shepherds.ring import Ring
from skydog.shepherds.strombom import Strombom
from skydog.world.mission import Shepherd

RULES: dict[str, Shepherd] = {
    "strombom": Strombom(),
    "strombom-arrive": Strombom(at_point="arrive"),
    "lama": Lama(),
    "ring": Ring(),
}
"""By the names of `finding.RULES`."""


def read(name: str) -> tuple[Shepherd, dict[str, Any]]:
    """A rule, or a sheepdog and its card (`store.read`); a rule's card is empty.

    Raises `Refusal` as `store.read` does.
    """
    return (RULES[name], {}) if name in RULES else store.read(name)

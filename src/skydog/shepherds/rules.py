"""The shepherds that follow rules, by name; whatever else has a name is a trained sheepdog."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from skydog.shepherds import finding, store
from skydog.shepherds.arc import Arc
from skydog.shepherds.elfiqi import ElFiqi
from skydog.shepherds.lama import Lama
from skydog.shepherds.rearmost import Rearmost
from skydog.shepherds.ring import Ring
from skydog.shepherds.strombom import Strombom
from skydog.shepherds.team import Team
from skydog.world.mission import Shepherd

RULES: dict[str, Callable[[], Shepherd]] = {
    "strombom": Strombom,
    "strombom-arrive": lambda: Strombom(at_point="arrive"),
    "elfiqi": ElFiqi,
    "arc": Arc,
    "rearmost": Rearmost,
    "team": Team,
    "lama": Lama,
    "ring": Ring,
}
"""By the names in `finding.RULES`."""


def read(name: str | Path) -> tuple[Shepherd, dict[str, Any]]:
    """A shepherd by its name, and its card, which is empty for a rule.

    A name that no rule has is read by `store.read`; `team:NAME` is a `Team` with the skills of that
    sheepdog. Raises `Refusal` as `store.read` does.
    """
    called = str(name)
    if (rule := RULES.get(called)) is not None:
        return rule(), {}
    if not called.startswith(finding.TEAM):
        return store.read(name)
    dog, card = store.read(called.removeprefix(finding.TEAM))
    return Team(skill=dog), card

"""Aerial shepherding: a drone herds a swarm of ground robots, as a sheepdog herds sheep.

import jax, skydog

world = skydog.preset("paper", arena=4.0)
state = skydog.reset(world, jax.random.key(0))
trace = skydog.rollout(world, skydog.Strombom(), state)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skydog.errors import Refusal as Refusal
    from skydog.shepherds.foreign import from_policy as from_policy
    from skydog.shepherds.named import load as load
    from skydog.shepherds.sheepdog import Sheepdog as Sheepdog
    from skydog.shepherds.strombom import Strombom as Strombom
    from skydog.study.compare import compare as compare
    from skydog.world.laws import Flock as Flock
    from skydog.world.mission import Decision as Decision
    from skydog.world.mission import Fly as Fly
    from skydog.world.mission import Shepherd as Shepherd
    from skydog.world.mission import accomplished as accomplished
    from skydog.world.mission import decide as decide
    from skydog.world.mission import move as move
    from skydog.world.mission import reset as reset
    from skydog.world.mission import rollout as rollout
    from skydog.world.mission import step as step
    from skydog.world.params import World as World
    from skydog.world.presets import preset as preset
    from skydog.world.state import State as State
    from skydog.world.state import start as start
    from skydog.world.trace import Trace as Trace

__version__ = "0.1.0"

# Imported when first asked for, so that `skydog --help` need not wait for jax.
_HOMES = {
    "Refusal": "skydog.errors",
    "Sheepdog": "skydog.shepherds.sheepdog",
    "from_policy": "skydog.shepherds.foreign",
    "load": "skydog.shepherds.named",
    "compare": "skydog.study.compare",
    "Strombom": "skydog.shepherds.strombom",
    "Flock": "skydog.world.laws",
    "Decision": "skydog.world.mission",
    "Fly": "skydog.world.mission",
    "Shepherd": "skydog.world.mission",
    "accomplished": "skydog.world.mission",
    "decide": "skydog.world.mission",
    "move": "skydog.world.mission",
    "reset": "skydog.world.mission",
    "rollout": "skydog.world.mission",
    "step": "skydog.world.mission",
    "World": "skydog.world.params",
    "preset": "skydog.world.presets",
    "State": "skydog.world.state",
    "start": "skydog.world.state",
    "Trace": "skydog.world.trace",
}
__all__ = ["__version__", *_HOMES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'skydog' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return list(__all__)

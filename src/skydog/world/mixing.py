"""Mixed flocks: some of the sheep are of another kind, such as stubborn or alone."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any

import numpy as np

from skydog import quantities
from skydog.errors import Refusal, short
from skydog.world.laws.paper import PaperFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.laws.varied import VariedFlock
from skydog.world.params import World


@dataclass(frozen=True)
class Kind:
    """What a kind of sheep has of its own: parameters of the flock's law, or its body's speed."""

    values: Mapping[str, float]
    # Times what the world's own sheep have: lengths and speeds fit worlds of any size so.
    shares: Mapping[str, float]


KINDS: dict[str, Kind] = {
    "stubborn": Kind({}, {"escape": 0.1}),  # ours: hardly flees
    "short-sighted": Kind({}, {"sensing": 10 / 65}),  # ours: 10 m of Strömbom 2014's 65 m
    "loner": Kind({"grouping": 0.0}, {}),  # ours: flees, but does not group
    "noisy": Kind({"noise": 1.0}, {}),  # Strömbom et al. 2014 have 0.3
    # Strömbom et al. 2026 (ANTS): comes to the dog, does not flee and does not group.
    "follower": Kind({"follow": 1.0, "escape": 0.0, "grouping": 0.0}, {}),
    "slow": Kind({}, {"speed": 0.5}),  # ours
}
"""By the names in `options.KIND_NAMES`."""

Mix = Mapping[str, Any]
"""The share of the flock that is of each kind, by name."""


def mixed(world: World, sheep: int, mix: Mix) -> World:
    """The world in which a share of its `sheep` sheep is of each kind.

    Shares are rounded to whole sheep. The last sheep are of the first kind, those before them of
    the next, so that it is known which is which. Raises `Refusal` for an unknown kind, a share
    that is not from 0 to 1, shares of more sheep than there are, and a law without the parameter.
    """
    free = sheep
    for name, share in mix.items():
        if not isinstance(name, str) or name not in KINDS:
            raise Refusal(
                f"no kind of sheep is called {short(name)}; choose from {', '.join(KINDS)}"
            )
        count = round(quantities.SHARE.checked(share) * sheep)
        if count > free:
            raise Refusal(
                f"the shares {written(mix)} are of more than all {sheep} sheep; "
                "give shares that add up to 1 at most"
            )
        which = np.arange(sheep)
        which = (free - count <= which) & (which < free)
        if count:
            world = _with(world, name, which)
        free -= count
    return world


def written(mix: Mix) -> str:
    """A mix as the command line has it: loner=0.2,noisy=0.1."""
    return ",".join(f"{name}={share:g}" for name, share in mix.items())


def maker(make: Any, mix: Mix) -> Any:
    """The function that makes a world, of `arena` and `sheep`, with its flock mixed."""

    @wraps(make)
    def made(**asked: Any) -> World:
        return mixed(make(**asked), asked["sheep"], mix)

    return made


def _with(world: World, name: str, which: np.ndarray) -> World:
    kind, flock, own = KINDS[name], world.flock, {}
    if "follow" in kind.values and not isinstance(flock, VariedFlock):
        flock = _varied(flock, name)
    for parameter in (*kind.values, *kind.shares):
        body = world.sheep if parameter == "speed" else flock
        if not hasattr(body, parameter):
            raise Refusal(
                f"sheep of {type(flock).__name__} cannot be {name}: the law has no {parameter}; "
                "try --preset strombom2014"
            )
        before = getattr(body, parameter)
        before = np.broadcast_to(np.asarray(0.0 if before is None else before), which.shape)
        after = kind.values.get(parameter, kind.shares.get(parameter, 1.0) * before)
        own[parameter] = np.where(which, after, before).astype(np.float32)
    if "speed" in own:
        world = replace(world, sheep=replace(world.sheep, speed=own.pop("speed")))
    return replace(world, flock=replace(flock, **own))


def _varied(flock: Any, name: str) -> VariedFlock:
    """The law with the terms of other kinds, all off: `VariedFlock`, which else moves alike."""
    if not isinstance(flock, PaperFlock | StrombomFlock):
        raise Refusal(
            f"sheep of {type(flock).__name__} cannot be {name}; try --preset strombom2014"
        )
    return VariedFlock(**vars(flock))

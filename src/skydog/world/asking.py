"""What a shepherd is asked, and what is said of one that cannot be compiled."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from skydog.errors import Refusal
from skydog.world.params import World
from skydog.world.state import State


def velocity(shepherd: Callable[[World, State], Any], world: World, seen: State) -> Any:
    """What the shepherd gives, which nobody has checked yet.

    Raises `Refusal` for one that asks for numbers of what is traced, as other libraries do.
    """
    try:
        return shepherd(world, seen)
    except Refusal:
        raise
    except Exception as problem:
        if "Tracer" not in f"{type(problem).__name__} {problem}":
            raise
        called = getattr(shepherd, "__name__", type(shepherd).__name__)
        raise Refusal(
            f"the shepherd {called} cannot be compiled ({type(problem).__name__}): it needs "
            "jax.numpy, and jnp.where in place of if; a policy of another library needs "
            "skydog.from_policy(predict)"
        ) from problem


@contextmanager
def heard() -> Iterator[None]:
    """A `Refusal` of a function that jax has called is that `Refusal` again."""
    try:
        yield
    except RuntimeError as problem:  # in whose text jax quotes it
        said = re.search(r"^(?:skydog\.errors\.)?Refusal: (.*)$", str(problem), re.M)
        if said is None:
            raise
        raise Refusal(said[1]) from problem

"""What every learner does with its weights: gradient steps, and soft updates of targets."""

from typing import Any, TypeVar

import jax
import optax
from jaxtyping import Array, Float

Tree = TypeVar("Tree")


def soft_update(old: Tree, new: Tree, share: float | Float[Array, ""]) -> Tree:
    """The weights `old`, moved by a share of the way to `new` (paper, "soft replacement")."""
    return jax.tree.map(lambda was, now: was + share * (now - was), old, new)


def adam(rate: float) -> Any:  # optax's own types know nothing of modules
    """The optimiser Adam (paper, "Deep neural network structure") of a learning rate."""
    return optax.adam(rate)

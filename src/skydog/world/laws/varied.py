"""Sheep of many kinds: Strömbom's, with terms of other sources that each sheep may have."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.world.laws import terms
from skydog.world.laws.strombom import StrombomFlock, normalised_sum, weighted_sum
from skydog.world.state import State
from skydog.world.vectors import PerSheep, column, unit


class VariedFlock(StrombomFlock):
    """`StrombomFlock` with more terms, each off while its parameter is None.

    With all of them off it is `StrombomFlock`, bit for bit, and so `PaperFlock` where there is
    no noise. The terms act on sheep that see a dog.
    """

    # From -1, which flees twice as hard as escape 1 alone, to 1, which outweighs it. A follower
    # of Strömbom et al. 2026 has follow 1, escape 0 and grouping 0.
    follow: PerSheep | None = None  # weight of the pull to dogs
    # Jadhav et al. 2024: 1.3 beside inertia 0.5, grouping 1.5, escape 1 and repulsion 2.
    alignment: PerSheep | None = None  # weight of the mean direction of the `neighbours`
    # μ: pushes fade as exp(-μ d / R), and are not normalised (El-Fiqi et al. 2020: 2).
    fading: PerSheep | None = None

    def total(self, state: State) -> tuple[Float[Array, "sheep 2"], Bool[Array, "sheep 1"]]:
        """The sum of the terms without noise, and which sheep anything disturbs."""
        sheep, dogs, count = state.sheep, state.dogs, len(state.sheep)
        if self.fading is None:
            total, disturbed = normalised_sum(self, state, self.neighbours)
        else:
            flee = terms.fading_escape(sheep, dogs, self.sensing, self.fading)
            crowd = terms.fading_avoid(sheep, self.avoidance, self.fading)
            total, disturbed = weighted_sum(self, state, self.neighbours, flee, crowd)
        afraid = jnp.any(terms.sees(sheep, dogs, self.sensing), axis=1, keepdims=True)
        if self.follow is not None:
            pull = unit(terms.follow(sheep, dogs, self.sensing))
            total = total + jnp.where(afraid, column(self.follow, count) * pull, 0.0)
        if self.alignment is not None:
            mean = terms.align(sheep, state.force, self.neighbours)
            total = total + jnp.where(afraid, column(self.alignment, count) * mean, 0.0)
        return total, disturbed

"""The sheep of Strömbom et al. 2014: normalised terms, noise, grazing."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from skydog.world.laws import terms
from skydog.world.laws.terms import Weighted
from skydog.world.state import State
from skydog.world.vectors import PerSheep, column, unit


class StrombomFlock(Weighted):
    """Strömbom et al. 2014 (J. R. Soc. Interface 11).

    In its letters: avoidance r_a, sensing r_s, inertia h, grouping c, escape ρ_s, repulsion
    ρ_a, noise e.
    """

    graze: PerSheep = 0.0  # p: chance per step that a sheep which nothing disturbs moves at random
    # n: the local centre of mass is that of the n nearest flockmates; None is all of them.
    neighbours: int | None = eqx.field(static=True, default=None)

    @property
    def noisy(self) -> bool:
        """Whether the law draws random numbers."""
        return bool(np.any(self.noise) or np.any(self.graze))

    def force(self, state: State, key: PRNGKeyArray | None) -> Float[Array, "sheep 2"]:
        """The normalised sum of normalised terms; a sheep that nothing disturbs may graze."""
        total, disturbed = self.total(state)
        if key is None:
            return unit(jnp.where(disturbed, total, 0.0))
        sheep, count = state.sheep, len(state.sheep)
        for_noise, for_grazing, for_direction = jax.random.split(key, 3)
        total = total + column(self.noise, count) * terms.random_directions(for_noise, sheep)
        grazes = jax.random.bernoulli(for_grazing, column(self.graze, count), (count, 1))
        idle = jnp.where(grazes, terms.random_directions(for_direction, sheep), 0.0)
        return unit(jnp.where(disturbed, total, idle))

    def total(self, state: State) -> tuple[Float[Array, "sheep 2"], Bool[Array, "sheep 1"]]:
        """The sum of the terms without noise, and which sheep anything disturbs."""
        return normalised_sum(self, state, self.neighbours)


def normalised_sum(
    flock: Weighted, state: State, neighbours: int | None = None
) -> tuple[Float[Array, "sheep 2"], Bool[Array, "sheep 1"]]:
    """The weighted sum of the normalised terms, and which sheep anything disturbs.

    Grouping and escape act on sheep that see a dog. A sheep that sees none and that no other
    pushes is not disturbed: inertia alone does not carry it.
    """
    flee = unit(terms.escape(state.sheep, state.dogs, flock.sensing))
    crowd = unit(terms.avoid(state.sheep, flock.avoidance))
    return weighted_sum(flock, state, neighbours, flee, crowd)


def weighted_sum(
    flock: Weighted,
    state: State,
    neighbours: int | None,
    flee: Float[Array, "sheep 2"],
    crowd: Float[Array, "sheep 2"],
) -> tuple[Float[Array, "sheep 2"], Bool[Array, "sheep 1"]]:
    """`normalised_sum`, with the pushes of dogs and of other sheep as they are given."""
    sheep, dogs, count = state.sheep, state.dogs, len(state.sheep)
    pull = terms.group(sheep, neighbours)
    afraid = jnp.any(terms.sees(sheep, dogs, flock.sensing), axis=1, keepdims=True)
    crowded = jnp.any(crowd != 0.0, axis=1, keepdims=True)
    total = column(flock.inertia, count) * state.force
    total = total + column(flock.repulsion, count) * crowd
    fear = column(flock.grouping, count) * pull + column(flock.escape, count) * flee
    return total + jnp.where(afraid, fear, 0.0), afraid | crowded

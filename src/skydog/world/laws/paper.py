"""The paper's sheep, as we read its Eq. 6: each term and the sum are normalised."""

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from skydog.world.laws import terms
from skydog.world.laws.strombom import normalised_sum
from skydog.world.laws.terms import Weighted
from skydog.world.state import State
from skydog.world.vectors import column, unit


class PaperFlock(Weighted):
    """Nguyen et al. 2020, Eqs 1 to 6, the terms and their sum normalised as in Strömbom 2014.

    A sheep moves at its full speed or stands still.
    """

    def force(self, state: State, key: PRNGKeyArray | None) -> Float[Array, "sheep 2"]:
        """The normalised sum of normalised terms (Eq. 6); a sheep that nothing disturbs stands."""
        total, disturbed = normalised_sum(self, state)
        if key is not None:
            random = terms.random_directions(key, state.sheep)
            total = total + column(self.noise, len(state.sheep)) * random
        return unit(jnp.where(disturbed, total, 0.0))

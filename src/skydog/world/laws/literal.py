"""The paper's sheep, with its Eq. 6 as printed: the sums are not normalised."""

from jaxtyping import Array, Float, PRNGKeyArray

from skydog.world.laws import terms
from skydog.world.laws.terms import Weighted
from skydog.world.state import State
from skydog.world.vectors import column


class LiteralFlock(Weighted):
    """Nguyen et al. 2020, Eqs 1 to 6 as printed.

    Forces add up, so that a crowded sheep moves faster; sheep group without a dog in sight.
    """

    def force(self, state: State, key: PRNGKeyArray | None) -> Float[Array, "sheep 2"]:
        """The weighted sum of the terms (Eq. 6)."""
        sheep, count = state.sheep, len(state.sheep)
        flee = terms.escape(sheep, state.dogs, self.sensing)
        crowd = terms.avoid(sheep, self.avoidance)
        pull = terms.group(sheep, None)
        total = column(self.inertia, count) * state.force + column(self.grouping, count) * pull
        total = total + column(self.escape, count) * flee + column(self.repulsion, count) * crowd
        if key is None:
            return total
        return total + column(self.noise, count) * terms.random_directions(key, sheep)

"""A rule dog of our own that needs no flock: it drives sheep one by one, the rearmost first."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.world import herding
from skydog.world.mission import fastest, limited
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm, unit


class Rearmost(eqx.Module):
    """Flies behind the sheep with the longest way home, and drives it straight home.

    The gate of the paper waits for the flock to gather, which sheep that do not group never do,
    and fetches a stray to the flock's centre, which drives those on the other side away. This dog
    has no gate. Of the sheep outside `home` times the goal's radius it takes the one with the
    greatest (metres to the goal - `nearness` * metres to the dog). Its place is `behind` times
    f(N) behind that sheep, seen from the goal: from so far away it pushes all sheep nearly the same
    way, home. If the sheep stood still in the last step, it sees no dog: then the dog flies to it,
    and keeps the distance at which it moves.

    Several dogs choose without looking at each other. The numbers were tuned on starts that
    `skydog.study.mixed` does not have; a trace records the world's own gate beside this flight.
    """

    behind: Scalar = 3 / 2
    nearness: Scalar = 1 / 2
    home: Scalar = 4 / 5

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        sheep, goal = state.sheep, herding.goal(world.arena)
        away = norm(sheep - goal)
        out = away > self.home * world.arena.goal_radius
        rank = away - self.nearness * norm(state.dogs[:, None] - sheep[None, :])
        taken = jnp.argmax(jnp.where(out | ~jnp.any(out), rank, -jnp.inf), axis=1)
        outwards = unit(sheep[taken] - goal)
        far = self.behind * herding.gathered_radius(world, len(sheep))
        now = jnp.sum((state.dogs - sheep[taken]) * outwards, axis=1)  # how far behind it is
        distance = jnp.where(now > 0.0, jnp.minimum(now, far), far)
        stands = jnp.all(state.force[taken] == 0.0, axis=1)
        place = sheep[taken] + jnp.where(stands, 0.0, distance)[:, None] * outwards
        return limited(world.dog, fastest(world.dog, place - state.dogs))

"""Dogs that guard a ring around the herd, and fetch what is outside: one shared rule."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.world import herding
from skydog.world.mission import limited
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm, unit


class Ring(eqx.Module):
    """Our rule for sheep that do not hold together: any number of dogs, no messages but positions.

    A sheep belongs to the dog nearest to it, as in Lama & di Bernardo 2024. Of its sheep further
    than `outside` from the goal, a dog fetches the one with the greatest (`far` times the distance
    to the goal - the distance to the dog), from the side away from the goal. A dog without such a
    sheep guards: it keeps to a circle around the goal, in the middle between its neighbours.
    `benchmarks/herders.py --seed 1 --generations 40` found the numbers but `spacing`.
    """

    outside: Scalar = 3.06  # metres from the goal: sheep further out are fetched
    far: Scalar = 1.02  # how much the distance to the goal counts in the choice of a sheep
    offset: Scalar = 0.48  # metres: a dog pushes from so far behind the sheep
    lift: Scalar = 0.347  # further behind by this share of what it is aside of the line to the goal
    swing: Scalar = 0.815  # metres aside, while the dog is on the goal's side of the sheep
    guard: Scalar = 2.99  # metres: the radius of the circle
    spacing: Scalar = 3.0  # 1/s: how fast guards even out the gaps between them
    gain: Scalar = 27.3  # 1/s: the speed by the distance to where the dog is going

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        goal = herding.goal(world.arena)
        sheep, dogs = state.sheep - goal, state.dogs - goal
        stray, strays = self._choose(sheep, dogs)
        fetch = self.gain * (self._behind(stray, dogs) - dogs)
        return limited(world.dog, jnp.where(strays[:, None], fetch, self._stand(dogs)))

    def _choose(
        self, sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]
    ) -> tuple[Float[Array, "dogs 2"], Bool[Array, " dogs"]]:
        """The sheep that each dog fetches, and whether there is one."""
        distance, to_sheep = norm(sheep), norm(dogs[:, None] - sheep[None, :])
        own = (to_sheep <= jnp.min(to_sheep, axis=0)) & (distance > self.outside)
        rank, chosen = jax.lax.top_k(jnp.where(own, self.far * distance - to_sheep, -jnp.inf), 1)
        return sheep[chosen[:, 0]], jnp.isfinite(rank[:, 0])

    def _behind(
        self, stray: Float[Array, "dogs 2"], dogs: Float[Array, "dogs 2"]
    ) -> Float[Array, "dogs 2"]:
        """Where each dog flies to get behind its stray, around it if need be."""
        out = unit(stray)
        aside = jnp.stack([-out[:, 1], out[:, 0]], axis=1)
        from_stray = dogs - stray
        beside = jnp.sum(from_stray * aside, axis=1)
        behind = jnp.sum(unit(from_stray) * out, axis=1)  # 1 is right behind it, -1 before it
        back = self.offset + self.lift * jnp.abs(beside)
        around = self.swing * (1.0 - behind) / 2 * jnp.where(beside >= 0.0, 1.0, -1.0)
        return stray + back[:, None] * out + around[:, None] * aside

    def _stand(self, dogs: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
        """The velocities of guards, in m/s: to the circle, and away from the nearer neighbour."""
        bearing = jnp.arctan2(dogs[:, 1], dogs[:, 0])
        ahead = jnp.mod(bearing[None, :] - bearing[:, None], 2 * jnp.pi)
        other = ~jnp.eye(len(dogs), dtype=bool)
        gap = jnp.min(jnp.where(other, ahead, 2 * jnp.pi), axis=1)
        gap_behind = jnp.min(jnp.where(other, 2 * jnp.pi - ahead, 2 * jnp.pi), axis=1)
        out = unit(dogs)
        aside = jnp.stack([-out[:, 1], out[:, 0]], axis=1)
        along = self.spacing * (gap - gap_behind) / 2 * norm(dogs)
        return self.gain * (self.guard * out - dogs) + along[:, None] * aside

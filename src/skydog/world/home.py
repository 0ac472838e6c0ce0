"""Which way is home: by default the straight line to the goal, or the way around obstacles."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.world import herding, obstacles
from skydog.world.field import Field
from skydog.world.params import Way, World
from skydog.world.vectors import norm, unit


class StraightHome(eqx.Module):
    """Straight to the goal. A sheep strays by its distance to the GCM, and is pushed towards it.

    Strömbom et al. 2014; paper, "Problem Formulation".
    """

    def way(self, world: World, sheep: Float[Array, "sheep 2"]) -> Way:
        """Who strays, where to push it and where to drive. `sheep` are positions in metres."""
        centre = herding.gcm(sheep)
        from_goal, from_centre = centre - herding.goal(world.arena), sheep - centre
        return Way(
            drive_direction=-unit(from_goal),
            distance_home=norm(from_goal),
            stray_distance=norm(from_centre),
            push_direction=-unit(from_centre),
        )


# A flock that is divided is driven as one body only if the way home of each of its sheep makes at
# most this angle with their mean: cos 45°, rounded (ours).
ONE_WAY = 0.7
# Else its rearmost are pushed: those at most this share of f(N) before the last (ours).
REAR = 0.3
# A sheep out of sight of the flock cannot be pushed where its way leads it from the flock: the pull
# to the flock is as strong as a dog's push. The flock then comes back for it (ours). The way of
# such a sheep is followed so many strides ahead, of so many cells of the field each.
STRIDES, STRIDE = 24, 4.0
AGAINST = 0.7


class AroundHome(eqx.Module):
    """Around obstacles: the shortest way of each sheep, from a field over the arena (ours).

    While all sheep are in sight of their centre, they are gathered as in the open, and then driven
    along the centre's way home. A flock that an obstacle divides is pushed sheep by sheep, each
    along its own way: a sheep strays by how much further its way is than that of the foremost,
    and the rearmost count as strays even if that is less than f(N).

    A sheep that is left behind an obstacle, so that its way leads it from the flock, is no stray.
    The flock is driven back instead, to the first place on the way of that sheep that is in sight
    of the flock's centre.
    """

    field: Field

    def way(self, world: World, sheep: Float[Array, "sheep 2"]) -> Way:
        """Who strays, where to push it and where to drive. `sheep` are positions in metres."""
        distance, direction = self.field.at(sheep)
        centre = herding.gcm(sheep)
        centre_distance, centre_direction = self.field.at(centre[None])
        behind = distance - jnp.min(distance)
        gathered = herding.gathered_radius(world, len(sheep))
        together = jnp.max(norm(sheep - centre)) <= gathered
        together &= jnp.min(direction @ unit(jnp.mean(direction, axis=0))) >= ONE_WAY
        lag = jnp.maximum((1.0 + REAR) * gathered - jnp.max(behind), 0.0)
        stray, push = behind + jnp.where(together, 0.0, lag), direction
        drive = centre_direction[0]
        if world.obstacles is not None:
            seen = self._seen(world, sheep, centre)
            apart = norm(sheep - centre)
            left = ~seen & (jnp.sum(direction * unit(sheep - centre), axis=1) > AGAINST)
            left &= distance > centre_distance
            last = jnp.argmax(jnp.where(left, distance, 0.0))
            back, found = self._back(world, sheep[last], centre)
            left &= found
            drive = jnp.where(jnp.any(left), back, drive)
            whole = jnp.all(seen | left)
            stray = jnp.where(whole, apart, stray)
            stray = jnp.where(left, 0.0, stray)
            push = jnp.where(whole, -unit(sheep - centre), push)
        return Way(
            drive_direction=drive,
            distance_home=centre_distance[0],
            stray_distance=stray,
            push_direction=push,
        )

    def _back(
        self, world: World, sheep: Float[Array, "2"], centre: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], Bool[Array, ""]]:
        """The direction in which the flock comes back for a sheep, and whether there is one."""

        def on(place: Float[Array, "1 2"], _: None) -> tuple[Float[Array, "1 2"], Array]:
            place = place + STRIDE * self.field.cell * self.field.at(place)[1]
            return place, place[0]

        _, ahead = jax.lax.scan(on, sheep[None], None, length=STRIDES)
        seen = self._seen(world, ahead, centre)
        return unit(ahead[jnp.argmax(seen)] - centre), jnp.any(seen)

    @staticmethod
    def _seen(
        world: World, places: Float[Array, "some 2"], centre: Float[Array, "2"]
    ) -> Bool[Array, " some"]:
        assert world.obstacles is not None
        return ~obstacles.passed(world.obstacles, places, jnp.broadcast_to(centre, places.shape))

    def reaches(self, places: Float[Array, "some 2"]) -> Bool[Array, " some"]:
        """Whether there is a way home from each place."""
        return self.field.reaches(places)

"""Which way is home: by default the straight line to the goal, or the way around obstacles."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.world import herding, obstacles
from skydog.world.field import Field
from skydog.world.obstacles import Obstacles
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
# A dog that pushes one along its own way stands this share of f(N) behind it, if that is more than
# `dog.collecting`: a learnt skill holds its point the less exactly, the larger the arena (ours).
BEHIND = 1 / 3
# The pull to the flock is stronger than a dog's push. A sheep behind an obstacle whose way leads
# away from the flock, by an angle of more than 135° with the pull (its cosine, rounded), cannot be
# pushed along it (ours).
AGAINST = 0.7
# The flock comes back for it. Its way is searched for a place in sight of the flock in so many
# strides of so many cells of the field (ours).
STRIDES, STRIDE = 24, 4.0


class AroundHome(eqx.Module):
    """Around obstacles: the shortest way of each sheep, from a field over the arena (ours).

    While all sheep are in sight of their centre, they are gathered as in the open, and then driven
    along the centre's way home. A flock that an obstacle divides is pushed sheep by sheep, each
    along its own way: a sheep strays by how much further its way is than that of the foremost,
    and the rearmost count as strays even if that is less than f(N).

    For a sheep that cannot be pushed, since its way leads it from a flock behind an obstacle, the
    others come back: they are driven to the first place on its way that is in sight of the
    flock's centre.
    """

    field: Field

    def way(self, world: World, sheep: Float[Array, "sheep 2"]) -> Way:
        """Who strays, where to push it and where to drive. `sheep` are positions in metres."""
        distance, direction = self.field.at(sheep)
        centre = herding.gcm(sheep)
        centre_distance, centre_direction = self.field.at(centre[None])
        from_centre = sheep - centre
        behind = distance - jnp.min(distance)
        gathered = herding.gathered_radius(world, len(sheep))
        together = jnp.max(norm(from_centre)) <= gathered
        together &= jnp.min(direction @ unit(jnp.mean(direction, axis=0))) >= ONE_WAY
        lag = jnp.maximum((1.0 + REAR) * gathered - jnp.max(behind), 0.0)
        stray = behind + jnp.where(together, 0.0, lag)
        push = jnp.maximum(BEHIND * gathered / world.dog.collecting, 1.0) * direction
        drive = centre_direction[0]
        if world.obstacles is not None:
            seen = _in_sight(world.obstacles, sheep, centre)
            stuck = ~seen & (distance > centre_distance)
            stuck &= jnp.sum(direction * unit(from_centre), axis=1) > AGAINST
            last = sheep[jnp.argmax(jnp.where(stuck, distance, -jnp.inf))]
            back, found = self._back(world.obstacles, last, centre)
            stuck &= found
            as_in_the_open = jnp.all(seen | stuck)
            stray = jnp.where(as_in_the_open, norm(from_centre), stray)
            stray = jnp.where(stuck, 0.0, stray)
            push = jnp.where(as_in_the_open, -unit(from_centre), push)
            drive = jnp.where(jnp.any(stuck), back, drive)
        return Way(
            drive_direction=drive,
            distance_home=centre_distance[0],
            stray_distance=stray,
            push_direction=push,
        )

    def _back(
        self, walls: Obstacles, sheep: Float[Array, "2"], centre: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], Bool[Array, ""]]:
        """The direction in which the flock comes back for a sheep, and whether there is one."""

        def on(place: Float[Array, "1 2"], _: None) -> tuple[Float[Array, "1 2"], Array]:
            place = place + STRIDE * self.field.cell * self.field.at(place)[1]
            return place, place[0]

        _, ahead = jax.lax.scan(on, sheep[None], None, length=STRIDES)
        seen = _in_sight(walls, ahead, centre)
        return unit(ahead[jnp.argmax(seen)] - centre), jnp.any(seen)

    def reaches(self, places: Float[Array, "some 2"]) -> Bool[Array, " some"]:
        """Whether there is a way home from each place."""
        return self.field.reaches(places)


def _in_sight(
    walls: Obstacles, places: Float[Array, "some 2"], of: Float[Array, "2"]
) -> Bool[Array, " some"]:
    return ~obstacles.passed(walls, places, jnp.broadcast_to(of, places.shape))

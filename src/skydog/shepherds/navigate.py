"""The skill navigate: which way a flock is to be pushed, from what is in sight and no map."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.shepherds.networks import Actor
from skydog.world import herding
from skydog.world import rays as sights
from skydog.world.home import Given, around
from skydog.world.obstacles import Obstacles
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm, unit

RAYS = 16  # directions in which the way is seen, evenly, the first one straight home
SIGHT = 4.0  # how far, in offsets behind a stray (R_ππ, paper)

SEES = (
    *(
        f"obstacle {360 * ray / RAYS:g}° from the way home (1 - metres / sight)"
        for ray in range(RAYS)
    ),
    "straight way home (sights, 1 at most)",
    "heading, along the way home (unit vector)",
    "heading, across the way home (unit vector, 0 or more)",
)
"""The numbers that the skill sees, in their order."""


class Axes(eqx.Module):
    """The axes that the skill sees and answers in: turned to the way home, and mirrored."""

    ahead: Float[Array, "2"]  # straight home
    aside: Float[Array, "2"]  # across, on the side that the heading is on


def observe(
    walls: Obstacles,
    sides: Float[Array, "2"] | Scalar,
    goal: Float[Array, "2"],
    far: Scalar,
    place: Float[Array, "2"],
    heading: Float[Array, "2"],
) -> tuple[Float[Array, " seen"], Axes]:
    """What the skill sees from a place (`SEES`), and in which axes. Metres; `far` is the sight.

    `heading` is the unit vector along which the place is being pushed. A world that is turned or
    mirrored looks the same.
    """
    ahead = unit(goal - place)
    aside = jnp.stack([-ahead[1], ahead[0]])
    axes = Axes(ahead, jnp.where(heading @ aside < 0.0, -aside, aside))
    angle = 2.0 * math.pi * jnp.arange(RAYS) / RAYS
    rays = jnp.cos(angle)[:, None] * axes.ahead + jnp.sin(angle)[:, None] * axes.aside
    near = 1.0 - sights.free(walls, sides, place, rays, far) / far
    rest = [jnp.minimum(norm(goal - place) / far, 1.0), heading @ axes.ahead, heading @ axes.aside]
    return jnp.concatenate([near, jnp.stack(rest)]), axes


def direction(action: Float[Array, "2"], axes: Axes) -> Float[Array, "2"]:
    """The unit vector that an action means."""
    return unit(action[0] * axes.ahead + action[1] * axes.aside)


def home(skill: Actor, world: World, state: State) -> Given:
    """The way home as the skill sees it: for each sheep, and for the flock's centre.

    The nearest dog stands behind what it pushes: where it stands is the skill's memory, so that
    it can follow a wall. How far it is home is known only in a straight line.
    """
    assert world.obstacles is not None
    walls, goal = world.obstacles, herding.goal(world.arena)
    far = SIGHT * world.dog.collecting

    def way(place: Float[Array, "2"]) -> Float[Array, "2"]:
        away = place - state.dogs
        heading = unit(away[jnp.argmin(norm(away))])
        seen, axes = observe(walls, world.arena.sides, goal, far, place, heading)
        return direction(skill(seen), axes)

    places = jnp.concatenate([state.sheep, herding.gcm(state.sheep)[None]])
    return Given(around(world, state.sheep, norm(places - goal), jax.vmap(way)(places)))

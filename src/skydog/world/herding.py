"""Where a dog should be: driving point, collecting point and the gate (paper, Eqs 7 to 9)."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.errors import Refusal
from skydog.world.params import Arena, Way, World
from skydog.world.vectors import Scalar, norm

COLLECT, DRIVE = 0, 1  # the behaviours, as a trace records them

# Between neighbouring dogs that drive together, seen from the flock's centre (ours).
SPREAD_ANGLE = math.pi / 5


def gcm(sheep: Float[Array, "sheep 2"]) -> Float[Array, "2"]:
    """The global centre of mass of the flock, in metres."""
    return jnp.mean(sheep, axis=0)


def way_home(world: World, sheep: Float[Array, "sheep 2"]) -> Way:
    """Which way is home: who strays, where to push it and where to drive (`world.home`)."""
    way = world.home.way(world, sheep)
    if not isinstance(way, Way):
        raise Refusal(
            f"the world's home ({type(world.home).__name__}) gave a {type(way).__name__}; "
            "its method `way` returns a skydog.world.params.Way"
        )
    return way


def gathered_radius(world: World, sheep: int) -> Scalar:
    """f(N), in metres, by the world's `spread`: how wide a gathered flock is (paper, Eq. 7)."""
    return world.spread.radius(sheep)


def sensing(world: World) -> Scalar:
    """How near a dog must be for every sheep to see it, in metres; inf if the law has no range."""
    found = getattr(world.flock, "sensing", None)
    return jnp.min(jnp.asarray(found)) if eqx.is_array_like(found) else jnp.inf


def goal(arena: Arena) -> Float[Array, "2"]:
    """The goal's position, in metres."""
    return jnp.stack([jnp.asarray(arena.goal_x), jnp.asarray(arena.goal_y)]).astype(jnp.float32)


def gathered(world: World, sheep: Float[Array, "sheep 2"]) -> Bool[Array, ""]:
    """Whether every sheep is within f(N), by the world's `spread`, of the flock's centre."""
    return jnp.max(norm(sheep - gcm(sheep))) <= gathered_radius(world, len(sheep))


def driving_points(
    world: World, sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]
) -> Float[Array, "dogs 2"]:
    """P_σ1 for each dog: R_ππ √N behind the flock's centre, on its way home.

    Several dogs spread on an arc around that point, and take its places in the order in
    which they stand around the flock, so that none flies through another's.
    """
    count = len(dogs)
    centre = gcm(sheep)
    behind = -way_home(world, sheep).drive_direction
    offset = world.dog.driving * jnp.sqrt(float(len(sheep)))
    if count == 1:
        return jnp.broadcast_to(centre + offset * behind, dogs.shape)
    aside = jnp.stack([-behind[1], behind[0]])
    bearing = jnp.arctan2((dogs - centre) @ aside, (dogs - centre) @ behind)
    place = jnp.argsort(jnp.argsort(bearing))
    angle = (place - (count - 1) / 2) * min(SPREAD_ANGLE, 2 * math.pi / count)
    direction = jnp.cos(angle)[:, None] * behind + jnp.sin(angle)[:, None] * aside
    return centre + offset * direction


def collecting_points(
    world: World, sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]
) -> tuple[Float[Array, "dogs 2"], Bool[Array, " dogs"]]:
    """P_σ2 for each dog: R_ππ behind its stray, seen from where that is to be pushed to.

    The strays are the sheep further out than f(N), or else the furthest sheep, wherever it is.
    The one that strays furthest goes to the dog nearest to its point, the next to the nearest of
    the others, and so on; how far a sheep strays counts less by the world's `dog.nearness` times
    its distance to the nearest dog that is still free. Also tells which dogs have a stray.
    """
    way = way_home(world, sheep)
    points = sheep + world.dog.collecting * -way.push_direction
    furthest = jnp.max(way.stray_distance)
    least = jnp.minimum(furthest, gathered_radius(world, len(sheep)))
    outside = (way.stray_distance > least) | (way.stray_distance == furthest)
    to_sheep = norm(dogs[:, None] - sheep[None, :])
    if len(dogs) == 1:
        rank = way.stray_distance - world.dog.nearness * to_sheep[0]
        stray = jnp.argmax(jnp.where(outside, rank, -jnp.inf))
        return points[stray][None], jnp.ones(1, bool)

    def hand_out(carry, _):
        target, busy, left = carry
        away = jnp.min(jnp.where(busy[:, None], jnp.inf, to_sheep), axis=0)
        rank = jnp.where(left, way.stray_distance - world.dog.nearness * away, -jnp.inf)
        stray = jnp.argmax(rank)
        nearest = jnp.argmin(jnp.where(busy, jnp.inf, norm(dogs - points[stray])))
        chosen = (jnp.arange(len(dogs)) == nearest) & left[stray]
        target = jnp.where(chosen[:, None], points[stray], target)
        return (target, busy | chosen, left & (jnp.arange(len(sheep)) != stray)), None

    nobody = (dogs, jnp.zeros(len(dogs), bool), outside)
    rounds = min(len(dogs), len(sheep))
    (target, busy, _), _ = jax.lax.scan(hand_out, nobody, None, length=rounds)
    return target, busy


def gate(
    world: World, sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]
) -> tuple[Float[Array, "dogs 2"], Bool[Array, " dogs"]]:
    """The subgoal of each dog, and whether it drives (else it collects).

    Scattered flocks are collected and gathered ones driven (Strömbom 2014; paper, "Problem
    Formulation"): gathered, if no sheep strays further than f(N), by the world's `spread`. A dog
    that finds no stray left for it takes its place behind the flock. Subgoals stay within the
    airspace, since a point beyond it could never be reached. For a dog that has to go around
    obstacles (`world.routes`) it is the next corner on its way there.
    """
    driving = driving_points(world, sheep, dogs)
    collecting, has_stray = collecting_points(world, sheep, dogs)
    furthest = jnp.max(way_home(world, sheep).stray_distance)
    drives = (furthest <= gathered_radius(world, len(sheep))) | ~has_stray
    subgoal = within_airspace(world, jnp.where(drives[:, None], driving, collecting))
    if world.obstacles is not None and world.routes is not None:
        subgoal = world.routes.waypoint(world.obstacles, dogs, subgoal)
    return subgoal, drives


def within_airspace(world: World, position: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
    """The nearest positions where dogs may fly."""
    beyond = world.dog.airspace
    return jnp.clip(position, -beyond, world.arena.sides + beyond)

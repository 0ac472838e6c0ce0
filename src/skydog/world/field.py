"""The distance home around obstacles, as a field over the arena, computed once for a scene."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy import ndimage

from skydog.errors import Refusal
from skydog.world import obstacles as obstacle
from skydog.world.obstacles import Obstacles
from skydog.world.vectors import Scalar, unit

STRIDES = 4  # in which a way is followed ahead


class Field(eqx.Module):
    """How far it is home from the nodes of a grid, and which way. Metres, unit vectors.

    Node (i, k) is at x = i · cell, y = k · cell.
    """

    distance: Float[Array, "*batch columns rows"]
    direction: Float[Array, "*batch columns rows 2"]
    reached: Bool[Array, "*batch columns rows"]  # whether there is a way home
    cell: Scalar

    def at(
        self, position: Float[Array, "some 2"]
    ) -> tuple[Float[Array, " some"], Float[Array, "some 2"]]:
        """The metres home from each position, and the unit vector that leads there."""
        most = jnp.asarray(self.distance.shape) - 1
        place = jnp.clip(position / self.cell, 0.0, most)
        low = jnp.minimum(jnp.floor(place).astype(int), most - 1)
        share = place - low
        distance, direction = jnp.zeros(len(position)), jnp.zeros_like(position)
        for i, k in ((0, 0), (0, 1), (1, 0), (1, 1)):
            x = share[:, 0] if i else 1.0 - share[:, 0]
            y = share[:, 1] if k else 1.0 - share[:, 1]
            node = (low[:, 0] + i, low[:, 1] + k)
            distance = distance + x * y * self.distance[node]
            direction = direction + (x * y)[:, None] * self.direction[node]
        return distance, unit(direction)

    def reaches(self, position: Float[Array, "some 2"]) -> Bool[Array, " some"]:
        """Whether there is a way home from the node nearest to each position."""
        most = jnp.asarray(self.reached.shape) - 1
        node = jnp.clip(jnp.rint(position / self.cell).astype(int), 0, most)
        return self.reached[node[:, 0], node[:, 1]]


def solve(
    walls: Obstacles,
    goal: tuple[float, float],
    radius: float,
    sides: tuple[float, float],
    nodes: int,
    clearance: float,
    ahead: float,
) -> Field:
    """The field of the shortest ways to a goal that keep `clearance` metres off all obstacles.

    `nodes` stand along the longer side. Solves the eikonal equation ‖∇T‖ = 1 by Godunov's upwind
    scheme, iterated until nothing changes (Rouy and Tourin 1992). Within the goal's `radius`
    there is the straight distance. Directions lead to the point of the way home that lies `ahead`
    metres on, so that who follows them rounds corners in time. Nodes without a way home lead to
    the nearest node that has one. Raises `Refusal` if there is none.
    """
    cell = max(sides) / (nodes - 1)
    x, y = (np.arange(int(np.ceil(side / cell - 1e-6)) + 1) * cell for side in sides)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    gap = np.concatenate([np.asarray(_gap(walls, jnp.asarray(column))) for column in grid])
    # A wall between two nodes would leak if it were thinner than a cell.
    free = gap.reshape(grid.shape[:2]) > max(clearance, 0.75 * cell)
    straight = np.linalg.norm(grid - np.asarray(goal), axis=-1)
    source = free & (straight <= max(radius, 1.5 * cell))
    if not source.any():
        raise Refusal(f"the goal at {goal[0]:g},{goal[1]:g} lies within an obstacle; move it")
    begun = jnp.asarray(np.where(source, straight, np.inf))
    distance = np.asarray(_spread(begun, jnp.asarray(free & ~source), cell), np.float64)
    reached = np.isfinite(distance)
    nearest: Any = ndimage.distance_transform_edt(
        ~reached, return_distances=False, return_indices=True
    )
    place = tuple(nearest)
    back = np.moveaxis(np.asarray(nearest) - np.indices(reached.shape), 0, -1) * cell
    field = Field(
        distance=jnp.asarray(distance[place] + np.linalg.norm(back, axis=-1), jnp.float32),
        direction=jnp.asarray(_unit(_downhill(distance)[place] + _unit(back)), jnp.float32),
        reached=jnp.asarray(reached),
        cell=cell,
    )
    return replace(field, direction=_looking_ahead(field, jnp.asarray(grid, jnp.float32), ahead))


_gap = eqx.filter_jit(obstacle.clearance)


@jax.jit
def _spread(
    distance: Float[Array, "columns rows"], open_: Bool[Array, "columns rows"], cell: Scalar
) -> Float[Array, "columns rows"]:
    """The distance at every node, once it has spread to all nodes that are open."""

    def better(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        distance, _ = carry
        wide = jnp.pad(distance, 1, constant_values=jnp.inf)
        across = jnp.minimum(wide[:-2, 1:-1], wide[2:, 1:-1])
        along = jnp.minimum(wide[1:-1, :-2], wide[1:-1, 2:])
        low, high = jnp.minimum(across, along), jnp.maximum(across, along)
        apart = jnp.minimum(high - jnp.where(jnp.isinf(low), 0.0, low), cell)
        found = low + 0.5 * (apart + jnp.sqrt(2.0 * cell**2 - apart**2))
        found = jnp.where(open_, jnp.minimum(found, distance), distance)
        return found, jnp.any(found < distance * (1.0 - 1e-6))

    return jax.lax.while_loop(lambda carry: carry[1], better, (distance, jnp.asarray(True)))[0]


@eqx.filter_jit
def _looking_ahead(
    field: Field, grid: Float[Array, "columns rows 2"], ahead: Scalar
) -> Float[Array, "columns rows 2"]:
    begun = place = grid.reshape(-1, 2)
    for _ in range(STRIDES):
        place = place + ahead / STRIDES * field.at(place)[1]
    return unit(place - begun).reshape(grid.shape)


def _downhill(distance: Float[np.ndarray, "columns rows"]) -> Float[np.ndarray, "columns rows 2"]:
    """The direction of steepest descent at each node that is reached, seen upwind."""
    parts = []
    for axis in (0, 1):
        ends = [(1, 1) if each == axis else (0, 0) for each in range(2)]
        wide = np.pad(distance, ends, constant_values=np.inf)
        count = distance.shape[axis]
        before = np.take(wide, np.arange(count), axis)
        after = np.take(wide, np.arange(2, count + 2), axis)
        lower = np.minimum(before, after)
        drops = np.isfinite(distance) & (lower < distance)
        drop = np.subtract(distance, lower, out=np.zeros_like(distance), where=drops)
        parts.append(np.where(before < after, -drop, drop))
    return _unit(np.stack(parts, axis=-1))


def _unit(vectors: Float[np.ndarray, "columns rows 2"]) -> Float[np.ndarray, "columns rows 2"]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length == 0.0, 1.0, length)

# pyright: reportAttributeAccessIssue=false
"""Obstacles in the twin: where they stand, what they stop, and missions among them."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from rigs import ROVER, TUM, Rig, model

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.twin import Twin, bodies, starts
from skydog.world import mission, obstacles
from skydog.world.obstacles import Obstacles
from skydog.world.presets import preset

pytestmark = pytest.mark.usefixtures("unchecked")

RADIUS = ROVER.body.radius
SCENE = """
size = [6, 4]
start = [3.8, 1, 5.5, 3]
goal = [0.5, 2]
goal_radius = 2.5
walls = [[[3, 0], [3, 1.4]], [[3, 2.6], [3, 4]]]
"""


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A wall with a gate across an arena that is no square, a short way from the goal."""
    file = tmp_path_factory.mktemp("scene") / "pen.toml"
    file.write_text(SCENE)
    return preset("paper-physical", sheep=2, scene=file)


def closed_to(ends, radius):
    closed = bodies.closed_to(ROVER, Obstacles(jnp.array(ends, float), jnp.array(radius, float)))
    assert closed is not None
    return closed


def placed(sheep, dog):
    at = mission.start(jnp.array(sheep, float), jnp.array([dog], float))
    return jax.tree.map(lambda leaf: leaf[None], at)


def test_bodies_stand_where_obstacles_are_thinner_by_a_rovers_radius_but_not_than_walls():
    ends = [[[2.0, 1.0], [4.0, 2.0]], [[5.0, 4.0], [5.0, 4.0]], [[1.0, 3.0], [3.0, 5.0]]]
    closed = closed_to(ends, [0.4, 0.7, 0.05])
    thick = [0.4, 0.7, RADIUS + bodies.WALL_THICKNESS / 2]
    np.testing.assert_allclose(closed.radius, thick, rtol=1e-6)
    built, data = model(closed=closed)
    data.qpos[built.sheep[0] : built.sheep[0] + 2] = (-3.0, -3.0)  # out of the way
    mujoco.mj_forward(built.model, data)
    places = np.random.default_rng(0).uniform((0.5, 0.5), (5.9, 5.5), (400, 2))
    outside = np.asarray(obstacles.clearance(closed, jnp.asarray(places))) + RADIUS
    hit, down = np.zeros(1, np.int32), np.array([0.0, 0.0, -1.0])
    for place, gap in zip(places, outside, strict=True):
        ray = np.array([*place, 1.5])
        far = mujoco.mj_ray(built.model, data, ray, down, None, True, -1, hit)
        if abs(gap) > 1e-3:
            np.testing.assert_allclose(far, 1.5 - (bodies.WALL if gap < 0.0 else 0.0), atol=1e-6)
    assert 20 < np.sum(outside < 0.0) < 380


@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_a_rover_that_drives_at_a_wall_or_a_disc_does_not_pass(yaw):
    rover = ((3.0, 2.0, yaw), (3.0, 4.5, yaw))
    closed = closed_to([[[4.0, 0.0], [4.0, 4.0]], [[4.0, 4.8], [4.0, 4.8]]], [0.05, 0.4])
    found = Rig(sheep=rover, closed=closed).drive([(0.5, 0.0), (0.5, 0.0)], 4.0)
    for number in range(2):
        gap = obstacles.clearance(closed, jnp.asarray(found[:, number, :2]))
        assert -0.005 < float(gap.min()) < 0.01  # it has touched


def test_a_flock_is_herded_through_a_gate_and_no_rover_passes_a_wall(world):
    begin = placed(((4.2, 1.2), (3.8, 1.7)), (5.2, 1.0))
    twin = Twin("crazyflie", threads=1)
    flown = twin(world, Strombom(), begin, 60)
    assert bool(flown.accomplished[0, -1])
    assert float(flown.sheep[0, -1, :, 0].max()) < 3.0  # beyond the wall
    closed = bodies.closed_to(ROVER, world.obstacles)
    assert closed is not None
    gap = obstacles.clearance(closed, flown.sheep.reshape(-1, 2))
    assert float(gap.min()) > -0.005


def test_starts_are_clear_of_obstacles_and_others_are_refused(world):
    begin = starts.draw(world, 2, "spaced", TUM, ROVER, sheep=2)
    closed = bodies.closed_to(ROVER, world.obstacles)
    assert closed is not None
    for who, least in ((begin.sheep, 0.0), (begin.dogs, TUM.body.radius - RADIUS)):
        assert float(obstacles.clearance(closed, who.reshape(-1, 2)).min()) >= least
    room = TUM, ROVER, np.array([6.0, 4.0]), closed
    with pytest.raises(Refusal, match="outside the arena or in an obstacle"):
        starts.check(placed(((3.15, 1.0), (5.0, 2.0)), (1.0, 1.0)), *room)
    with pytest.raises(Refusal, match="a drone's pad is not clear"):
        starts.check(placed(((4.0, 1.0), (5.0, 2.0)), (3.0, 3.0)), *room)


def test_dogs_on_the_ground_are_refused(world):
    tall = replace(world, obstacles=replace(world.obstacles, tall=True))
    with pytest.raises(Refusal, match="drones fly above obstacles"):
        starts.draw(tall, 1, "spaced", TUM, ROVER)

"""The fewest steps that any shepherd could need: no mission takes less, and some take no more."""

import json
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, metrics, report
from skydog.study.cases import cases
from skydog.world.laws.paper import PaperFlock
from skydog.world.limits import AnyDirection
from skydog.world.mission import rollout
from skydog.world.presets import preset
from skydog.world.state import start
from skydog.world.trace import Poses, Trace
from skydog.world.vectors import norm

WORLD = preset("paper", 10.0, 1)  # a sheep sees 2 m far; it moves 0.05 m a step, a dog 0.14
STRIDE = 0.1 * np.sqrt(2.0)  # m: a step of a dog along the diagonal


class Chase(eqx.Module):
    """Comes along the diagonal as fast as it can, then follows the sheep at the sheep's speed."""

    def __call__(self, world, state):
        far = norm(state.dogs - state.sheep)[:, None] > 1.95
        return jnp.where(far, -1.0, -0.5 / jnp.sqrt(2.0)) * jnp.ones_like(state.dogs)


def chased(world, away, steps=200):
    """A sheep on the diagonal, and so many metres behind it the dog."""
    sheep = jnp.array([[5.0, 5.0]])
    return rollout(world, Chase(), start(sheep, sheep + away / np.sqrt(2.0)), steps)


@pytest.mark.parametrize("waits", [0, 1, 7])
def test_a_sheep_that_is_chased_straight_home_takes_the_fewest_steps(waits):
    trace = chased(WORLD, 1.9 + waits * STRIDE)
    run = np.ceil((np.hypot(5.0, 5.0) - 2.0) / 0.05)
    assert bool(trace.accomplished[-1])
    assert int(metrics.steps(trace)) == metrics.fewest_steps(trace) == waits + run
    assert metrics.steps_ratio(trace) == 1.0


def fewest(world, sheep, dogs):
    """By the start alone."""
    sheep, dogs = (jnp.asarray(each, jnp.float32)[None] for each in (sheep, dogs))
    trace = Trace(
        world=world,
        time=jnp.zeros(1),
        sheep=sheep,
        dogs=dogs,
        subgoal=dogs,
        drives=jnp.zeros(dogs.shape[:-1], bool),
        command=jnp.zeros_like(dogs),
        accomplished=jnp.zeros(1, bool),
    )
    return float(metrics.fewest_steps(trace))


def with_dog(**parts):
    return replace(WORLD, dog=replace(WORLD.dog, **parts))


FAR = np.array([[8.0, 8.0]])
SHEEP = np.array([[5.0, 5.0]])
RUN = np.ceil((np.hypot(5.0, 5.0) - 2.0) / 0.05)
COMING = np.hypot(3.0, 3.0) - 2.0  # metres until the sheep sees the dog


@pytest.mark.parametrize(
    ("world", "steps"),
    [
        (WORLD, np.ceil(COMING / STRIDE)),
        (with_dog(limits=AnyDirection()), np.ceil(COMING / 0.1)),
        (with_dog(actuation_noise=0.1), 0),  # gusts may carry a dog faster
        (with_dog(limits=AnyDirection(), speed=0.5), np.ceil(COMING / 0.05)),
    ],
    ids=["each axis", "any direction", "noise", "slow"],
)
def test_a_dog_comes_as_fast_as_its_limits_allow(world, steps):
    assert fewest(world, SHEEP, FAR) == RUN + steps


def test_sheep_that_touch_or_graze_move_without_a_dog():
    pair = np.concatenate([SHEEP, SHEEP - 0.5])
    assert fewest(preset("paper", 10.0), pair, FAR) == RUN
    grazing = preset("strombom2014", 150.0, 1)
    far, run = np.array([[149.0, 149.0]]), np.ceil(np.hypot(20.0, 20.0) - 10.0)
    assert fewest(grazing, 4 * SHEEP, far) == run
    still = replace(grazing, flock=replace(grazing.flock, graze=0.0))
    assert fewest(still, 4 * SHEEP, far) == run + np.ceil((np.hypot(129.0, 129.0) - 65.0) / 1.5)


def test_with_a_speed_for_each_sheep_the_one_that_needs_the_longest_counts():
    world = replace(WORLD, sheep=replace(WORLD.sheep, speed=jnp.array([0.5, 0.1])))
    sheep = np.array([[5.0, 5.0], [0.0, 3.0]])
    assert fewest(world, sheep, SHEEP) == max(RUN, np.ceil(1.0 / 0.01))


class Anywhere(eqx.Module):
    def accomplished(self, world, state):
        return jnp.asarray(True)


class OwnFlock(PaperFlock):
    def force(self, state, key):
        return 2.0 * super().force(state, key)


@pytest.mark.parametrize(
    "world",
    [
        preset("paper-literal", 10.0, 1),
        replace(WORLD, end=Anywhere()),
        replace(WORLD, flock=OwnFlock(**vars(WORLD.flock))),
    ],
    ids=["forces as printed", "an end of one's own", "a law of one's own"],
)
def test_where_no_bound_is_known_there_is_none(world):
    assert np.isnan(fewest(world, SHEEP, FAR))


def test_a_metric_that_is_not_known_is_a_dash_in_a_table_and_null_in_json():
    measured = {how.__name__: np.arange(3.0) for how in (metrics.success, *evaluate.MEASURES)}
    measured["success"] = np.ones(3)
    assert evaluate.figures(measured)["steps_ratio"]["mean"] == 1.0
    measured["steps_ratio"] = np.array([1.0, np.nan, 2.0])
    row = evaluate.figures(measured)
    assert '"steps_ratio": null' in json.dumps(row, allow_nan=False)
    assert report.figure(row["steps_ratio"], ".2f") == "—"


def test_bodies_with_physics_outside_starts_and_too_short_missions_have_no_ratio():
    assert metrics.steps_ratio(chased(WORLD, 1.9, 200)) >= 1.0
    assert np.isnan(metrics.steps_ratio(chased(WORLD, 1.9, 20)))
    assert np.isnan(fewest(WORLD, SHEEP + 9.0, FAR))
    assert np.isnan(fewest(WORLD, SHEEP, FAR + 9.0))
    trace = chased(WORLD, 1.9)
    poses = Poses(*(jnp.zeros((201, 1, 3)[: 3 if vector else 2]) for vector in (0, 1, 1, 0, 0, 0)))
    assert np.isnan(metrics.fewest_steps(replace(trace, poses=poses)))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("name", "arena", "sheep", "dogs"),
    [("paper", 4.0, 1, 1), ("paper-physical", 6.0, 5, 3), ("strombom2014", 40.0, 2, 2)],
)
def test_no_mission_takes_less_than_the_fewest_steps(name, arena, sheep, dogs):
    world = preset(name, arena, sheep)
    # Many start near home, where a single step too many in the bound would show.
    starts = cases(world, 500, "anywhere", 5, sheep, dogs)
    key = evaluate.noise_key(world, 1)
    measured = evaluate.measure(evaluate.fly(world, Strombom(), starts, 300, key))
    assert measured["success"].mean() > 0.5
    assert measured["steps_ratio"].min() >= 1.0

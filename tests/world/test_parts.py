"""The parts of a world can be exchanged: laws of one's own for f(N), home, end and limits."""

import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate, metrics
from skydog.world import herding, mission, params, presets
from skydog.world.params import Way, World
from skydog.world.presets import preset
from skydog.world.spread import FixedSpread, SquareRootSpread, TwoThirdsSpread
from skydog.world.vectors import norm, unit

WORLD = preset("paper", 6.0)
STATE = mission.start(
    jnp.array([[3.0, 5.0], [3.3, 4.6], [4.9, 2.0]]), jnp.array([[2.0, 2.0], [5.0, 5.0]])
)


# f(N)


@pytest.mark.parametrize(
    ("spread", "expected"),
    [
        (TwoThirdsSpread(2.0), 2 * 46 ** (2 / 3)),
        (SquareRootSpread(2.0), 2 * math.sqrt(92)),
        (FixedSpread(1.3), 1.3),
    ],
)
def test_f_of_n_is_what_each_law_says_to_gate_and_success(spread, expected):
    world = replace(WORLD, spread=spread)
    assert math.isclose(herding.gathered_radius(world, 46), expected)
    radius = herding.gathered_radius(world, 3)
    for share, gathered in ((0.999, True), (1.001, False)):
        sheep = jnp.array([[0.5 - share * radius, 0.5], [0.5 + share * radius, 0.5], [0.5, 0.5]])
        assert bool(herding.gathered(world, sheep)) == gathered
        wide = replace(world, arena=replace(world.arena, goal_radius=99.0))
        assert bool(mission.accomplished(wide, mission.start(sheep, STATE.dogs))) == gathered
        assert bool(herding.gate(world, sheep, STATE.dogs[:1])[1][0]) == gathered


def test_the_goal_of_a_large_strombom_flock_follows_its_f_of_n():
    for name, radius in (
        ("strombom2014", 2.0 * 100 ** (2 / 3)),
        ("strombom2014-sqrt", 2.0 * math.sqrt(200)),
    ):
        world = preset(name, sheep=100)
        assert math.isclose(world.arena.goal_radius, radius)
        assert math.isclose(herding.gathered_radius(world, 100), radius)


def test_a_scattered_flock_of_a_thousand_is_gathered_by_two_thirds_and_not_by_the_root():
    key = jax.random.key(0)
    for name, gathered in (("strombom2014", True), ("strombom2014-sqrt", False)):
        world = preset(name, arena=500.0, sheep=1000)
        start = mission.reset(world, key, sheep=1000)
        assert bool(herding.gathered(world, start.sheep)) == gathered


# Which way is home


class Door(eqx.Module):
    """Home through a door: a sheep strays by its way to it, and is pushed there."""

    door: jax.Array

    def way(self, world, sheep):
        centre = herding.gcm(sheep)
        return Way(
            drive_direction=unit(self.door - centre),
            distance_home=norm(self.door - centre),
            stray_distance=norm(self.door - sheep),
            push_direction=unit(self.door - sheep),
        )


DOOR = jnp.array([0.0, 6.0])
THROUGH = replace(WORLD, home=Door(DOOR))


def test_home_decides_where_to_drive_who_strays_and_where_to_push():
    centre = np.asarray(STATE.sheep).mean(axis=0)
    behind = (centre - DOOR) / np.linalg.norm(centre - DOOR)
    point = herding.driving_points(THROUGH, STATE.sheep, STATE.dogs[:1])[0]
    np.testing.assert_allclose(point, centre + math.sqrt(3) * behind, atol=1e-5)
    away = np.linalg.norm(np.asarray(STATE.sheep) - DOOR, axis=1)
    stray = np.asarray(STATE.sheep)[away.argmax()]
    target, _ = herding.collecting_points(THROUGH, STATE.sheep, STATE.dogs[:1])
    out = (stray - DOOR) / np.linalg.norm(stray - DOOR)
    np.testing.assert_allclose(target[0], stray + out, atol=1e-5)
    # Of two dogs, each fetches another stray by the same measure.
    both, busy = herding.collecting_points(THROUGH, STATE.sheep, STATE.dogs)
    assert busy.all()
    expected = np.asarray(STATE.sheep) + (np.asarray(STATE.sheep) - DOOR) / away[:, None]
    furthest = np.argsort(-away)[:2]
    found = np.asarray(both)[np.argsort(both[:, 0])]
    wanted = expected[furthest][np.argsort(expected[furthest][:, 0])]
    np.testing.assert_allclose(found, wanted, atol=1e-5)


@pytest.mark.parametrize("shepherd", ["strombom", "h-ddpg-4x4"])
def test_every_shepherd_herds_to_where_home_leads(shepherd):
    dog = Strombom() if shepherd == "strombom" else store.load(shepherd)
    there = replace(THROUGH, arena=replace(THROUGH.arena, goal_x=0.0, goal_y=6.0))
    starts = cases.cases(WORLD, 4, "random", seed=3)
    straight = evaluate.fly(THROUGH, dog, starts, steps=600)
    assert not metrics.success(evaluate.one_case(straight, 0))  # the goal is elsewhere
    gained = np.linalg.norm(starts.sheep.mean(axis=1) - DOOR, axis=1) - np.linalg.norm(
        straight.sheep[:, -1].mean(axis=1) - DOOR, axis=1
    )
    assert (gained > 1.0).all()
    if shepherd == "strombom":
        flown = evaluate.fly(there, dog, starts, steps=600)
        assert flown.accomplished[:, -1].all()


# When a mission is accomplished, and what dogs can fly


class Halfway(eqx.Module):
    """The mission ends when the flock's centre is within some metres of the goal."""

    radius: float

    def accomplished(self, world, state):
        away = norm(herding.gcm(state.sheep) - herding.goal(world.arena))
        return away <= self.radius


def test_a_mission_ends_when_its_world_says():
    starts = cases.cases(WORLD, 5)
    usual = evaluate.measure(evaluate.fly(WORLD, Strombom(), starts))["steps"]
    flown = evaluate.fly(replace(WORLD, end=Halfway(3.5)), Strombom(), starts)
    early = evaluate.measure(flown)
    assert early["success"].all()
    assert (early["steps"] < usual).all()
    last = np.linalg.norm(flown.sheep[:, -1].mean(axis=1), axis=1)
    assert (last <= 3.5).all()
    assert (last > 3.4).all()


class East(eqx.Module):
    """A dog that flies along x alone."""

    def limit(self, velocity, speed):
        return jnp.clip(velocity, -speed, speed) * jnp.array([1.0, 0.0])

    def fastest(self, direction, speed):
        return speed * jnp.sign(direction) * jnp.array([1.0, 0.0])


def test_a_dog_flies_within_limits_of_its_own_whoever_steers():
    world = replace(WORLD, dog=replace(WORLD.dog, limits=East()))
    for shepherd in (Strombom(), store.load("h-ddpg-4x4"), lambda _, state: 9.0 + 0 * state.dogs):
        trace = mission.rollout(world, shepherd, STATE, 30)
        moved = np.diff(trace.dogs, axis=0)
        assert (moved[..., 1] == 0.0).all()
        assert np.abs(moved[..., 0]).max() <= 0.1 + 1e-6
        assert np.abs(moved[..., 0]).max() > 0.01


# What a world must have


class Bare(eqx.Module):
    """Nothing of a law."""


@pytest.mark.parametrize(
    ("part", "method"),
    [
        ("flock", "force"),
        ("home", "way"),
        ("end", "accomplished"),
        ("spread", "radius"),
        ("limits", "limit"),
    ],
)
def test_a_world_whose_law_lacks_its_method_is_refused_by_the_method(part, method):
    def maker(arena: float = 4.0, sheep: int = 3) -> World:
        # Around the checker of types, which users do not have and which would refuse it first.
        world = preset("paper", arena, sheep)
        object.__setattr__(world.dog if part == "limits" else world, part, Bare())
        return world

    with pytest.raises(Refusal, match=f"{part}.*no method '{method}'"):
        presets.make(maker)


class Quiet(eqx.Module):
    noisy: bool = eqx.field(static=True, default=False)

    def force(self, state, key):
        return jnp.zeros_like(state.sheep)


class Random(eqx.Module):
    def force(self, state, key):
        if key is None:
            return jnp.zeros_like(state.sheep)
        return unit(jax.random.normal(key, state.sheep.shape))


def test_a_world_is_noisy_if_anything_in_it_draws_random_numbers():
    assert not params.noisy(WORLD)
    assert not params.noisy(replace(WORLD, flock=Quiet()))
    assert params.noisy(replace(WORLD, flock=Random()))  # it does not say, and so it may
    assert params.noisy(preset("strombom2014"))
    each = replace(WORLD, flock=replace(WORLD.flock, noise=jnp.array([0.0, 0.0, 0.1])))
    assert params.noisy(each)
    assert not params.noisy(replace(WORLD, flock=replace(WORLD.flock, noise=jnp.zeros(3))))
    assert params.noisy(replace(WORLD, dog=replace(WORLD.dog, perception_noise=0.1)))

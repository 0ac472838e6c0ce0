"""The parts of a world can be exchanged: laws of one's own for f(N), home, end and limits."""

import math
from dataclasses import replace
from typing import Any

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import skydog.envs  # noqa: F401
from skydog.errors import Refusal
from skydog.learning import ddpg, train
from skydog.learning.lessons import Lesson
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate, metrics
from skydog.view import live
from skydog.view import session as sessions
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


# What a law must give


class Flocks:
    """Laws of the flock that go wrong, each in its own way."""

    class OneForAll(eqx.Module):
        def force(self, state, key):
            return jnp.zeros(2)

    class Fails(eqx.Module):
        def force(self, state, key):
            raise ValueError("no idea")

    class Argues(eqx.Module):
        def force(self, state):
            return jnp.zeros_like(state.sheep)

    class Decides(eqx.Module):
        flag: bool = True

        def force(self, state, key):
            return jnp.zeros_like(state.sheep) if self.flag else state.sheep

    class Named(eqx.Module):
        name: str = "a flock"

        def force(self, state, key):
            return jnp.zeros_like(state.sheep)

    class NoModule:
        def force(self, state, key):
            return jnp.zeros_like(state.sheep)


class Everywhere(eqx.Module):
    def accomplished(self, world, state):
        return state.sheep[:, 0] > 0

    def way(self, world, sheep):
        return sheep

    def radius(self, sheep):
        return jnp.ones(sheep)


@pytest.mark.parametrize(
    ("part", "law", "said"),
    [
        ("flock", Flocks.OneForAll(), r"shape \(2,\).*shape \(5, 2\) is needed"),
        ("flock", Flocks.Fails(), "ValueError: no idea"),
        ("flock", Flocks.Argues(), "TypeError"),
        ("flock", Flocks.Decides(), r"Tracer.*static=True"),
        ("flock", Flocks.Named(), r"'a flock'.*static=True"),
        ("flock", Flocks.NoModule(), "equinox.Module"),
        ("flock", Flocks.Fails, r"the class Fails; make it Fails\(\)"),
        ("end", Everywhere(), r"shape \(5,\).*shape \(\) is needed"),
        ("home", Everywhere(), "returns a skydog.world.params.Way"),
        ("spread", Everywhere(), r"shape \(5,\)"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_law_that_cannot_fly_is_refused_in_one_line(part, law, said):
    world = preset("paper", 4.0, 5)
    object.__setattr__(world, part, law)  # as users may: without a checker of types
    with pytest.raises(Refusal, match=said) as refusal:
        mission.check(world, 5)
    assert "\n" not in str(refusal.value)
    with pytest.raises(Refusal, match=said):
        gymnasium.make("skydog/Herd-v0", world=world, sheep=5)


def test_what_ships_passes_the_check_of_laws():
    for name in presets.PRESETS:
        world = preset(name, 200.0, 7)
        assert mission.check(world, 7, 2) is world


class Lost(eqx.Module):
    """A force that is no number, as division by zero gives."""

    def force(self, state, key):
        return unit(state.sheep - state.sheep[0]) / norm(state.sheep - state.sheep[0])[:, None]


def test_a_flock_that_is_lost_is_refused_and_no_row_of_failures():
    world = replace(preset("paper"), flock=Lost())
    with pytest.raises(Refusal, match=r"law \(Lost\).*not a finite.*mission 0"):
        evaluate.fly(world, Strombom(), cases.cases(world, 2), 20)
    with pytest.raises(Refusal, match=r"diverged.*not a finite"):
        train.train(Lesson(world, "drive"), ddpg.Config(batch=4), 0, 1_000)


def test_a_shepherd_that_steers_another_number_of_dogs_is_refused():
    with pytest.raises(Refusal, match=r"shape \(2,\).*\(2, 2\)"):
        mission.decide(WORLD, lambda world, state: jnp.zeros(2), STATE)


def test_an_own_world_has_its_own_arena_and_flock_in_an_environment():
    world = preset("paper", 8.0, 9)
    options: dict[str, Any]
    for options in ({"arena": 6.0}, {"preset": "paper-w05"}):
        with pytest.raises(Refusal, match="takes the place of preset, scene, arena and mix"):
            gymnasium.make("skydog/Herd-v0", world=world, **options)
    each = replace(world, sheep=replace(world.sheep, speed=jnp.full(9, 0.5)))
    with pytest.raises(Refusal, match="--sheep 9"):
        gymnasium.make("skydog/Herd-v0", world=each)  # which has three sheep
    seen, _ = gymnasium.make("skydog/Herd-v0", world=each, sheep=9).reset(seed=0)
    assert np.isfinite(seen).all()


def test_missions_may_be_flown_with_negative_steps_by_nobody():
    with pytest.raises(Refusal, match="-1"):
        mission.rollout(WORLD, Strombom(), STATE, -1)
    with pytest.raises(Refusal, match="-1"):
        evaluate.fly(WORLD, Strombom(), cases.cases(WORLD, 1), -1)


def test_a_sheep_that_cannot_move_needs_no_steps_by_the_bound():
    world = replace(WORLD, sheep=replace(WORLD.sheep, speed=jnp.array([0.5, 0.0, 0.5])))
    flown = evaluate.fly(world, Strombom(), cases.cases(WORLD, 2), 100)
    assert (evaluate.measure(flown)["steps_ratio"] >= 1.0).all()


def test_a_live_session_refuses_a_world_that_cannot_fly_and_goes_on():
    def odd(arena: float = 4.0, sheep: int = 3) -> World:
        world = preset("paper", arena, sheep)
        return replace(world, flock=Random() if sheep % 2 else Flocks.OneForAll())

    worlds = {"odd": odd, **presets.PRESETS}
    dogs = {"strombom": Strombom()}
    begin = live.opening(dogs, "strombom", "odd", worlds=worlds)
    session = sessions.advance(sessions.new(begin, worlds), dogs, 2)
    with pytest.raises(Refusal, match="shape"):
        sessions.update(session, {"sheep": 4})
    assert int(sessions.advance(session, dogs, 3).flights[0].step) == 5
    with pytest.raises(Refusal, match="shape"):
        live.opening(dogs, "strombom", "odd", sheep=4, worlds=worlds)

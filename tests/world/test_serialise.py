import json
import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.world import mission
from skydog.world.laws.literal import LiteralFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.limits import AnyDirection, PerAxis
from skydog.world.presets import PRESETS, preset
from skydog.world.serialise import UnknownLaw, flatten, unflatten
from skydog.world.spread import FixedSpread, TwoThirdsSpread


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_has_finite_numbers_and_round_trips_through_json(name):
    world = preset(name)
    plain = flatten(world)
    numbers = [v for v in plain.values() if isinstance(v, float)]
    assert len(numbers) > 10
    assert all(math.isfinite(v) for v in numbers)
    assert unflatten(json.loads(json.dumps(plain, allow_nan=False))) == world


def test_a_world_of_arrays_flattens_to_plain_numbers():
    world = preset("paper", 6.0)
    arrays = jax.tree.map(jnp.float32, world)
    assert json.loads(json.dumps(flatten(arrays))) == flatten(arrays)
    rounded = {
        k: float(np.float32(v)) if type(v) is float else v for k, v in flatten(world).items()
    }
    assert flatten(arrays) == rounded


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sheep.speed", "fast"),
        ("sheep.speed", None),
        ("sheep.speed", True),
        ("sheep.speed", math.nan),
        ("arena.size", math.inf),
        ("arena.size", [4.0]),
        ("flock.law", 3),
        ("flock.law", "wolves"),
        ("dog.limits.law", None),
        ("spread.law", "N"),
        ("flock.escape", []),
        ("flock.escape", [1.0, "two"]),
        ("flock.escape", [1.0, math.nan]),
    ],
)
def test_a_parameter_of_the_wrong_kind_is_refused_by_its_name(name, value):
    plain = flatten(preset("paper"))
    with pytest.raises(Refusal, match=name):
        unflatten({**plain, name: value})


@pytest.mark.parametrize("name", ["flock.colour", "arena.size"])
def test_an_unknown_or_missing_parameter_is_refused_by_its_name(name):
    plain = flatten(preset("paper"))
    if name in plain:
        del plain[name]
    else:
        plain[name] = 1.0
    with pytest.raises(Refusal, match=name):
        unflatten(plain)


# Laws of one's own, mixed flocks, and files of before


class Own(eqx.Module):
    """A law of every kind, which no file can hold."""

    sensing: float = 3.5
    gain: float = 0.25
    table: jax.Array = eqx.field(default_factory=lambda: jnp.ones((2, 2)))

    def force(self, state, key):
        return jnp.zeros_like(state.sheep)

    def radius(self, sheep):
        return self.gain * sheep

    def way(self, world, sheep):
        return world.home.way(world, sheep)

    def accomplished(self, world, state):
        return jnp.asarray(False)

    def limit(self, velocity, speed):
        return velocity

    def fastest(self, direction, speed):
        return direction


def with_own_laws():
    world = preset("paper")
    dog = replace(world.dog, limits=Own())
    return replace(world, flock=Own(), spread=Own(), home=Own(), end=Own(), dog=dog)


def test_a_law_of_ones_own_comes_back_by_its_name_with_what_is_to_be_drawn():
    plain = flatten(with_own_laws(), sheep=5)
    assert plain["flock.gain"] == 0.25
    assert "flock.table" not in plain
    back = unflatten(json.loads(json.dumps(plain)))
    for law in (back.flock, back.home, back.end, back.dog.limits):
        assert isinstance(law, UnknownLaw)
        assert law.name.endswith("test_serialise.Own")
    assert back.flock.sensing == 3.5
    assert back.spread == FixedSpread(1.25)
    assert unflatten(flatten(back)) == back


class Never(eqx.Module):
    """An end without any number."""

    def accomplished(self, world, state):
        return jnp.asarray(False)


def test_a_law_of_ones_own_without_numbers_comes_back_too():
    plain = flatten(replace(preset("paper"), end=Never()))
    back = unflatten(json.loads(json.dumps(plain)))
    assert back.end.name.endswith("Never")
    assert back.flock == preset("paper").flock


@pytest.mark.parametrize("use", ["fly", "limit", "end", "gate"])
def test_a_law_that_came_from_a_file_refuses_to_fly_and_says_how(use):
    world, back = preset("paper"), unflatten(flatten(with_own_laws(), sheep=3))
    there = {
        "fly": replace(world, flock=back.flock),
        "limit": replace(world, dog=back.dog),
        "end": replace(world, end=back.end),
        "gate": replace(world, home=back.home),
    }[use]
    with pytest.raises(Refusal, match=r"Own .* --world FILE\.py:NAME"):
        mission.rollout(there, Strombom(), mission.reset(there, jax.random.key(0)), 3)


@pytest.mark.parametrize("name", ["own: " + "x" * 1000, "own: \x1b[31m\nred", 5, None, ["own: x"]])
def test_the_name_of_a_law_in_a_file_is_short_and_printable_or_refused(name):
    plain = {**flatten(preset("paper")), "home.law": name}
    with pytest.raises(Refusal) as refusal:
        raise Refusal(unflatten(plain).home.name)
    assert str(refusal.value).isprintable()
    assert len(str(refusal.value)) < 300


def test_a_flock_whose_sheep_differ_comes_back_sheep_by_sheep():
    world = preset("paper")
    speed = np.array([0.25, 0.5, 0.125], np.float32)
    mixed = replace(
        world,
        flock=replace(world.flock, escape=jnp.array([1.0, 0.5, 2.0])),
        sheep=replace(world.sheep, speed=speed),
    )
    back = unflatten(json.loads(json.dumps(flatten(mixed))))
    assert np.array_equal(back.flock.escape, [1.0, 0.5, 2.0])
    assert np.array_equal(back.sheep.speed, speed)


def test_of_the_worlds_of_before_each_law_is_recognised():
    old = {
        "flock.avoidance": 2.0, "flock.sensing": 65.0, "flock.inertia": 0.5,
        "flock.grouping": 1.05, "flock.escape": 1.0, "flock.repulsion": 2.0, "flock.speed": 0.75,
        "flock.spread": 1.5, "flock.noise": 0.25, "flock.graze": 0.05, "flock.neighbours": 4,
        "flock.literal_forces": False, "dog.speed": 1.5, "dog.driving": 2.0,
        "dog.collecting": 2.0, "dog.airspace": 9.0, "dog.stall": 6.0, "dog.actuation_noise": 0.0,
        "dog.perception_noise": 0.0, "dog.per_axis": False, "arena.size": 150.0,
        "arena.goal_x": 0.0, "arena.goal_y": 0.0, "arena.goal_radius": 10.0, "arena.dt": 1.0,
    }  # fmt: skip
    world = unflatten(old)
    assert isinstance(world.flock, StrombomFlock)
    assert (world.flock.graze, world.flock.neighbours, world.sheep.speed) == (0.05, 4, 0.75)
    assert (world.spread, world.dog.limits) == (TwoThirdsSpread(1.5), AnyDirection())
    printed = unflatten({**old, "flock.literal_forces": True, "dog.per_axis": True})
    assert isinstance(printed.flock, LiteralFlock)
    assert printed.dog.limits == PerAxis()
    for name, value in (("flock.literal_forces", 3), ("dog.per_axis", None)):
        with pytest.raises(Refusal, match=name):
            unflatten({**old, name: value})


class Rich(eqx.Module):
    """A law that holds what no card holds: a random key, and a long list."""

    key: jax.Array = eqx.field(default_factory=lambda: jax.random.key(0))
    weights: jax.Array = eqx.field(default_factory=lambda: jnp.ones(200_000))
    gain: float = 0.5

    def force(self, state, key):
        return jnp.zeros_like(state.sheep)


def test_of_a_law_of_ones_own_a_file_keeps_numbers_of_a_sensible_size():
    plain = flatten(replace(preset("paper"), flock=Rich()))
    assert plain["flock.gain"] == 0.5
    assert not {"flock.key", "flock.weights"} & set(plain)


def test_a_parameter_that_is_not_finite_is_refused_before_a_file_holds_it():
    world = preset("paper")
    with pytest.raises(Refusal, match=r"flock\.sensing is inf"):
        flatten(replace(world, flock=replace(world.flock, sensing=math.inf)))

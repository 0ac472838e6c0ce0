"""Sheep of many kinds: `VariedFlock` and its terms."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from drawn import mixed_scenes, numbers, scenes
from hypothesis import assume, given
from hypothesis import strategies as st

from skydog.world import mission
from skydog.world.laws import terms
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.laws.varied import VariedFlock
from skydog.world.presets import preset
from skydog.world.serialise import flatten, unflatten
from skydog.world.state import State

KEY = jax.random.key(3)
MORE = ({"follow": 0.5}, {"alignment": 1.25}, {"fading": 2.0})


@jax.jit
def force(flock, state):
    return flock.force(state, None)


def as_(law, world, **more):
    return law(**vars(world.flock), **more)


# Off


def of_three_laws(world, state):
    noisy = replace(world, flock=replace(world.flock, noise=0.25))
    return (
        as_(VariedFlock, world).force(state, None),
        as_(StrombomFlock, world).force(state, None),
        world.flock.force(state, None),
        as_(VariedFlock, noisy).force(state, KEY),
        as_(StrombomFlock, noisy).force(state, KEY),
    )


SHAPES = [(1, 1), (5, 3)]  # sheep, dogs: each compiles once


@given(scenes(shapes=SHAPES) | mixed_scenes(shapes=SHAPES))
def test_with_every_term_off_the_force_is_bit_for_bit_that_of_strombom_and_the_paper(scene):
    varied, strombom, paper, noisy, noisy_strombom = jax.jit(of_three_laws)(*scene)
    assert np.array_equal(varied, strombom)
    assert np.array_equal(varied, paper)
    assert np.array_equal(noisy, noisy_strombom)


@given(scenes(shapes=[(5, 3)]))
def test_a_weight_of_zero_is_a_term_that_is_off(scene):
    world, state = scene
    assume(not reference.force_is_close_call(world, *numbers(state)))
    off = force(as_(VariedFlock, world), state)
    zero = force(as_(VariedFlock, world, follow=0.0, alignment=0.0), state)
    np.testing.assert_allclose(zero, off, atol=1e-3)


# Against plain NumPy


def mean_direction(world, sheep, moved, i):
    """Of the nearest flockmates, or of all."""
    others = [k for k in range(len(sheep)) if k != i]
    others.sort(key=lambda k: reference.length(sheep[k] - sheep[i]))
    chosen = others[: reference.nearest(world)]
    return sum((reference.direction(moved[k]) for k in chosen), np.zeros(2))


def fading_push(sheep, others, i, radius, rate):
    push, count = np.zeros(2), 0
    for other in others:
        apart = reference.length(sheep[i] - other)
        if 0 < apart <= radius:
            push += np.exp(-rate * apart / radius) * reference.direction(sheep[i] - other)
            count += 1
    return push, count


def total(world, state, i):
    """The sum of all terms on sheep i before it is normalised, and what it is made of."""
    flock, (sheep, dogs, previous) = world.flock, numbers(state)
    own = {
        name: reference.own(value, i) for name, value in vars(flock).items() if value is not None
    }
    raw_flee, raw_crowd = reference.escape(world, sheep, dogs, i), reference.avoid(world, sheep, i)
    mean = mean_direction(world, sheep, previous, i)
    flee, crowd = reference.direction(raw_flee), reference.direction(raw_crowd)
    if "fading" in own:
        flee, _ = fading_push(sheep, dogs, i, own["sensing"], own["fading"])
        crowd, count = fading_push(sheep, sheep, i, own["avoidance"], own["fading"])
        crowd = crowd / max(1, count) ** 0.5
    force = own["inertia"] * previous[i] + own["repulsion"] * crowd
    if any(reference.length(sheep[i] - dog) <= own["sensing"] for dog in dogs):
        force = force + own["escape"] * flee + own["grouping"] * reference.group(world, sheep, i)
        force = force - own.get("follow", 0.0) * reference.direction(raw_flee)
        force = force + own.get("alignment", 0.0) * reference.direction(mean)
    elif reference.length(crowd) == 0:
        force = np.zeros(2)
    return force, (force, crowd, mean, raw_flee)


@st.composite
def varied(draw):
    """All terms, or all but fading; one number of each, or one per sheep."""
    world, state = draw(scenes(shapes=[(1, 1), (5, 3)]) | mixed_scenes(shapes=[(3, 2)]))
    count = len(state.sheep)

    def values(*choices):
        several = draw(st.lists(st.sampled_from(choices), min_size=count, max_size=count))
        return jnp.asarray(several, jnp.float32) if count == 3 else several[0]

    fading = values(0.5, 2.0) if draw(st.booleans()) else None
    more = {"follow": values(-1.0, 0.25, 1.0), "alignment": values(0.5, 1.25), "fading": fading}
    neighbours = 2 if count == 5 else None
    return replace(world, flock=as_(VariedFlock, world, neighbours=neighbours, **more)), state


@given(varied())
def test_the_force_is_the_sum_of_the_terms_as_their_sources_have_them(scene):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    found = np.asarray(force(world.flock, state))
    assert np.all(np.isfinite(found))
    for i in range(len(sheep)):
        expected, parts = total(world, state, i)
        # Of what nearly cancels, rounding decides the direction.
        assume(not any(0 < reference.length(part) < reference.CLOSE for part in parts))
        np.testing.assert_allclose(found[i], reference.direction(expected), atol=1e-3)


@pytest.mark.parametrize("count", [40, 310])
def test_a_large_flock_feels_the_same_terms(count):
    rng = np.random.default_rng(0)
    sheep, dogs = rng.uniform(0, 12, (count, 2)), rng.uniform(0, 12, (2, 2))
    moved = reference_directions(rng, count)
    state = State(*(jnp.asarray(part, jnp.float32) for part in (sheep, dogs, moved)))
    world = preset("paper", 12.0)
    for neighbours in (None, 5):
        flock = VariedFlock(
            **{**vars(world.flock), "sensing": 4.0},
            neighbours=neighbours,
            alignment=1.0,
            fading=2.0,
        )
        there = replace(world, flock=flock)
        mean = terms.align(state.sheep, state.force, neighbours)
        crowd = terms.fading_avoid(state.sheep, 1.0, 2.0)
        for i in range(0, count, 17):
            expected = reference.direction(mean_direction(there, sheep, moved, i))
            np.testing.assert_allclose(mean[i], expected, atol=1e-4)
            push, near = fading_push(sheep, sheep, i, 1.0, 2.0)
            np.testing.assert_allclose(crowd[i], push / max(1, near) ** 0.5, atol=1e-4)


def reference_directions(rng, count):
    angles = rng.uniform(0, 2 * np.pi, count)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


# What each kind of sheep does


def test_a_sheep_that_follows_at_minus_one_flees_twice_and_at_one_stands_between():
    sheep, dogs = jnp.array([[2.0, 2.0], [2.0, 3.0]]), jnp.array([[1.0, 2.0]])
    lone = VariedFlock(1.0, 2.0, inertia=0.0, grouping=1.0, escape=1.0, repulsion=0.0)
    state = mission.start(sheep, dogs)

    def sum_of(follow):
        return replace(lone, follow=follow).total(state)[0]

    escape = sum_of(0.0) - replace(lone, escape=0.0, follow=0.0).total(state)[0]
    np.testing.assert_allclose(sum_of(-1.0), sum_of(0.0) + escape, atol=1e-6)
    np.testing.assert_allclose(sum_of(1.0), sum_of(0.0) - escape, atol=1e-6)


def test_a_follower_of_strombom_walks_to_the_dog():
    follower = VariedFlock(
        1.0, 3.0, inertia=0.5, grouping=0.0, escape=0.0, repulsion=2.0, follow=1.0
    )
    state = mission.start(jnp.array([[2.0, 2.0]]), jnp.array([[0.5, 0.0]]))
    np.testing.assert_allclose(follower.force(state, None), [[-0.6, -0.8]], atol=1e-6)


def test_a_dog_that_is_further_pushes_less():
    flock = VariedFlock(1.0, 4.0, inertia=0.5, grouping=1.0, escape=1.0, repulsion=2.0, fading=2.0)

    def push(distance):
        state = mission.start(jnp.array([[5.0, 5.0]]), jnp.array([[5.0 - distance, 5.0]]))
        return float(flock.total(state)[0][0, 0])

    assert [push(d) for d in (1.0, 2.0, 4.0)] == pytest.approx([np.exp(-d / 2) for d in (1, 2, 4)])


@pytest.mark.parametrize("count", [1, 3, 40])
def test_flockmates_that_stand_and_headings_that_cancel_align_nobody(count):
    still = jnp.zeros((count, 2))
    assert np.all(np.asarray(terms.align(still, still, None)) == 0.0)
    moved = jnp.array([[0.0, 0.0], [0.6, 0.8], [-0.6, -0.8]])
    assert np.array_equal(terms.align(jnp.zeros((3, 2)), moved, None)[0], [0.0, 0.0])


@pytest.mark.parametrize("more", MORE, ids=lambda more: next(iter(more)))
def test_a_mission_with_a_term_has_finite_gradients_where_all_stand_in_one_place(more):
    world = preset("paper")
    state = mission.start(jnp.full((3, 2), 2.1), jnp.full((1, 2), 2.1))
    flock = as_(VariedFlock, world, **more)

    def end(flock):
        return jnp.sum(flock.force(replace(state, sheep=state.sheep), None))

    gradient = jax.grad(end)(jax.tree.map(jnp.float32, flock))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))


# As a file


@pytest.mark.parametrize("more", [{}, *MORE, {"follow": jnp.array([1.0, -1.0, 0.0])}])
def test_a_varied_flock_comes_back_from_a_file_with_what_is_off_still_off(more):
    world = preset("paper")
    there = replace(world, flock=as_(VariedFlock, world, **more))
    back = unflatten(json.loads(json.dumps(flatten(there)))).flock
    assert isinstance(back, VariedFlock)
    for name in ("follow", "alignment", "fading"):
        if name in more:
            np.testing.assert_array_equal(getattr(back, name), more[name])
        else:
            assert getattr(back, name) is None

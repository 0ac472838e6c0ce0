import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skydog.world import mission, neighbours
from skydog.world.laws import terms
from skydog.world.presets import preset

RADIUS = 1.0
MANY = 400
RNG = np.random.default_rng(0)


def clusters(*middles, spread=0.4):
    each = MANY // len(middles)
    return np.concatenate([middle + spread * RNG.normal(size=(each, 2)) for middle in middles])


LAYOUTS = {
    "a field": RNG.uniform(0.0, 30.0, (MANY, 2)),
    "packed into one cell": RNG.uniform(0.0, 0.5, (MANY, 2)),
    "all at one point": np.full((MANY, 2), 3.25),
    "pairs at one point": np.repeat(RNG.uniform(0.0, 20.0, (MANY // 2, 2)), 2, axis=0),
    "a line": np.stack([np.linspace(0.0, 90.0, MANY), np.zeros(MANY)], axis=1),
    "a diagonal": np.linspace(-50.0, 50.0, MANY)[:, None] * np.ones(2),
    "on the borders of cells": np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0)), -1).reshape(
        -1, 2
    ),
    "two herds far apart": clusters(np.zeros(2), np.array([1e4, -3e3])),
    "a stray at the world's end": np.concatenate([clusters(np.zeros(2))[:-1], [[1e6, 1e6]]]),
    "beyond zero": RNG.uniform(-9.0, -4.0, (MANY, 2)),
}


def agree(sheep, radius=RADIUS):
    sheep = jnp.asarray(sheep, jnp.float32)
    expected = np.asarray(neighbours.all_pairs(sheep, sheep, radius))
    # To rounding: of as many unit vectors as a sheep has neighbours.
    slack = 1e-5 * (1 + len(sheep))
    np.testing.assert_allclose(neighbours.cells(sheep, radius), expected, atol=slack)
    np.testing.assert_allclose(neighbours.blocks(sheep, radius), expected, atol=slack)
    some = neighbours.by_coordinate(sheep, sheep, radius)
    np.testing.assert_allclose(some, expected, atol=slack)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_means_pushes_as_all_pairs_do(layout):
    agree(LAYOUTS[layout])


@pytest.mark.parametrize("radius", [0.0, 1e-3, 0.3, 7.0, 1e3])
def test_at_any_radius(radius):
    agree(LAYOUTS["a field"], radius)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_of_few_sheep_too(count):
    agree(LAYOUTS["packed into one cell"][:count])


def plain_pushes(sheep, radius):
    """In plain NumPy, float64: the pushes on each sheep of those within its own radius."""
    away = sheep[:, None] - sheep[None, :]
    apart = np.linalg.norm(away, axis=-1)
    near = (apart > 0) & (apart <= radius[:, None])
    return np.where(near[..., None], away / np.where(near, apart, 1.0)[..., None], 0.0).sum(axis=1)


FEW, PAIRS = neighbours.A_FEW, neighbours.ALL_PAIRS


@settings(max_examples=30, deadline=None)
@given(
    count=st.sampled_from([1, 2, FEW - 1, FEW, FEW + 1, 77, PAIRS - 1, PAIRS, PAIRS + 1, MANY]),
    seed=st.integers(0, 2**32 - 1),
    numba=st.booleans(),
)
def test_each_sheep_is_pushed_by_those_within_its_own_radius_in_flocks_of_any_size(
    count, seed, numba
):
    drawn = np.random.default_rng(seed)
    # Off the lattice of halves by an eighth: no distance lies at the edge of a radius.
    sheep = drawn.integers(0, round(2 * np.sqrt(count)) + 2, (count, 2)) / 2.0
    radius = drawn.integers(0, 8, count) / 2.0 + 0.125
    apart = np.linalg.norm(sheep[:, None] - sheep[None, :], axis=-1)
    sheep = np.where((np.abs(apart - radius[:, None]) < 1e-3).any(axis=1)[:, None], -9.0, sheep)
    with pytest.MonkeyPatch.context() as patch:
        if not numba:
            patch.setattr(neighbours, "compiled", lambda: None)
        pushed = neighbours.pushes(jnp.asarray(sheep, jnp.float32), jnp.asarray(radius))
    # To rounding: of as many unit vectors as a sheep has neighbours.
    np.testing.assert_allclose(pushed, plain_pushes(sheep, radius), atol=1e-5 * (1 + count))


def test_under_vmap_each_flock_keeps_its_own_radii():
    flocks = jnp.asarray(np.stack([LAYOUTS["a field"], LAYOUTS["a line"]]), jnp.float32)
    radii = jnp.asarray(RNG.uniform(0.0, 3.0, (2, MANY)), jnp.float32)
    together = jax.jit(jax.vmap(neighbours.cells))(flocks, radii)
    for sheep, radius, pushed in zip(flocks, radii, together, strict=True):
        assert np.array_equal(pushed, neighbours.cells(sheep, radius))


quarters = st.integers(-8, 8).map(lambda n: n / 4)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(quarters, quarters), min_size=24, max_size=24))
def test_on_layouts_that_hypothesis_thinks_of(places):
    agree(np.array(places), radius=0.5 + 1e-4)  # no distance of theirs lies at its edge


def test_sheep_at_one_point_do_not_push_each_other():
    assert not np.asarray(neighbours.cells(jnp.full((MANY, 2), 2.5), RADIUS)).any()


def test_pushes_cancel_over_the_flock():
    pushed = neighbours.cells(jnp.asarray(LAYOUTS["a field"], jnp.float32), RADIUS)
    np.testing.assert_allclose(np.asarray(pushed).sum(axis=0), 0.0, atol=1e-3)


def test_a_position_that_is_no_number_leads_nowhere_else():
    sheep = np.array(LAYOUTS["a field"], np.float32)
    sheep[7] = np.nan
    pushed = np.asarray(neighbours.cells(jnp.asarray(sheep), RADIUS))
    assert pushed.shape == (MANY, 2)
    assert not pushed[7].any()


def test_flocks_stacked_under_vmap_are_pushed_each_by_itself():
    flocks = jnp.asarray(np.stack([LAYOUTS["a field"], LAYOUTS["a line"]]), jnp.float32)
    together = jax.jit(jax.vmap(lambda sheep: neighbours.cells(sheep, RADIUS)))(flocks)
    for sheep, pushed in zip(flocks, together, strict=True):
        assert np.array_equal(pushed, neighbours.cells(sheep, RADIUS))


# What a flock makes of it


@pytest.mark.parametrize("means", ["cells", "blocks"])
def test_a_large_flock_moves_as_if_all_pairs_were_looked_at(monkeypatch, means):
    world = preset("strombom2014", sheep=MANY)
    state = mission.reset(world, jax.random.key(0), sheep=MANY)
    assert MANY > neighbours.ALL_PAIRS
    monkeypatch.setattr(
        neighbours, "compiled", neighbours.compiled if means == "cells" else lambda: None
    )
    many = world.flock.force(state, None)
    for module in (neighbours, terms):
        monkeypatch.setattr(module, "A_FEW", 10**6)
    plain = world.flock.force(state, None)
    assert np.asarray(plain).any()
    np.testing.assert_allclose(many, plain, atol=1e-3)


def test_a_large_flock_feels_no_pull_at_one_point_and_the_nearest_only_if_told():
    assert not np.asarray(terms.group(jnp.full((MANY, 2), 1.7), None)).any()
    sheep = jnp.asarray(LAYOUTS["a field"], jnp.float32)
    nearest = np.asarray(terms.group(sheep, 1))
    apart = np.linalg.norm(LAYOUTS["a field"][:, None] - LAYOUTS["a field"], axis=2)
    np.fill_diagonal(apart, np.inf)
    way = LAYOUTS["a field"][apart.argmin(axis=1)] - LAYOUTS["a field"]
    np.testing.assert_allclose(nearest, way / np.linalg.norm(way, axis=1)[:, None], atol=1e-3)


def test_a_missing_numba_is_told_once_with_the_line_to_type(monkeypatch):
    neighbours.compiled.cache_clear()
    monkeypatch.setitem(sys.modules, "skydog.world.cells", None)
    monkeypatch.delattr("skydog.world.cells", raising=False)
    try:
        with pytest.warns(UserWarning, match=r"pip install 'skydog\[fast\]'"):
            assert neighbours.compiled() is None
        assert neighbours.compiled() is None
        sheep = jnp.asarray(LAYOUTS["a field"], jnp.float32)
        np.testing.assert_allclose(
            neighbours.pushes(sheep, RADIUS),
            neighbours.all_pairs(sheep, sheep, RADIUS),
            atol=1e-4,
        )
    finally:
        neighbours.compiled.cache_clear()

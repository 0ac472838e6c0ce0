"""Settings of jax that other programs want do not reach us."""

from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import skydog
import skydog.envs
from skydog import numerics
from skydog.errors import Refusal
from skydog.learning import train
from skydog.learning.curriculum import Curriculum
from skydog.study import cases, evaluate
from skydog.view import figures, session
from skydog.view.style import drawing
from skydog.world import trace

OTHERS = {
    "jax_enable_x64": True,
    "jax_numpy_dtype_promotion": "strict",
    "jax_numpy_rank_promotion": "raise",
    "jax_default_prng_impl": "rbg",
    "jax_threefry_partitionable": False,
    "jax_enable_custom_prng": True,
    "jax_legacy_prng_key": "error",
    "jax_default_matmul_precision": "bfloat16",
    "jax_disable_jit": True,
    "jax_debug_nans": True,
    "jax_debug_infs": True,
    "jax_debug_key_reuse": True,
    "jax_check_tracer_leaks": True,
    "jax_transfer_guard": "disallow",
    "jax_transfer_guard_host_to_device": "disallow",
    "jax_transfer_guard_device_to_host": "disallow",
    "jax_transfer_guard_device_to_device": "disallow",
}


def rollout():
    world = skydog.preset("paper")
    return skydog.rollout(world, skydog.load("h-ddpg-4x4"), skydog.reset(world, KEY), 60)


def a_step():
    world = skydog.preset("paper")
    return skydog.step(world, skydog.reset(world, KEY), NORTH_EAST)


def missions():
    world = skydog.preset("strombom2014")
    starts = cases.cases(world, 2, "random", sheep=4)
    return evaluate.measure(evaluate.fly(world, skydog.Strombom(), starts, 30, KEY))


def training():
    curriculum = Curriculum(steps=200)
    return train.train(curriculum.lesson("drive"), curriculum.config(), 0, 200)


def environments():
    env = gymnasium.make("skydog/Herd-v0")
    worlds = gymnasium.make_vec("skydog/Drive-v0", num_envs=2)
    seen = [env.reset(seed=0), env.step(np.ones(2, np.float32))]
    return [*seen, worlds.reset(seed=0), worlds.step(np.ones((2, 2), np.float32))]


def live():
    begun = session.new(session.Settings(policy="dog"))
    return session.view(session.advance(begun, {"dog": skydog.Strombom()}, 3))


KEY = jax.random.key(0)
NORTH_EAST = jnp.ones((1, 2))
USES = [rollout, a_step, missions, training, environments, live]


@pytest.mark.parametrize("use", USES, ids=lambda use: use.__name__)
def test_what_others_have_set_changes_no_figure(use):
    expected = use()
    before = {name: getattr(jax.config, name) for name in OTHERS}
    try:
        for name, value in OTHERS.items():
            jax.config.update(name, value)
        found = use()
    finally:
        for name, value in before.items():
            jax.config.update(name, value)
    for ours, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert np.asarray(ours).dtype == np.asarray(theirs).dtype
        np.testing.assert_array_equal(np.asarray(ours), np.asarray(theirs))


def test_a_key_of_plain_numbers_is_one_of_the_generator_that_was_set():
    with jax.default_prng_impl("rbg"):
        key = jax.random.PRNGKey(0)
        found = skydog.reset(skydog.preset("paper"), key).sheep
    assert key.shape == (4,)
    assert np.all(np.isfinite(found))


def test_the_caller_traces_the_pure_functions_under_strict_settings():
    world = skydog.preset("paper")
    starts = jax.vmap(lambda key: skydog.reset(world, key))(jax.random.split(KEY, 2))
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        flown = jax.vmap(lambda start: skydog.rollout(world, skydog.Strombom(), start, 5))(starts)
    assert flown.sheep.shape == (2, 6, 3, 2)


def test_every_setting_that_is_ours_is_tried():
    assert set(OTHERS) == set(numerics.SETTINGS)


@pytest.mark.parametrize("name", numerics.FIXED)
def test_a_setting_that_cannot_be_had_otherwise_is_refused_by_name(name):
    before = getattr(jax.config, name)
    jax.config.update(name, 7 if before == 0 and not isinstance(before, bool) else True)
    try:
        with pytest.raises(Refusal, match=name):
            cases.cases(skydog.preset("paper"))
    finally:
        jax.config.update(name, before)


def test_a_trace_that_was_made_in_float64_is_saved_and_read(tmp_path):
    world = skydog.preset("paper")
    with jax.enable_x64(True):
        flown = jax.jit(lambda state: skydog.rollout(world, skydog.Strombom(), state, 20))(
            jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), skydog.reset(world, KEY))
        )
        assert flown.sheep.dtype == jnp.float64
        trace.save(tmp_path / "t.safetensors", flown, "Strömbom")
    assert trace.load(tmp_path / "t.safetensors")[0].sheep.shape == flown.sheep.shape


def test_the_style_of_others_changes_no_figure():
    def drawn():
        with drawing():
            figure = Figure()
            figure.subplots().plot([0, 1], label="a")
        return figures._rendered(figure, "svg")

    expected = drawn()
    odd: Any = {"text.usetex": True, "lines.linewidth": 9, "svg.fonttype": "none", "font.size": 40}
    with matplotlib.rc_context(odd):
        assert drawn() == expected
        assert matplotlib.rcParams["font.size"] == 40

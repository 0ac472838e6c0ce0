"""Environments of mixed flocks, of dogs that do not see all, and of sheep that get used to dogs."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from skydog.envs import tasks
from skydog.envs.single import HerdingEnv
from skydog.errors import Refusal
from skydog.world.presets import preset
from skydog.world.sight import Sight

FORGETS = replace(preset("strombom2014"), sight=Sight(5.0), habituation=0.1)
FAR = {"sheep": [[100, 100], [101, 103], [104, 100]], "dogs": [[10, 10]]}


def test_a_mix_gives_each_sheep_its_own():
    task = tasks.make_task("herd", "strombom2014", sheep=5, mix={"loner": 0.4})
    assert np.asarray(task.world.flock.grouping).tolist() == pytest.approx([1.05] * 3 + [0.0] * 2)


@pytest.mark.parametrize("mix", [3, {"shy": 0.5}, {"loner": "x"}])
def test_what_is_no_mix_is_refused(mix):
    with pytest.raises(Refusal, match=r"mix|kind of sheep"):
        tasks.make_task("herd", "strombom2014", sheep=5, mix=mix)


def test_a_mix_beside_a_world_of_ones_own_is_refused():
    with pytest.raises(Refusal, match="mix; leave those out"):
        tasks.make_task("herd", world=FORGETS, mix={"loner": 0.5})


def test_sheep_that_are_placed_are_where_the_dogs_know_them_and_are_then_remembered():
    env = HerdingEnv(world=FORGETS, observation="full")
    seen, _ = env.reset(seed=0, options=FAR)
    assert seen[:6].tolist() == [90.0, 90.0, 91.0, 93.0, 94.0, 90.0]
    after, *_ = env.step(np.zeros(2, np.float32))
    assert after[:6].tolist() == pytest.approx(seen[:6].tolist())


@pytest.mark.parametrize("name", ["collect", "drive"])
def test_a_lesson_has_a_memory_too(name):
    world = replace(preset("paper"), sight=Sight(1.0), habituation=0.1)
    task = tasks.make_task(name, world=world)
    env = tasks.reset(task, jax.random.key(0))
    after, _ = jax.jit(tasks.step)(task, env, np.zeros((1, 2), np.float32))
    assert jax.tree.structure(after) == jax.tree.structure(env)
    assert np.isfinite(tasks.observe(task, after, "compact")).all()

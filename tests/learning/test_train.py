import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pytest
from toys import Count

from skydog import files
from skydog.arrays import load_arrays, save_arrays
from skydog.errors import Refusal
from skydog.learning import ddpg, dqn, history, train
from skydog.learning.lessons import Lesson
from skydog.world.presets import preset

LESSON = Lesson(preset("paper", 4.0), "drive")
CONFIG = ddpg.Config(actor=(8,), critic=(8,), memory=600)
CARD = {"skill": "drive", "sheep": 3}
STEPS = 2_500
BIAS = "history.skills.layers.linears.0.bias"


def run(folder=None, seed=4, steps=STEPS, config=CONFIG, card=CARD, **options):
    return train.train(LESSON, config, seed, steps, folder, card, **options)


@pytest.fixture(scope="module")
def uninterrupted():
    return run()


@pytest.fixture
def stopped(tmp_path):
    """The folder of a training that was stopped at 1545 of 2500 steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "CHUNK", 515)
        run(tmp_path, callback=lambda progress: progress.step < 1_545)
    return tmp_path


def assert_the_same(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert a.dtype == b.dtype
        assert np.array_equal(a, b)


def assert_the_same_run(one, other):
    assert_the_same(one[0], other[0])
    assert_the_same(one[1], other[1])


def digest(training) -> str:
    leaves = jax.tree.leaves(training)
    return hashlib.sha256(b"".join(np.asarray(leaf).tobytes() for leaf in leaves)).hexdigest()


# The same again


def test_a_stopped_run_resumes_bit_for_bit(stopped, uninterrupted):
    resumed = run(stopped, resume=True)
    assert int(resumed[0].step) == STEPS
    assert len(resumed[1].reward) == 50
    assert_the_same_run(resumed, uninterrupted)


def test_how_a_run_is_cut_into_chunks_does_not_matter(monkeypatch, uninterrupted):
    monkeypatch.setattr(train, "CHUNK", 625)
    assert_the_same_run(run(), uninterrupted)


def test_the_skill_on_the_way_is_kept_however_a_run_is_cut(monkeypatch, tmp_path, uninterrupted):
    at = {steps: run(steps=steps)[0].agent.skill for steps in (0, 1_500)}
    monkeypatch.setattr(history, "SNAPSHOT", 1_500)  # no multiple of a chunk
    run(tmp_path, callback=lambda _: False)
    training, found = run(tmp_path, resume=True)
    assert_the_same(training, uninterrupted[0])
    assert found.step.tolist() == list(at)
    for step, skill in at.items():
        assert_the_same(found.skill(step), skill)


def test_a_run_from_before_skills_were_kept_resumes_without_them(stopped, uninterrupted):
    damaged(stopped, lambda arrays: [arrays.pop(name) for name in kept(arrays)])
    training, history = run(stopped, resume=True)
    assert_the_same(training, uninterrupted[0])
    assert history.step.size == 0
    assert_the_same(history.reward, uninterrupted[1].reward)


def test_the_same_seed_gives_the_same_run_and_another_another(uninterrupted):
    again, other = run(steps=1_000), run(seed=5, steps=1_000)
    assert digest(again[0]) == digest(run(steps=1_000)[0])
    assert digest(again[0]) != digest(other[0])
    assert np.array_equal(again[1].reward, uninterrupted[1].reward[: len(again[1].reward)])


def test_a_run_is_the_same_on_one_core_and_on_several(tmp_path):
    code = (
        "import os, sys\n"
        "cores = sorted(os.sched_getaffinity(0))[: int(sys.argv[1])]\n"
        "os.sched_setaffinity(0, cores)\n"
        f"sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        "import test_train as t\n"
        "print(t.digest(t.run(steps=1000)[0]))\n"
    )
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    if cores < 2:
        pytest.skip("needs two cores")
    runs = [
        subprocess.Popen([sys.executable, "-c", code, count], stdout=subprocess.PIPE, text=True)
        for count in ("1", "2")
    ]
    found = [process.communicate(timeout=120)[0].strip() for process in runs]
    assert len(found[0]) == 64
    assert found[0] == found[1]


def test_resuming_a_finished_run_changes_nothing(tmp_path):
    first = run(tmp_path, steps=1_000)
    before = train.checkpoint_in(tmp_path).read_bytes()
    assert_the_same_run(run(tmp_path, steps=1_000, resume=True), first)
    assert train.checkpoint_in(tmp_path).read_bytes() == before


def test_resuming_where_nothing_is_starts_anew(tmp_path, uninterrupted):
    assert_the_same_run(run(tmp_path / "new", resume=True), uninterrupted)


def test_a_stop_is_heard_after_the_chunk_in_hand_and_kept(stopped):
    blank = train.init(LESSON, CONFIG, jax.random.key(0))
    card = {**CARD, "seed": 4}
    training, history = train.load(stopped, blank, card)
    assert int(training.step) == 1_545
    assert int(training.memory.written) == 1_545
    assert history.length.tolist() == [50] * 30
    assert int(training.length) == 45


# What is refused


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"seed": 5}, "seed 4"),
        ({"card": {**CARD, "sheep": 4}}, "sheep 3"),
        ({"card": {**CARD, "skill": "collect"}}, "skill 'drive'"),
        ({"config": replace(CONFIG, discount=0.5)}, "config"),
    ],
)
def test_a_run_of_other_options_is_not_resumed_and_left_as_it_was(stopped, options, named):
    checkpoint = train.checkpoint_in(stopped)
    before = {path: path.read_bytes() for path in stopped.iterdir()}
    with pytest.raises(Refusal, match=named) as refusal:
        run(stopped, resume=True, **options)
    assert str(checkpoint) in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert {path: path.read_bytes() for path in stopped.iterdir()} == before


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.999])
def test_a_truncated_checkpoint_is_refused_and_left_as_it_was(stopped, share):
    checkpoint = train.checkpoint_in(stopped)
    whole = checkpoint.read_bytes()
    cut = whole[: int(share * len(whole))]
    checkpoint.write_bytes(cut)
    with pytest.raises(Refusal) as refusal:
        run(stopped, resume=True)
    assert str(checkpoint) in str(refusal.value)
    assert checkpoint.read_bytes() == cut


def kept(arrays):
    """The names of the skills that a history keeps, and of their steps."""
    return [name for name in arrays if name.startswith(("history.step", "history.skills"))]


def damaged(folder, change):
    path = train.checkpoint_in(folder)
    arrays, card = load_arrays(path, train.KIND)
    change(arrays)
    save_arrays(path, arrays, card)


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays: arrays.pop("history.length"),
        lambda arrays: arrays.pop("agent.updates"),
        lambda arrays: arrays.update(extra=np.zeros(3)),
        lambda arrays: arrays.update(reward=np.zeros(2, np.float32)),
        lambda arrays: arrays.update(step=arrays["step"].astype(np.int64)),
        lambda arrays: arrays.update({"history.length": np.zeros(3, np.int32)}),
        lambda arrays: arrays.update({"history.reward": np.array([b"x"] * 7)[:, None] == b"x"}),
        lambda arrays: arrays.pop("history.step"),
        lambda arrays: arrays.update({"history.step": np.arange(2, dtype=np.int32)}),
        lambda arrays: arrays.update({BIAS: arrays[BIAS][:, :1]}),
        lambda arrays: arrays.update({name: arrays[name].repeat(2, 0) for name in kept(arrays)}),
    ],
    ids=[
        "no history",
        "a missing leaf",
        "an unknown leaf",
        "a leaf of another shape",
        "a leaf of another kind",
        "a history of unequal lengths",
        "a history of another kind",
        "skills of unknown steps",
        "more steps than skills",
        "a skill of another shape",
        "the same step twice",
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused(stopped, change):
    damaged(stopped, change)
    with pytest.raises(Refusal, match="train again"):
        run(stopped, resume=True)


# What is kept


def test_the_curve_has_a_row_every_ten_episodes_and_agrees_with_the_history(tmp_path):
    _, history = train.train(Count(cut=7), CONFIG, 0, 250, tmp_path)
    head, *lines = (tmp_path / "curve.csv").read_text().splitlines()
    assert head == "episode,reward_per_action,success"
    assert len(history.length) == 250 // 7
    assert len(lines) == len(history.length) // 10
    for row, line in enumerate(lines):
        episode, reward, success = map(float, line.split(","))
        ten = slice(10 * row, 10 * row + 10)
        assert episode == 10 * row + 10
        assert np.isclose(reward, history.reward[ten].sum() / history.length[ten].sum(), rtol=1e-5)
        assert success == history.success[ten].mean()
    assert np.allclose(history.reward, 28.0)  # 1 + 2 + ... + 7


def test_a_callback_hears_of_every_chunk(monkeypatch, uninterrupted):
    monkeypatch.setattr(train, "CHUNK", 1_000)
    monkeypatch.setattr(train, "RECENT", 10)
    heard = []
    _, history = run(callback=lambda progress: heard.append(progress) or True)
    assert [progress.step for progress in heard] == [1_000, 2_000, 2_500]
    assert {progress.steps for progress in heard} == {STEPS}
    assert [progress.episodes for progress in heard] == [20, 40, 50]
    last = slice(-10, None)
    mean = history.reward[last].sum() / history.length[last].sum()
    assert np.isclose(heard[-1].reward_per_action, mean)
    assert heard[-1].success == history.success[last].mean()


def test_a_callback_has_the_skill_as_it_is_then(uninterrupted):
    seen, acts = jax.numpy.ones(4), []
    training, _ = run(callback=lambda progress: acts.append(progress.skill(seen)) or True)
    assert len(acts) == 3
    assert not np.array_equal(acts[0], acts[1])
    assert np.array_equal(acts[-1], training.agent.skill(seen))


def test_checkpoints_are_written_on_the_way(monkeypatch, tmp_path):
    monkeypatch.setattr(train, "CHUNK", 515)
    monkeypatch.setattr(train, "CHECKPOINT", 1_000)
    sizes = []
    checkpoint = train.checkpoint_in(tmp_path)
    run(tmp_path, steps=2_000, callback=lambda _: sizes.append(checkpoint.exists()) or True)
    assert sizes == [False, False, True, True]


def test_a_checkpoint_that_cannot_be_replaced_leaves_the_old_one(monkeypatch, stopped):
    before = {path.name: path.read_bytes() for path in stopped.iterdir()}

    def fails(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "replace", fails)
    with pytest.raises(Refusal, match="No space left on device"):
        run(stopped, resume=True)
    assert {path.name: path.read_bytes() for path in stopped.iterdir()} == before


@pytest.mark.parametrize("config", [CONFIG, dqn.Config(network=(8,))], ids=["ddpg", "dqn"])
def test_the_loop_is_compiled_once(config):
    loop: Any = train.advance
    loop.clear_cache()
    training, key = train.init(LESSON, config, jax.random.key(0)), jax.random.key(1)
    for _ in range(3):
        training, _ = train.advance(LESSON, config, training, key, 10)
    assert loop._cache_size() == 1


def test_several_seeds_in_one_call_learn_what_each_learns_alone():
    keys = jax.random.split(jax.random.key(3), 3)
    trainings = jax.vmap(lambda key: train.init(LESSON, CONFIG, key))(keys)
    together, _ = jax.vmap(lambda one, key: train.advance(LESSON, CONFIG, one, key, 60))(
        trainings, keys
    )
    for seed, key in enumerate(keys):
        alone, _ = train.advance(LESSON, CONFIG, train.init(LESSON, CONFIG, key), key, 60)
        for many, one in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            np.testing.assert_allclose(many[seed], one, rtol=1e-3, atol=1e-4)

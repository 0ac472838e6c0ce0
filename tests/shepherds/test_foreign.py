"""Policies of other libraries as shepherds."""

import jax
import numpy as np
import pytest

import skydog
from skydog.errors import Refusal
from skydog.shepherds import observing, sheepdog, store
from skydog.study import evaluate
from skydog.study.cases import cases
from skydog.world import herding, mission
from skydog.world.presets import preset

WORLD = preset("paper", 4.0)
STARTS = cases(WORLD, 3)
STEPS = 12


def to_subgoal(seen):
    """NumPy: the last two numbers of a compact observation lead from the subgoal to the dog."""
    return np.clip(-seen[:, 2:4] / 0.1, -1.0, 1.0)


def same(world, state):
    """The same in jax."""
    subgoal, _ = herding.gate(world, state.sheep, state.dogs)
    return observing.velocity(world, -(state.dogs - subgoal) / 0.1)


def test_a_policy_flies_as_the_same_rule_does_and_is_called_once_a_step_for_all_missions():
    shapes = []

    def asked(seen):
        shapes.append(seen.shape)
        return to_subgoal(seen), None  # as Stable-Baselines3 answers

    flown = evaluate.fly(WORLD, skydog.from_policy(asked), STARTS, STEPS, None, None)
    there = evaluate.fly(WORLD, same, STARTS, STEPS, None, None)
    assert np.allclose(flown.dogs, there.dogs, atol=1e-5)
    assert set(shapes) == {(1, 4), (3, 4)}
    assert shapes.count((1, 4)) == 1
    assert STEPS <= shapes.count((3, 4)) <= STEPS + evaluate.FOREIGN_CHUNK


def test_it_flies_a_rollout_under_vmap_as_one_batch():
    policy = skydog.from_policy(to_subgoal)
    start = jax.tree.map(lambda leaf: leaf[0], STARTS)
    one = skydog.rollout(WORLD, policy, start, 3)
    three = jax.vmap(lambda state: skydog.rollout(WORLD, policy, state, 3))(STARTS)
    assert np.allclose(three.dogs[0], one.dogs)


def test_a_policy_may_compute_in_jax_itself():
    net = jax.jit(lambda seen: -jax.numpy.tanh(seen[:, 2:4]))
    start = jax.tree.map(lambda leaf: leaf[0], STARTS)
    assert skydog.rollout(WORLD, skydog.from_policy(net), start, 3).dogs.shape == (4, 1, 2)


def test_it_sees_what_the_environment_shows_and_acts_as_there():
    import gymnasium

    import skydog.envs

    seen, how = [], "full"

    def asked(observation):
        seen.append(observation)
        return np.full((len(observation), 2), 0.25)

    env = gymnasium.make("skydog/Herd-v0", observation=how, arena=4.0)
    start = jax.tree.map(lambda leaf: leaf[0], STARTS)
    shown, _ = env.reset(seed=0, options={"sheep": start.sheep, "dogs": start.dogs})
    velocity = skydog.from_policy(asked, how, divide_by=4.0)(WORLD, start)
    assert np.allclose(4.0 * seen[-1][0], shown, atol=1e-6)
    after = mission.step(WORLD, start, velocity)
    shown, *_ = env.step(np.full(2, 0.25, np.float32))
    subgoal, _ = herding.gate(WORLD, after.sheep, after.dogs)
    assert np.allclose(observing.observe(WORLD, after, subgoal, how)[0], shown, atol=1e-5)


def test_what_it_sees_of_several_dogs_is_seen_from_each():
    start = jax.tree.map(lambda leaf: leaf[0], cases(WORLD, 1, dogs=2))
    seen = []

    def asked(observation):
        seen.append(observation)
        return observation[:, :2]

    assert skydog.from_policy(asked)(WORLD, start).shape == (2, 2)
    subgoal, _ = herding.gate(WORLD, start.sheep, start.dogs)
    expected = sheepdog.observe(start.sheep, start.dogs, subgoal)
    assert np.allclose(seen[-1], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (lambda seen: seen[:, :3], r"two numbers, x and y"),
        (lambda seen: 1 / 0, "ZeroDivisionError"),
        (lambda seen: "left", "ValueError"),
    ],
)
def test_an_answer_that_is_no_action_is_refused(answer, says):
    start = jax.tree.map(lambda leaf: leaf[0], STARTS)
    with pytest.raises(Refusal, match=says):
        skydog.from_policy(answer)(WORLD, start)


def test_a_policy_that_fails_under_way_is_refused_too():
    answers = iter(range(3))

    def tires(seen):
        next(answers)
        return seen[:, :2]

    with pytest.raises(Refusal, match=r"failed on arrays.*StopIteration"):
        skydog.rollout(WORLD, skydog.from_policy(tires), jax.tree.map(lambda x: x[0], STARTS), 3)


def test_a_dog_hovers_on_an_action_that_is_no_number():
    start = jax.tree.map(lambda leaf: leaf[0], STARTS)
    flown = skydog.from_policy(lambda seen: np.full((len(seen), 2), np.nan))(WORLD, start)
    assert not np.any(flown)


def test_a_policy_inside_a_shepherd_is_sent_to_from_policy():
    def shepherd(world, state):
        return to_subgoal(np.asarray(state.dogs))

    start = jax.tree.map(lambda leaf: leaf[0], STARTS)
    with pytest.raises(Refusal, match=r"shepherd cannot be compiled.*skydog\.from_policy"):
        skydog.rollout(WORLD, shepherd, start, 3)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("given", "says"),
    [
        ((7,), "a policy is a function"),
        ((to_subgoal, "all"), "compact, full"),
        ((to_subgoal, "full", 0.0), "0.0"),
        (("nowhere.py:predict",), "no file"),
    ],
)
def test_what_is_no_policy_is_refused(given, says):
    with pytest.raises(Refusal, match=says):
        skydog.from_policy(*given)


@pytest.mark.usefixtures("unchecked")
def test_a_shepherd_that_has_no_file_is_not_saved(tmp_path):
    with pytest.raises(Refusal, match="Strombom has no file"):
        store.save(tmp_path / store.FILE, skydog.Strombom(), {})  # pyright: ignore[reportArgumentType]

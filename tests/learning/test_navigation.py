from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.learning import navigation
from skydog.learning.curriculum import Curriculum
from skydog.world import obstacles


@pytest.fixture(scope="module")
def lesson(unchecked):
    """The lesson in four scenes, one of each kind."""
    with pytest.MonkeyPatch.context() as few:
        few.setattr(navigation, "SCENES", 4)
        return navigation.lesson.__wrapped__()


@pytest.fixture(scope="module")
def episodes(lesson):
    return jax.vmap(lesson.start)(jax.random.split(jax.random.key(0), 200))


def test_an_episode_starts_outside_obstacles_and_the_goal_with_a_way_home(lesson, episodes):
    def standing(episode):
        still = replace(episode, drifts=jnp.asarray(False))
        return obstacles.clearance(lesson._walls(still), episode.place[None])[0]

    assert np.all(jax.vmap(standing)(episodes) > 0.0)
    far = jax.vmap(lesson.distance)(episodes)
    assert np.all(np.isfinite(far) & (far > navigation.GOAL_RADIUS))


def test_the_reward_is_what_was_gained_on_the_way_home_less_the_time(lesson, episodes):
    after, outcome = jax.vmap(lesson.step)(episodes, jnp.ones((200, 2)))
    gained = jax.vmap(lesson.distance)(episodes) - jax.vmap(lesson.distance)(after)
    np.testing.assert_allclose(outcome.reward, gained - navigation.STEP_COST, atol=1e-6)


def test_the_dog_turns_no_faster_than_it_flies_around_the_point(lesson, episodes):
    after, _ = jax.vmap(lesson.step)(episodes, -jnp.ones((200, 2)))
    assert np.max(np.abs(after.heading - episodes.heading)) <= navigation.TURN + 1e-5
    moved = np.linalg.norm(after.place - episodes.place, axis=1)
    assert np.max(moved) <= navigation.STRIDE + navigation.DISCS[1]  # pushed by a disc at most


def test_only_arriving_ends_the_task_and_the_horizon_the_time(lesson, episodes):
    one = jax.tree.map(lambda leaf: leaf[0], episodes)
    goal = lesson.scenes.goal[one.scene]
    late = replace(one, step=jnp.asarray(navigation.HORIZON - 1), drifts=jnp.asarray(False))
    for episode, ends in ((late, (False, True)), (replace(late, place=goal), (True, False))):
        _, outcome = lesson.step(episode, jnp.zeros(2))
        assert (bool(outcome.terminated), bool(outcome.truncated)) == ends
        assert bool(outcome.success) == ends[0]


def test_discs_move_in_half_of_the_episodes(lesson, episodes):
    later = eqx.tree_at(lambda e: e.step, episodes, episodes.step + 10)
    ends = [jax.vmap(lambda e: lesson._walls(e).ends)(one) for one in (episodes, later)]
    moves = np.any(np.asarray(ends[0]) != np.asarray(ends[1]), axis=(1, 2, 3))
    np.testing.assert_array_equal(moves, episodes.drifts)
    assert 60 < moves.sum() < 140


def test_the_lesson_is_always_the_same(lesson):
    with pytest.MonkeyPatch.context() as few:
        few.setattr(navigation, "SCENES", 4)
        again = navigation.lesson.__wrapped__()
    for one, other in zip(jax.tree.leaves(lesson), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_sheepdog_is_taught_to_navigate_only_if_it_is_asked_to():
    assert Curriculum().skills == ("collect", "drive")
    assert Curriculum(navigates=True).skills == ("collect", "drive", "navigate")
    assert Curriculum(navigates=True).config("drive") == Curriculum().config("drive")
    assert Curriculum(navigates=True).card() == Curriculum().card()


def test_dhrl_cannot_navigate():
    with pytest.raises(Refusal, match="use --learner ddpg"):
        Curriculum(learner="dqn", navigates=True)

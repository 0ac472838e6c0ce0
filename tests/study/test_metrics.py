import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.study import metrics
from skydog.world.presets import preset
from skydog.world.trace import Trace


def made_by_hand(centres, dogs, accomplished_at=None, subgoal=None, command=None):
    """A trace of two sheep half a metre either side of `centres`, and of dogs as given."""
    centres, dogs = np.array(centres, np.float32), np.array(dogs, np.float32)
    instants = len(centres)
    aside = np.array([[0.0, 0.5], [0.0, -0.5]], np.float32)
    done = np.arange(instants) >= (instants if accomplished_at is None else accomplished_at)
    return Trace(
        world=preset("paper", 10.0),
        time=jnp.arange(instants) * 0.1,
        sheep=jnp.asarray(centres[:, None] + aside),
        dogs=jnp.asarray(dogs),
        subgoal=jnp.zeros(dogs.shape) if subgoal is None else jnp.asarray(subgoal),
        drives=jnp.zeros(dogs.shape[:-1], bool),
        command=jnp.zeros(dogs.shape) if command is None else jnp.asarray(command),
        accomplished=jnp.asarray(done),
    )


COMING = [[5.0, 0.0], [4.0, 0.0], [3.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 0.0]]
STAYING = [[5.0, 0.0]] * 6
STANDING = [[[0.0, 0.0]]] * 6


def test_an_accomplished_mission_took_the_steps_up_to_its_end():
    trace = made_by_hand(COMING, STANDING, accomplished_at=4)
    assert metrics.success(trace)
    assert metrics.steps(trace) == 4


def test_a_mission_that_failed_counts_all_the_steps_that_it_was_given():
    trace = made_by_hand(STAYING, STANDING)
    assert not metrics.success(trace)
    assert metrics.steps(trace) == 5
    assert metrics.steps_gcm(trace) == 5


def test_the_paper_counts_until_the_centre_is_within_the_goal_disc_border_included():
    assert metrics.steps_gcm(made_by_hand(COMING, STANDING, accomplished_at=4)) == 3


def test_a_centre_that_arrives_and_leaves_again_has_arrived():
    there_and_back = [[3.0, 0.0], [1.0, 0.0], [3.0, 0.0]]
    assert metrics.steps_gcm(made_by_hand(there_and_back, [[[0.0, 0.0]]] * 3)) == 1


def test_a_mission_accomplished_at_its_start_took_no_steps():
    trace = made_by_hand([[0.0, 0.0]] * 3, [[[0.0, 0.0]]] * 3, accomplished_at=0)
    assert metrics.success(trace)
    assert metrics.steps(trace) == 0
    assert metrics.steps_gcm(trace) == 0


def test_the_distance_is_that_flown_and_not_that_between_start_and_end():
    there_and_back = [[[0.0, 0.0]], [[3.0, 4.0]], [[0.0, 0.0]], [[0.0, 1.0]]]
    assert metrics.distance(made_by_hand(STAYING[:4], there_and_back)) == pytest.approx(11.0)


def test_the_distances_of_several_dogs_add_up():
    dogs = [[[0.0, 0.0], [5.0, 5.0]], [[3.0, 4.0], [5.0, 5.0]], [[3.0, 4.0], [5.0, 7.0]]]
    assert metrics.distance(made_by_hand(STAYING[:3], dogs)) == pytest.approx(7.0)


def along_x(*xs):
    """One dog on the x axis, instant by instant."""
    return np.array([[[x, 0.0]] for x in xs], np.float32)


def test_the_papers_reward_pays_each_step_that_leads_no_further_from_the_subgoal():
    # Nearer, the same, further, nearer: three of four.
    trace = made_by_hand(STAYING[:5], along_x(4, 3, 3, 4, 2))
    assert metrics.cumulative_reward(trace) == pytest.approx(0.2)


def test_the_papers_reward_measures_each_distance_to_the_subgoal_of_its_own_instant():
    # The dog stands; its subgoal comes nearer, and goes further away.
    trace = made_by_hand(STAYING[:3], along_x(0, 0, 0), subgoal=along_x(3, 2, 4))
    assert metrics.cumulative_reward(trace) == pytest.approx(0.0)


def test_nothing_is_paid_or_counted_after_the_mission_is_accomplished():
    dogs = along_x(4, 3, 2, 2, 2, 2)
    trace = made_by_hand(COMING, dogs, accomplished_at=2, command=along_x(-10, -10, 0, 9, 9, 9))
    assert metrics.cumulative_reward(trace) == pytest.approx(0.2)
    assert metrics.dog_to_subgoal(trace) == pytest.approx(3.5)  # 4 and 3 metres
    assert metrics.error_per_step(trace) == pytest.approx(0.0, abs=1e-6)


def test_two_dogs_are_paid_their_mean():
    dogs = np.concatenate([along_x(4, 3, 2), along_x(4, 5, 6)], axis=1)
    assert metrics.cumulative_reward(made_by_hand(STAYING[:3], dogs)) == pytest.approx(0.0)


def test_the_error_of_a_step_is_how_far_the_dog_came_from_where_it_was_told_to():
    # Told to fly 1 m/s for 0.1 s twice: it went 0.3 m further, then nowhere.
    dogs = along_x(0.0, 0.4, 0.4)
    trace = made_by_hand(STAYING[:3], dogs, command=along_x(1.0, 1.0, 0.0))
    assert metrics.error_per_step(trace) == pytest.approx((0.3 + 0.1) / 2, abs=1e-6)


def test_the_distance_to_the_subgoal_is_that_as_each_step_begins():
    trace = made_by_hand(STAYING[:4], along_x(4, 3, 1, 9))
    assert metrics.dog_to_subgoal(trace) == pytest.approx((4 + 3 + 1) / 3)


def test_the_centre_comes_nearer_by_its_way_over_the_steps():
    trace = made_by_hand(COMING, STANDING, accomplished_at=4)
    assert metrics.centre_to_target(trace) == pytest.approx((5.0 - 1.0) / 4)


def test_a_mission_that_starts_at_home_has_the_least_ratio():
    trace = made_by_hand([[0.5, 1.0]] * 3, [[[0.0, 0.0]]] * 3, accomplished_at=0)
    assert metrics.steps_ratio(trace) == 1.0
    for metric in (metrics.centre_to_target, metrics.error_per_step):
        assert metric(trace) == 0.0


@pytest.mark.parametrize(
    ("dogs", "degrees"),
    [
        ([[0, 0], [1, 0], [2, 0], [3, 0]], 0.0),
        ([[0, 0], [1, 0], [1, 1], [2, 1], [2, 2]], 90.0),
        ([[0, 0], [1, 0], [0, 0]], 180.0),
        ([[0, 0], [1, 0], [2, 1]], 45.0),
        ([[0, 0], [1, 0], [1, 0], [1, 1]], 0.0),
        ([[0, 0], [0, 0], [0, 0]], 0.0),
    ],
    ids=["straight", "zigzag", "back", "aslant", "after a rest", "standing"],
)
def test_a_dog_turns_by_the_mean_angle_between_steps(dogs, degrees):
    path = np.array(dogs, float)[:, None]
    assert metrics.turn(made_by_hand([[5.0, 0.0]] * len(path), path)) == pytest.approx(degrees)


def test_metrics_of_stacked_traces_are_those_of_each():
    one = made_by_hand(COMING, STANDING, accomplished_at=4)
    other = made_by_hand(STAYING, [[[float(i), 0.0]] for i in range(6)])
    both = jax.tree.map(lambda a, b: jnp.stack([jnp.asarray(a), jnp.asarray(b)]), one, other)
    assert jax.vmap(metrics.success)(both).tolist() == [True, False]
    assert jax.vmap(metrics.steps)(both).tolist() == [4, 5]
    assert jax.vmap(metrics.steps_gcm)(both).tolist() == [3, 5]
    assert jax.vmap(metrics.distance)(both).tolist() == [0.0, 5.0]

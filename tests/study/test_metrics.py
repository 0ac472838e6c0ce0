import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.study import metrics
from skydog.world.mission import Trace
from skydog.world.params import preset


def made_by_hand(centres, dogs, accomplished_at=None):
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
        subgoal=jnp.zeros(dogs.shape),
        drives=jnp.zeros(dogs.shape[:-1], bool),
        command=jnp.zeros(dogs.shape),
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


def test_metrics_of_stacked_traces_are_those_of_each():
    one = made_by_hand(COMING, STANDING, accomplished_at=4)
    other = made_by_hand(STAYING, [[[float(i), 0.0]] for i in range(6)])
    both = jax.tree.map(lambda a, b: jnp.stack([jnp.asarray(a), jnp.asarray(b)]), one, other)
    assert jax.vmap(metrics.success)(both).tolist() == [True, False]
    assert jax.vmap(metrics.steps)(both).tolist() == [4, 5]
    assert jax.vmap(metrics.steps_gcm)(both).tolist() == [3, 5]
    assert jax.vmap(metrics.distance)(both).tolist() == [0.0, 5.0]

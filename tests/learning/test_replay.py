import jax
import jax.numpy as jnp
import numpy as np

from skydog.learning import replay
from skydog.learning.replay import Transition

CAPACITY = 10
add, sample = jax.jit(replay.add), jax.jit(replay.sample)


def transition(number: float) -> Transition:
    """Every field tells which transition it is of, and which field it is."""
    return Transition(
        observation=jnp.array([number, number + 0.1, number + 0.2]),
        action=jnp.array([number + 0.3, number + 0.4]),
        reward=jnp.asarray(number + 0.5),
        next_observation=jnp.array([number + 0.6, number + 0.7, number + 0.8]),
        terminated=jnp.asarray(number % 2.0),
    )


def memory_of(count: int) -> replay.Replay:
    memory = replay.empty(CAPACITY, transition(0.0))
    for number in range(1, count + 1):
        memory = add(memory, transition(float(number)))
    return memory


def drawn(memory, picks):
    return sample(memory, jnp.asarray(picks, jnp.float32), transition(0.0))


EVERY_ROW = (np.arange(CAPACITY) + 0.5) / CAPACITY
EDGES = [0.0, 0.999999, float(np.nextafter(np.float32(1), np.float32(0)))]


def test_a_full_memory_holds_the_latest_transitions_and_no_other():
    batch = drawn(memory_of(27), EVERY_ROW)
    assert sorted(batch.observation[:, 0].tolist()) == list(range(18, 28))


def test_a_memory_that_is_not_full_gives_stored_transitions_only():
    for stored in (1, 2, 9):
        picks = np.concatenate([np.linspace(0, 0.9999, 200), EDGES])
        found = set(drawn(memory_of(stored), picks).observation[:, 0].tolist())
        assert found == set(range(1, stored + 1))


def test_every_field_of_a_transition_comes_back_in_its_place():
    batch = drawn(memory_of(14), EVERY_ROW)
    for row, number in enumerate(batch.observation[:, 0].tolist()):
        for found, stored in zip(
            jax.tree.leaves(batch), jax.tree.leaves(transition(number)), strict=True
        ):
            assert np.array_equal(found[row], stored)


def test_transitions_are_drawn_uniformly():
    draws = 20_000
    picks = jax.random.uniform(jax.random.key(0), (draws,))
    found = np.asarray(drawn(memory_of(23), picks).observation[:, 0]).astype(int)
    counts = np.bincount(found - 14, minlength=CAPACITY)
    chi_square = np.sum((counts - draws / CAPACITY) ** 2 / (draws / CAPACITY))
    assert chi_square < 27.9  # the 99.9 % point of 9 degrees of freedom


def test_counting_goes_on_when_the_memory_is_full():
    assert int(memory_of(27).written) == 27

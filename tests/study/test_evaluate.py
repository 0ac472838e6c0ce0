from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate
from skydog.study.cases import cases
from skydog.world import mission
from skydog.world.presets import preset
from skydog.world.trace import Trace

WORLD = preset("paper", 4.0)
CAP = 10


def a_trace(done_at: int | None, stride: float) -> Trace:
    """A dog that flies `stride` metres a step until its mission is done, if ever."""
    instants = np.arange(CAP + 1)
    last = CAP if done_at is None else done_at
    x = stride * np.minimum(instants, last)
    dogs = np.stack([x, np.zeros_like(x)], axis=-1)[:, None]
    near = np.array([[0.1, 0.1], [0.2, 0.1], [0.1, 0.2]])
    arrived = instants >= (CAP + 1 if done_at is None else done_at)
    # The centre is home a step before the last sheep.
    home = instants >= (CAP + 1 if done_at is None else done_at - 1)
    sheep = np.where(home[:, None, None], near, near + 3.0)
    return Trace(
        world=WORLD,
        time=jnp.asarray(0.1 * instants, jnp.float32),
        sheep=jnp.asarray(sheep, jnp.float32),
        dogs=jnp.asarray(dogs, jnp.float32),
        subgoal=jnp.zeros((CAP + 1, 1, 2)),
        drives=jnp.ones((CAP + 1, 1), bool),
        command=jnp.zeros((CAP + 1, 1, 2)),
        accomplished=jnp.asarray(arrived),
    )


def stacked(*traces: Trace) -> Trace:
    return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(x) for x in leaves]), *traces)


def test_a_row_measures_every_case_and_counts_a_failure_with_all_its_steps():
    row = evaluate.row(stacked(a_trace(4, 0.5), a_trace(7, 0.1), a_trace(None, 0.2)))
    assert row["success"] == pytest.approx(2 / 3)
    assert row["cases"] == 3
    expected = {"steps": [4, 7, CAP], "steps_gcm": [3, 6, CAP], "distance": [2.0, 0.7, 2.0]}
    for name, values in expected.items():
        assert row[name]["mean"] == pytest.approx(np.mean(values), rel=1e-5)
        assert row[name]["sd"] == pytest.approx(np.std(values, ddof=1), rel=1e-5)
        low, high = row[name]["ci95"]
        assert min(values) - 1e-5 <= low < row[name]["mean"] < high <= max(values) + 1e-5


@pytest.mark.parametrize(("done_at", "success", "steps"), [(4, 1.0, 4), (None, 0.0, CAP)])
def test_a_single_case_has_no_spread(done_at, success, steps):
    row = evaluate.row(stacked(a_trace(done_at, 0.5)))
    assert (row["success"], row["cases"]) == (success, 1)
    assert row["steps"] == {"mean": steps, "sd": 0.0, "ci95": [steps, steps]}


def test_flown_together_cases_go_as_each_alone():
    starts = cases(WORLD, 3)
    together = evaluate.fly(WORLD, Strombom(), starts, 30)
    for case in range(3):
        one = jax.tree.map(lambda leaf, case=case: leaf[case], starts)
        alone = jax.jit(mission.rollout, static_argnames="steps")(WORLD, Strombom(), one, 30)
        np.testing.assert_allclose(together.sheep[case], alone.sheep, atol=1e-3)


def test_a_shepherd_that_reads_what_has_changed_flies_as_it_is_now():
    gain = [1.0]

    def shepherd(world, state):
        return gain[0] * Strombom()(world, state)

    starts = cases(WORLD, 2)
    assert (evaluate.fly(WORLD, shepherd, starts, 5).dogs[:, -1] != starts.dogs).any()
    gain[0] = 0.0
    assert np.array_equal(evaluate.fly(WORLD, shepherd, starts, 5).dogs[:, -1], starts.dogs)


def test_noise_is_drawn_anew_for_every_case_and_only_with_a_key():
    noisy = replace(WORLD, dog=replace(WORLD.dog, actuation_noise=0.2))
    one = jax.tree.map(lambda leaf: leaf[:1], cases(WORLD, 1))
    twins = jax.tree.map(lambda leaf: jnp.concatenate([leaf, leaf]), one)
    quiet = evaluate.fly(noisy, Strombom(), twins, 20)
    assert np.array_equal(quiet.dogs[0], quiet.dogs[1])
    shaken = evaluate.fly(noisy, Strombom(), twins, 20, key=jax.random.key(0))
    assert not np.array_equal(shaken.dogs[0], shaken.dogs[1])
    again = evaluate.fly(noisy, Strombom(), twins, 20, key=jax.random.key(0))
    assert np.array_equal(shaken.dogs, again.dogs)


@pytest.mark.parametrize("steps", [1, 99, 100, 101, 250])
def test_stopping_with_the_last_mission_leaves_the_traces_as_they_were(steps):
    starts = cases(WORLD, 4, "random", seed=5)
    flown = evaluate.fly(WORLD, Strombom(), starts, steps)
    plain = jax.jit(
        lambda starts: jax.vmap(lambda case: mission.rollout(WORLD, Strombom(), case, steps))(
            starts
        )
    )(starts)
    assert flown.accomplished.shape == (4, steps + 1)
    assert steps < 250 or bool(flown.accomplished[:, -1].all())  # and so it did stop early
    for here, there in zip(jax.tree.leaves(flown), jax.tree.leaves(plain), strict=True):
        assert np.asarray(here).dtype == np.asarray(there).dtype
        assert here.shape == there.shape
    # A rule dog that dithers at its point makes metres of a rounding, in time.
    for early in (flown, plain):
        np.testing.assert_allclose(early.sheep[:, :40], plain.sheep[:, :40], atol=1e-3)
        np.testing.assert_allclose(early.command[:, :40], plain.command[:, :40], atol=1e-2)
    for case in range(4):
        done = np.asarray(flown.accomplished[case])
        assert (np.diff(done.astype(int)) >= 0).all()
        still = np.flatnonzero(done)
        if len(still):
            assert np.ptp(np.asarray(flown.sheep[case])[still], axis=0).max() == 0.0
            assert np.ptp(np.asarray(flown.dogs[case])[still], axis=0).max() == 0.0
            assert not np.asarray(flown.command[case])[still].any()


def test_missions_at_home_from_the_start_are_recorded_whole():
    starts = jax.tree.map(lambda leaf: 0.1 * leaf, cases(WORLD, 2))
    flown = evaluate.fly(WORLD, Strombom(), starts, 30)
    assert bool(flown.accomplished.all())
    assert np.ptp(np.asarray(flown.sheep), axis=1).max() == 0.0


@pytest.mark.parametrize("every", [7])
def test_flocks_so_large_that_few_instants_fit_in_a_chunk_fly_alike(monkeypatch, every):
    starts = cases(WORLD, 3, "random", seed=5)
    usual = evaluate.fly(WORLD, Strombom(), starts, 40, every=every)
    monkeypatch.setattr(evaluate, "CHUNK_NUMBERS", 2 * 3 * 3 * 4)  # four instants
    jax.clear_caches()
    small = evaluate.fly(WORLD, Strombom(), starts, 40, every=every)
    for here, there in zip(jax.tree.leaves(small), jax.tree.leaves(usual), strict=True):
        np.testing.assert_allclose(here, there, atol=1e-3)


@pytest.mark.parametrize("every", [0, -3])
def test_sheep_recorded_at_no_instants_are_refused(every):
    with pytest.raises(Refusal, match="--every 10"):
        evaluate.fly(WORLD, Strombom(), cases(WORLD, 1), 5, every=every)


def test_a_world_without_noise_has_no_key_and_one_with_noise_the_same_for_a_seed():
    noisy = replace(WORLD, dog=replace(WORLD.dog, actuation_noise=0.2))
    assert evaluate.noise_key(WORLD, 3) is None
    key, again, other = (evaluate.noise_key(noisy, seed) for seed in (3, 3, 4))
    assert key is not None
    assert other is not None
    assert key == again
    assert key != other


def test_a_trace_with_the_one_world_of_all_its_missions_measures_alike():
    flown = evaluate.fly(WORLD, Strombom(), cases(WORLD, 3), 40)
    given = replace(flown, world=WORLD)
    ours, theirs = evaluate.measure(flown), evaluate.measure(given)
    for metric in ours:
        np.testing.assert_array_equal(ours[metric], theirs[metric])
    assert evaluate.one_case(given, 1).world == WORLD
    assert np.array_equal(evaluate.one_case(given, 1).sheep, flown.sheep[1])

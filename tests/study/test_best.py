from functools import partial
from importlib import resources

import jax
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds import planner
from skydog.study import best, cases, metrics
from skydog.world.presets import preset

SETS = list(best.SHIPPED)
PLANS = [np.array([[0.5, -1.0], [0.25, 0.125]]), np.zeros((0, 2)), np.array([[1.0, -0.0]])]
TABLE = best.as_table(PLANS)


def shipped(starts, arena):
    known = best.plans(starts, arena)
    assert known is not None
    return known


def measured(world, state, velocity):
    trace = planner.fly(world, state, velocity)
    return metrics.steps(trace), metrics.steps_ratio(trace)


@pytest.mark.parametrize(("starts", "arena"), SETS)
def test_a_shipped_plan_takes_the_steps_that_its_row_tells(starts, arena):
    known, world = shipped(starts, arena), preset("paper", arena)
    drawn = jax.tree.map(lambda leaf: leaf[: len(known.steps)], cases.shipped(world, starts))
    counted, ratio = jax.jit(jax.vmap(partial(measured, world)))(drawn, known.velocity)
    # In float32; on another processor rounding may decide a mission of a hundred. In NumPy, with
    # 16 digits, none is off: tests/world/test_plans.py.
    assert np.mean(counted == known.steps) >= 0.98
    assert np.all(ratio >= 1.0)


@pytest.mark.parametrize(("starts", "arena"), SETS)
def test_shipped_velocities_are_within_the_limits_and_the_files_small(starts, arena):
    known = shipped(starts, arena)
    assert len(known.steps) == (30 if starts == "paper" else 200)
    assert np.all(np.abs(known.velocity) <= 1.0)
    assert np.all((known.steps > 0) & (known.steps <= known.velocity.shape[1]))
    file = resources.files("skydog.study").joinpath("data", best.SHIPPED[starts, arena])
    assert len(file.read_bytes()) < 400_000


def test_arenas_without_plans_have_none():
    assert best.steps("random", 6.0) is None
    assert best.plans("paper", 5.0) is None


def test_a_table_is_read_as_it_was_written():
    read = best.read(TABLE, "a table")
    for one, other in zip(read, PLANS, strict=True):
        assert np.array_equal(one, other)
    assert TABLE.splitlines()[0] == "case,steps,x1,y1,x2,y2"
    assert TABLE.splitlines()[3] == "3,1,1.000,0.000"


def test_padded_plans_hover_after_their_last_step():
    padded = best.padded(PLANS)
    assert padded.steps.tolist() == [2, 0, 1]
    assert padded.velocity.shape == (3, 2, 1, 2)
    assert np.array_equal(padded.velocity[2, :, 0], [[1.0, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("case,steps", "dog_x,dog_y", "p.csv holds no plans: its first line"),
        ("0.250", "nan", "line 2, is damaged: a velocity"),
        ("0.250", "-1e9", "line 2, is damaged: a velocity"),
        ("0.250", "much", "line 2, is damaged: it does not hold numbers"),
        (",0.250", "", "line 2, is damaged: 3 numbers are no x and y of 2 steps"),
        ("\n2,0\n", "\n2,-1\n", "line 3, is damaged: 0 numbers"),
        ("\n2,0\n", "\n", "line 3, is damaged: it is of case 3, not 2"),
        ("\n2,0\n", "\n\n", "line 3, is damaged: it does not hold numbers"),
    ],
)
def test_a_damaged_table_is_refused_with_its_line(old, new, says):
    assert old in TABLE
    with pytest.raises(Refusal, match=says):
        best.read(TABLE.replace(old, new, 1), "p.csv")


@pytest.mark.parametrize("text", ["", "\n", TABLE + 'x"' * 100_000, "\0"])
def test_a_file_of_something_else_holds_no_plans(text):
    with pytest.raises(Refusal):
        best.read(text, "p.csv")


def test_times_best_is_the_mean_of_the_ratios_and_not_the_ratio_of_the_means():
    times = best.times_best(np.array([20.0, 300.0]), np.array([10, 100, 7]))
    assert times["mean"] == pytest.approx(2.5)
    assert times["ci95"][0] <= 2.5 <= times["ci95"][1]


def test_a_shepherd_faster_than_a_plan_has_less_than_once_the_best():
    assert best.times_best(np.array([9]), np.array([10]))["mean"] == pytest.approx(0.9)


def test_a_plan_of_no_steps_counts_as_one():
    assert best.times_best(np.array([0, 3]), np.array([0, 0]))["mean"] == 1.5


@pytest.mark.parametrize("steps", [[], [1.0, 2.0], [np.nan], [-1.0]])
def test_steps_of_other_cases_or_that_are_no_steps_are_refused(steps):
    with pytest.raises(Refusal):
        best.times_best(np.array(steps, float), np.array([10]))

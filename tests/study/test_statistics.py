import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from skydog.study.statistics import (
    fisher,
    mcnemar,
    paired,
    paired_share,
    share,
    student,
    summary,
    welch,
)


def test_the_mean_and_the_sample_deviation_of_a_known_sample():
    found = summary(np.array([2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]))
    assert found["mean"] == 5.0
    assert found["sd"] == pytest.approx(math.sqrt(32 / 7))


@pytest.mark.parametrize("values", [[3.5], [3.5, 3.5], [0.0] * 30])
def test_values_that_do_not_vary_have_themselves_as_interval(values):
    assert summary(np.array(values)) == {
        "mean": values[0],
        "sd": 0.0,
        "ci95": [values[0], values[0]],
    }


def test_the_interval_of_a_normal_sample_is_nearly_the_textbook_one():
    values = np.random.default_rng(1).normal(100.0, 16.0, 400)
    found = summary(values)
    half = 1.96 * np.std(values, ddof=1) / math.sqrt(len(values))
    np.testing.assert_allclose(
        found["ci95"], [np.mean(values) - half, np.mean(values) + half], atol=0.2
    )


def test_the_same_values_have_the_same_interval():
    values = np.array([97.0, 130.0, 88.0, 101.0])
    assert summary(values) == summary(values)


samples = st.lists(st.floats(0, 1000, width=16), min_size=2, max_size=12)


@given(samples)
def test_the_interval_is_finite_lies_within_the_sample_and_contains_the_mean(values):
    found = summary(np.array(values, float))
    mean, (low, high) = np.mean(values), np.array(found["ci95"])
    slack = 1e-6 * (1 + mean)
    assert min(values) - slack <= low <= mean + slack
    assert mean - slack <= high <= max(values) + slack


def test_thirty_successes_of_thirty_leave_room_for_a_failure():
    # Wilson 1927: for n of n the interval is [n / (n + z²), 1].
    found, (low, high) = share(30, 30)
    assert found == 1.0
    assert low == pytest.approx(30 / (30 + 1.959964**2), rel=1e-5)
    assert high == pytest.approx(1.0)


def test_shares_of_success_and_failure_mirror_each_other():
    (one, interval), (other, mirrored) = share(7, 30), share(23, 30)
    assert one == pytest.approx(1 - other)
    np.testing.assert_allclose(interval, [1 - mirrored[1], 1 - mirrored[0]])


def test_paired_differences_see_what_the_cases_share_and_separate_means_do_not():
    case = np.random.default_rng(0).normal(100.0, 30.0, 30)
    found = paired(case - 3.0 + 0.1 * np.arange(30), case)
    assert found["mean"] == pytest.approx(np.mean(0.1 * np.arange(30)) - 3.0)
    assert found["ci95"][1] < 0.0
    assert summary(case)["ci95"][1] - summary(case)["ci95"][0] > 15.0


@pytest.mark.parametrize(("offset", "sign"), [(-20.0, -1), (0.5, 0), (20.0, 1)])
def test_welchs_test_needs_no_more_than_mean_and_sd(offset, sign):
    draw = np.random.default_rng(2)
    ours, theirs = draw.normal(100.0 + offset, 10.0, 30), draw.normal(100.0, 20.0, 20)
    found = welch(summary(ours), 30, summary(theirs), 20)
    assert found.sign == sign
    _, expected = stats.ttest_ind(ours, theirs, equal_var=False)
    assert found.p == pytest.approx(expected)


@pytest.mark.parametrize(
    ("ours", "theirs", "sign"),
    [
        ((1030, 1030), (29, 30), 1),
        ((30, 30), (29, 30), 0),
        ((0, 30), (29, 30), -1),
        ((999, 1000), (30, 30), 0),
    ],
)
def test_shares_of_different_numbers_of_missions_are_compared(ours, theirs, sign):
    assert fisher(*ours, *theirs).sign == sign


@pytest.mark.parametrize(
    ("gained", "lost", "sign", "p"),
    [(0, 0, 0, 1.0), (5, 0, 0, 2 / 2**5), (6, 0, 1, 2 / 2**6), (0, 6, -1, 2 / 2**6)],
)
def test_of_the_same_cases_those_count_that_only_one_accomplishes(gained, lost, sign, p):
    both = np.ones(20, bool)
    ours = np.concatenate([both, np.ones(gained, bool), np.zeros(lost, bool)])
    theirs = np.concatenate([both, np.zeros(gained, bool), np.ones(lost, bool)])
    assert mcnemar(ours, theirs) == (sign, pytest.approx(p))


def test_a_difference_of_shares_of_the_same_cases_has_the_interval_of_bonett_and_price():
    # Of 100 cases 20 are gained and 10 are lost: (21 - 11)/102 ± 1.96 √((32/102 - (10/102)²)/102).
    ours = np.concatenate([np.ones(70, bool), np.zeros(30, bool)])
    theirs = np.concatenate(
        [np.ones(50, bool), np.zeros(20, bool), np.ones(10, bool), np.zeros(20, bool)]
    )
    found = paired_share(ours, theirs)
    around = 1.959964 * np.sqrt((32 / 102 - (10 / 102) ** 2) / 102)
    assert found["mean"] == pytest.approx(0.1)
    assert found["ci95"] == pytest.approx([10 / 102 - around, 10 / 102 + around])
    same = paired_share(np.ones(30, bool), np.ones(30, bool))
    assert same["ci95"] == pytest.approx([-0.0866, 0.0866], abs=1e-3)


@pytest.mark.parametrize(("expected", "sign"), [(0.0, 1), (2.4, 0), (9.0, -1)])
def test_a_mean_is_held_against_a_number(expected, sign):
    assert student(np.array([1.0, 2.0, 3.0, 4.0]), expected).sign == sign


def test_one_value_is_more_than_no_number():
    assert student(np.array([5.0]), 0.0).sign == 0

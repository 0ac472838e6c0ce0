import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.study.statistics import summary


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

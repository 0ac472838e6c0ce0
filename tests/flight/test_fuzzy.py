import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.flight import fuzzy

errors, rates = st.floats(-10.0, 10.0), st.floats(-1e3, 1e3)


def gain(error, rate):
    return float(fuzzy.gain(np.array([error]), np.array([rate]))[0])


@given(errors, rates)
def test_the_gain_is_within_the_rules_for_any_error_and_rate(error, rate):
    assert fuzzy.RULES.min() - 1e-12 <= gain(error, rate) <= fuzzy.RULES.max() + 1e-12


@given(errors, rates)
def test_left_and_right_are_alike(error, rate):
    if error:  # without one, no side is the side on which it grows
        assert gain(error, rate) == gain(-error, -rate)


@pytest.mark.parametrize("large", range(3))
@pytest.mark.parametrize("grows", range(3))
def test_at_the_peaks_of_its_sets_a_rule_decides_alone(large, grows):
    found = gain(fuzzy.ERROR[large], fuzzy.GROWTH[grows])
    assert found == pytest.approx(fuzzy.RULES[large, grows])


@given(errors, rates, st.floats(-1e-4, 1e-4))
def test_the_gain_does_not_jump(error, rate, by):
    if error * (error + by) > 0.0:
        assert gain(error + by, rate) == pytest.approx(gain(error, rate), abs=0.01)
    assert gain(error, rate + by) == pytest.approx(gain(error, rate), abs=0.01)

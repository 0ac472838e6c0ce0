"""The numbers that a user may give."""

import math

import numpy as np
import pytest

from skydog import quantities
from skydog.errors import Refusal, one_line
from skydog.quantities import Quantity

ALL = {name: each for name, each in vars(quantities).items() if isinstance(each, Quantity)}
NO_NUMBERS = ["", "4m", "four", "1e", None, [], {}, object(), True, "nan", math.nan, 1j, b"4"]
TOO_LARGE = [10**400, -(10**400), "9" * 30, "9" * 6000, math.inf, "-inf", 1e39]


@pytest.mark.parametrize("value", [*NO_NUMBERS, *TOO_LARGE], ids=lambda value: repr(value)[:20])
@pytest.mark.parametrize("name", ALL)
def test_what_is_no_number_within_its_bounds_is_refused_with_the_remedy(name, value):
    with pytest.raises(Refusal, match="; try --") as refusal:
        ALL[name].checked(value)
    assert len(str(refusal.value)) < 250


@pytest.mark.parametrize("name", ALL)
def test_bounds_are_within_and_what_lies_beyond_is_not(name):
    quantity = ALL[name]
    step = 1 if quantity.whole else 1e-3
    lowest = quantity.least + step if quantity.above else quantity.least
    for value in (lowest, quantity.most, str(quantity.most), np.asarray(quantity.most)[()]):
        found = quantity.checked(value)
        assert found == float(value)
        assert isinstance(found, int if quantity.whole else float)
    for value in (quantity.least - step, quantity.most + step):
        with pytest.raises(Refusal):
            quantity.checked(value)
    if quantity.above:
        with pytest.raises(Refusal):
            quantity.checked(quantity.least)


@pytest.mark.parametrize("name", ALL)
def test_the_remedy_of_a_quantity_is_one_of_its_values(name):
    ALL[name].checked(ALL[name].fix.split()[-1])


def test_a_message_is_one_line_that_steers_no_terminal():
    shown = str(Refusal("bad \x1b[31mred\nline\u202e\udc80; try 4"))
    assert shown == r"bad \x1b[31mred\nline\u202e\udc80; try 4"


def test_a_long_message_keeps_its_beginning_and_its_remedy():
    shown = one_line("got " + "x" * 20_000_000 + "; try --arena 4")
    assert shown.startswith("got xxx")
    assert shown.endswith("; try --arena 4")
    assert len(shown) <= 600

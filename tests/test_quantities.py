"""The numbers that a user may give."""

import math
from dataclasses import fields

import jax
import numpy as np
import pytest

import skydog
from skydog import quantities
from skydog.errors import Refusal, one_line
from skydog.learning.curriculum import Curriculum
from skydog.quantities import Quantity

pytestmark = pytest.mark.usefixtures("unchecked")  # bad types are what is tried here

ALL = {name: each for name, each in vars(quantities).items() if isinstance(each, Quantity)}
NO_NUMBERS = [
    "",
    "4m",
    "four",
    "1e",
    None,
    [],
    {},
    object(),
    True,
    "nan",
    math.nan,
    1j,
    b"4",
    np.True_,
]
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
    step = 1 if quantity.whole else 1e-4
    for value in (quantity.least, quantity.most, str(quantity.most), np.asarray(quantity.most)[()]):
        found = quantity.checked(value)
        assert found == float(value)
        assert isinstance(found, int if quantity.whole else float)
    for value in (quantity.least - step, quantity.most + step):
        with pytest.raises(Refusal):
            quantity.checked(value)


@pytest.mark.parametrize("name", ALL)
def test_the_remedy_of_a_quantity_is_one_of_its_values(name):
    ALL[name].checked(ALL[name].fix.split()[-1])


BAD_COUNTS = [-1, 0, 2**31, 10**400, "four", None, math.nan, 4.0, [4], b"4", True, np.int8(-3)]


@pytest.mark.parametrize("bad", BAD_COUNTS, ids=lambda value: repr(value)[:20])
@pytest.mark.parametrize("what", ["sheep", "dogs"])
def test_a_start_of_no_such_number_is_refused(what, bad):
    with pytest.raises(Refusal):
        skydog.reset(skydog.preset("paper"), jax.random.key(0), **{what: bad})


@pytest.mark.parametrize(
    "bad", [math.nan, True, "4m", [4], 10**400, object()], ids=lambda value: type(value).__name__
)
@pytest.mark.parametrize("what", [each.name for each in fields(Curriculum)])
def test_a_curriculum_of_no_such_value_is_refused(what, bad):
    if what in ("one_scale", "navigates") and bad is True:
        return
    with pytest.raises(Refusal):
        Curriculum(**{what: bad}).world()


def test_a_message_is_one_line_that_steers_no_terminal():
    shown = str(Refusal("bad \x1b[31mred\nline\u202e\udc80; try 4"))
    assert shown == r"bad \x1b[31mred\nline\u202e\udc80; try 4"


def test_a_long_message_keeps_its_beginning_and_its_remedy():
    shown = one_line("got " + "x" * 20_000_000 + "; try --arena 4")
    assert shown.startswith("got xxx")
    assert shown.endswith("; try --arena 4")
    assert len(shown) <= 600

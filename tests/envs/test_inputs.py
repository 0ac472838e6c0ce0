import re

import numpy as np
import pytest

from skydog.envs import inputs
from skydog.errors import Refusal


@pytest.mark.parametrize("count", [0, 11, 2.5, "3", None, np.nan, True])
def test_what_is_no_number_of_things_is_refused_with_the_bounds(count):
    assert inputs.count(np.int64(3), "sheep", 10) == 3
    with pytest.raises(Refusal, match=re.escape(f"from 1 to 10, got {count!r}")):
        inputs.count(count, "sheep", 10)


@pytest.mark.parametrize("word", [None, "Paper", ["paper"], np.array(["paper", "random"]), 10**400])
def test_what_is_none_of_the_words_is_refused_with_them(word):
    assert inputs.choice("paper", ("paper", "random"), "start") == "paper"
    with pytest.raises(Refusal, match="choose from paper, random"):
        inputs.choice(word, ("paper", "random"), "start")


class Loud:
    def __repr__(self):
        return "loud\n" * 10**6


@pytest.mark.parametrize(
    "value", [[10**400], [10**5000], np.zeros((9, 9)), Loud(), ["x" * 99] * 99]
)
def test_a_message_shows_any_value_in_one_short_line(value):
    assert len(inputs.short(value)) <= 60
    assert inputs.short(value).isprintable()

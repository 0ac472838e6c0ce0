import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.world import mixing, params
from skydog.world.laws.varied import VariedFlock
from skydog.world.options import KIND_NAMES
from skydog.world.presets import preset
from skydog.world.serialise import flatten, unflatten

WORLD = preset("strombom2014", sheep=10)


def test_the_last_sheep_are_of_the_first_kind_and_those_before_them_of_the_next():
    world = mixing.mixed(WORLD, 10, {"loner": 0.2, "stubborn": 0.3})
    assert world.flock.grouping.tolist() == pytest.approx([1.05] * 8 + [0.0] * 2)
    assert world.flock.escape.tolist() == pytest.approx([1.0] * 5 + [0.1] * 3 + [1.0] * 2)


@pytest.mark.parametrize("name", KIND_NAMES)
def test_a_flock_of_one_kind_has_its_values_and_a_share_of_zero_changes_nothing(name):
    kind = mixing.KINDS[name]
    world = mixing.mixed(WORLD, 10, {name: 1.0})
    for parameter in (*kind.values, *kind.shares):
        body = world.sheep if parameter == "speed" else world.flock
        own = WORLD.sheep if parameter == "speed" else WORLD.flock
        value = kind.values.get(parameter)
        if value is None:
            value = kind.shares[parameter] * getattr(own, parameter)
        assert getattr(body, parameter).tolist() == pytest.approx([value] * 10)
    assert mixing.mixed(WORLD, 10, {name: 0.0}) is WORLD


def test_the_kinds_are_those_that_a_command_knows():
    assert tuple(mixing.KINDS) == KIND_NAMES


@pytest.mark.parametrize("name", ["paper", "strombom2014"])
def test_followers_need_the_law_that_knows_them_and_other_sheep_stay_as_they_were(name):
    before = preset(name, sheep=4)
    world = preset(name, sheep=4, mix={"follower": 0.5})
    assert isinstance(world.flock, VariedFlock)
    assert np.asarray(world.flock.follow).tolist() == [0.0, 0.0, 1.0, 1.0]
    assert np.asarray(world.flock.escape).tolist() == [before.flock.escape] * 2 + [0.0] * 2


@pytest.mark.parametrize(
    ("mix", "says"),
    [
        ({"shy": 0.2}, "choose from stubborn, short-sighted"),
        ({"loner": 1.2}, "from 0 to 1, got 1.2; try --mix"),
        ({"loner": 0.7, "slow": 0.7}, "add up to 1"),
    ],
)
def test_a_mix_that_cannot_be_is_refused_with_what_to_write_instead(mix, says):
    with pytest.raises(Refusal, match=says):
        mixing.mixed(WORLD, 10, mix)


def test_a_law_without_the_parameter_is_refused():
    with pytest.raises(Refusal, match="RegulatedFlock cannot be follower"):
        preset("elfiqi2020", sheep=4, mix={"follower": 0.5})


def test_a_mixed_world_comes_back_from_a_file_with_each_sheep_as_it_was():
    world = params.traced(preset("strombom2014", sheep=5, mix={"follower": 0.4, "slow": 0.2}))
    back = unflatten(flatten(world))
    assert np.array_equal(back.flock.follow, world.flock.follow)
    assert np.array_equal(back.sheep.speed, world.sheep.speed)

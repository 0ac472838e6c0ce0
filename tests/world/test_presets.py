import math

import pytest

from skydog.errors import Refusal
from skydog.world import herding
from skydog.world.laws.paper import PaperFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.limits import PerAxis
from skydog.world.options import PRESET_NAMES
from skydog.world.params import World
from skydog.world.presets import PRESETS, furthest_first, preset, with_nearness
from skydog.world.serialise import flatten


def test_the_paper_preset_holds_the_numbers_of_the_papers_table():
    world = preset("paper")
    assert world.flock.avoidance == 1.0
    assert world.flock.sensing == 2.0
    assert world.sheep.speed == 0.5
    assert world.dog.speed == 1.0
    assert world.dog.limits == PerAxis()
    assert world.arena.goal_radius == 2.0
    assert world.arena.dt == 0.1
    assert math.isclose(herding.gathered_radius(world, 3), 1.3)
    assert isinstance(world.flock, PaperFlock)


def test_the_strombom_preset_holds_the_numbers_of_the_2014_model():
    world = preset("strombom2014", sheep=46)
    flock = world.flock
    assert isinstance(flock, StrombomFlock)
    assert (flock.avoidance, flock.sensing, flock.inertia, flock.grouping) == (2, 65, 0.5, 1.05)
    assert (flock.escape, flock.repulsion, flock.noise, flock.graze) == (1, 2, 0.3, 0.05)
    assert (world.sheep.speed, world.dog.speed, world.arena.size) == (1, 1.5, 150)
    assert world.dog.stall == 3 * flock.avoidance
    assert math.isclose(herding.gathered_radius(world, 46), 2 * 46 ** (2 / 3))


def test_the_printed_weight_is_the_only_difference_of_paper_w05():
    usual, printed = flatten(preset("paper")), flatten(preset("paper-w05"))
    assert {name for name in usual if usual[name] != printed[name]} == {"flock.repulsion"}
    assert printed["flock.repulsion"] == 0.5


@pytest.mark.parametrize("sheep", [5, 6, 10, 50])
def test_a_dog_at_the_driving_point_of_a_larger_paper_flock_is_seen_from_its_centre(sheep):
    world = preset("paper", 50.0, sheep)
    assert world.dog.driving * math.sqrt(sheep) < world.flock.sensing


@pytest.mark.parametrize("name", PRESETS)
def test_an_arena_and_a_flock_of_another_size_are_as_asked(name):
    world = preset(name, arena=200.0, sheep=7)
    assert isinstance(world, World)
    assert world.arena.size == 200.0


@pytest.mark.parametrize(
    ("asked", "bad", "remedy"),
    [
        ({"name": "papr"}, "papr", ", ".join(PRESETS)),
        ({"name": ""}, "''", ", ".join(PRESETS)),
        ({"arena": 0.0}, "0", "--arena 4"),
        ({"arena": -1.0}, "-1", "--arena 4"),
        ({"arena": 2.0}, "2.0", "--arena 4"),
        ({"arena": math.nan}, "nan", "--arena 4"),
        ({"arena": math.inf}, "inf", "--arena 4"),
        ({"sheep": 0}, "0", "--sheep 3"),
        ({"sheep": -2}, "-2", "--sheep 3"),
        ({"name": "strombom2014", "arena": 15.0, "sheep": 46}, "15", "--arena"),
        ({"goal": (4.5, 0.0)}, "4.5,0", "--goal 4,4"),
        ({"goal": (0.0, -1.0)}, "0,-1", "--goal 4,4"),
        ({"goal": (math.nan, 1.0)}, "nan", "--goal 4,4"),
        ({"goal_radius": 0.0}, "0.0", "--goal-radius 2"),
        ({"goal_radius": -1.0}, "-1.0", "--goal-radius 2"),
        ({"goal_radius": math.nan}, "nan", "--goal-radius 2"),
        ({"goal_radius": 4.0}, "4", "--arena 8"),
    ],
)
def test_a_preset_that_cannot_be_is_refused_with_the_bad_value_and_the_remedy(asked, bad, remedy):
    with pytest.raises(Refusal) as refusal:
        preset(**asked)
    message = str(refusal.value)
    assert bad in message
    assert remedy in message
    assert "\n" not in message


def test_the_remedy_of_a_refused_arena_is_accepted():
    with pytest.raises(Refusal) as refusal:
        preset("strombom2014", arena=15.0, sheep=100)
    preset("strombom2014", arena=float(str(refusal.value).split("--arena ")[1]), sheep=100)


def test_a_goal_and_its_radius_are_as_asked():
    world = preset("paper", 3.0, goal=(1.5, 3.0), goal_radius=1.2)
    assert herding.goal(world.arena).tolist() == [1.5, 3.0]
    assert world.arena.goal_radius == 1.2
    assert preset("paper", 1.5, goal_radius=1.0).arena.size == 1.5


def test_the_papers_presets_take_the_stray_at_hand_and_the_others_the_furthest():
    assert {name: preset(name).dog.nearness for name in PRESETS} == {
        name: 1.0 if name.startswith("paper") else 0.0 for name in PRESETS
    }
    assert furthest_first(preset("paper")).dog.nearness == 0.0


@pytest.mark.parametrize("nearness", [-0.1, 1e39, math.nan, math.inf])
def test_a_nearness_that_cannot_be_is_refused(nearness):
    with pytest.raises(Refusal, match="--nearness 1"):
        with_nearness(preset("paper"), nearness)


def test_the_names_that_a_command_checks_are_those_of_the_presets():
    assert tuple(PRESETS) == PRESET_NAMES

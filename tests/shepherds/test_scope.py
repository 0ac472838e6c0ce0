from dataclasses import replace

import pytest

from skydog.shepherds import scope, store
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.presets import preset

WORLD = preset("paper", 4.0)
TAUGHT = {"arena": 4.0, "taught_for": scope.scope(WORLD, (0.1, 1.4), False, 3)}
ANY_GOAL = {"arena": 4.0, "taught_for": scope.scope(WORLD, (0.1, 1.4), True, 3)}


def with_law(world, law):
    weights = {name: value for name, value in vars(world.flock).items() if name != "noise"}
    return replace(world, flock=law(**weights, noise=0.0, graze=0.0, neighbours=None))


@pytest.mark.parametrize(
    ("world", "sheep", "phrases"),
    [
        (WORLD, 3, []),
        (preset("paper", 6.0), 3, []),  # the goal of the lessons, in sides of the arena
        (preset("paper", goal=(4.0, 4.0)), 3, ["for the goal 0,0, not 4,4"]),
        (preset("paper", 60.0), 3, ["for arenas of 2.86 to 40 m, not 60 m"]),
        (preset("paper", 2.5), 3, ["for arenas of 2.86 to 40 m, not 2.5 m"]),
        (preset("paper", 9.0, 7), 7, ["with 3 sheep, not 7"]),
        (
            with_law(WORLD, StrombomFlock),
            3,
            ["with sheep of the law 'paper', not 'strombom2014'"],
        ),
        (preset("paper", 80.0, 4, (40.0, 0.0)), 4, ["goal", "arenas", "4"]),
    ],
)
def test_what_is_asked_beyond_the_lessons_is_told(world, sheep, phrases):
    told = scope.beyond(TAUGHT, world, sheep)
    assert len(told) == len(phrases)
    assert all(phrase in one for phrase, one in zip(phrases, told, strict=True))


def test_any_number_of_sheep_is_within_what_was_taught():
    assert scope.beyond(TAUGHT, preset("paper", 4.0, 5), None) == []


def test_who_was_taught_for_goals_anywhere_is_asked_for_none_beyond():
    assert scope.beyond(ANY_GOAL, preset("paper", goal=(4.0, 1.0)), 3) == []


def test_a_card_of_before_knows_its_one_goal_and_flock():
    card = {"arena": 4.0, "sheep": 3, "world": {"arena.goal_x": 0, "arena.goal_y": 0}}
    assert scope.beyond(card, WORLD, 3) == []
    told = scope.beyond(card, preset("paper", goal=(4.0, 4.0)), 5)
    assert told == ["for the goal 0,0, not 4,4", "with 3 sheep, not 5"]


@pytest.mark.parametrize("odd", [None, "x", [], {"goals": [1]}, {"goals": "\x1b"}, {"sheep": {}}])
def test_an_odd_card_says_nothing_and_breaks_nothing(odd):
    for card in ({}, {"taught_for": odd, "arena": odd, "sheep": odd, "world": odd}):
        assert scope.beyond(card, WORLD, 3) == [] or card.get("world") is odd


@pytest.mark.parametrize("name", ["h-ddpg-4x4", "h-ddpg-6x6", "dhrl-4x4", "dhrl-6x6"])
def test_the_sheepdogs_that_ship_were_taught_for_every_goal(name):
    dog, card = store.read(name)
    home = float(dog.arena)
    assert dog.frame == "folded"
    assert scope.beyond(card, preset("paper", home, goal=(home, home)), 3) == []


def test_a_rectangle_is_as_large_as_the_square_with_its_diagonal_and_its_goal_is_in_its_sides():
    corner = replace(WORLD, arena=replace(WORLD.arena, goal_x=4.0, goal_y=4.0))
    card = {"arena": 4.0, "taught_for": scope.scope(corner, (0.9, 1.1), False, 3)}
    arena = replace(WORLD.arena, size=5.2, height=2.4, goal_x=5.2, goal_y=2.4)  # as large as 4.05 m
    assert scope.beyond(card, replace(WORLD, arena=arena), 3) == []
    long = replace(WORLD, arena=replace(arena, size=7.2, goal_x=5.2))
    found = scope.beyond(card, long, 3)
    assert found[0] == "for the goal 7.2,2.4, not 5.2,2.4"
    assert found[1].endswith("m, not 5.36656 m")

import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds import finding, rules
from skydog.study.patterns import PATTERNS, cases, unfenced
from skydog.world import herding
from skydog.world.presets import preset

WORLD = preset("elfiqi2020", sheep=100)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_sheep_start_in_every_cell_of_the_pattern_and_in_no_other(unchecked, pattern):
    starts = cases(WORLD, pattern, 5, seed=3)
    column, row = np.floor((np.asarray(starts.sheep) - 20.0) / 2.0).astype(int).reshape(-1, 2).T
    assert set((5 * row + column).tolist()) == set(PATTERNS[pattern])


def test_dogs_start_near_the_goal():
    dogs = np.asarray(cases(WORLD, "P1", 40, seed=3, sheep=1, dogs=2).dogs)
    assert dogs.shape == (40, 2, 2)
    assert np.all((dogs >= [15.0, 45.0]) & (dogs <= [35.0, 50.0]))
    assert np.ptp(dogs[..., 0]) > 15.0


def test_the_same_seed_draws_the_same_starts_and_another_seed_others(unchecked):
    one, same, other = (cases(WORLD, "P6", 2, seed, 5).sheep for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_an_arena_of_twice_the_size_has_its_starts_twice_as_far_out(unchecked):
    small, large = (cases(preset("elfiqi2020", size), "P4", 2, 0, 5) for size in (50.0, 100.0))
    np.testing.assert_allclose(large.sheep, 2 * small.sheep, rtol=1e-6)


@pytest.mark.parametrize(("pattern", "count"), [("P7", 3), ("", 3), (3, 3), ("P1", 0)])
def test_starts_that_cannot_be_drawn_are_refused(unchecked, pattern, count):
    with pytest.raises(Refusal, match=r"P1, P2|--cases"):
        cases(WORLD, pattern, count)


def test_without_walls_everyone_is_as_far_from_the_goal_and_no_wall_is_near(unchecked):
    starts = cases(WORLD, "P5", 2, sheep=5)
    wide, moved = unfenced(WORLD, starts)
    for places, shifted in ((starts.sheep, moved.sheep), (starts.dogs, moved.dogs)):
        before = places - herding.goal(WORLD.arena)
        np.testing.assert_allclose(shifted - herding.goal(wide.arena), before, atol=1e-4)
    assert jnp.min(moved.sheep) >= 50.0
    assert jnp.max(moved.sheep) <= 100.0


def test_every_rule_has_a_name_that_a_command_knows():
    assert tuple(rules.RULES) == finding.RULES
    for name in rules.RULES:
        finding.check(name)


def test_a_name_that_no_rule_has_is_that_of_a_sheepdog():
    shepherd, card = rules.read("h-ddpg-4x4")
    assert type(shepherd).__name__ == "Sheepdog"
    assert card["kind"] == "sheepdog"
    with pytest.raises(Refusal, match="no sheepdog is called nobody"):
        rules.read("nobody")

import jax
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.study.cases import PAPER_LAYOUT, as_table, cases, shipped
from skydog.world import herding
from skydog.world.presets import preset

WORLD = preset("paper", 6.0)


@pytest.mark.parametrize("starts", ["paper", "random", "anywhere"])
def test_the_same_arguments_give_the_same_cases_and_another_seed_gives_others(starts):
    first, again = cases(WORLD, 5, starts, seed=3), cases(WORLD, 5, starts, seed=3)
    for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        assert np.array_equal(one, other)
    assert not np.any(np.asarray(cases(WORLD, 5, starts, seed=4).dogs) == np.asarray(first.dogs))


def test_paper_starts_place_the_same_three_sheep_and_vary_the_dogs():
    drawn = cases(WORLD, 5, "paper", dogs=2)
    assert drawn.sheep.shape == (5, 3, 2)
    for sheep in drawn.sheep:
        np.testing.assert_allclose(sheep, 6.0 * np.array(PAPER_LAYOUT), rtol=1e-6)
    dogs = np.asarray(drawn.dogs).reshape(-1, 2)
    assert len(np.unique(dogs, axis=0)) == 10
    assert np.all((dogs >= 0.0) & (dogs <= 6.0))
    assert np.all(np.asarray(drawn.force) == 0.0)


def test_the_paper_flock_starts_gathered_in_the_small_arena():
    world = preset("paper", 4.0)
    assert herding.gathered(world, cases(world, 5).sheep[0])


def test_random_starts_draw_every_flock_anew_on_the_far_side_of_the_goal():
    drawn = cases(WORLD, 5, "random")
    sheep = np.asarray(drawn.sheep)
    assert sheep.shape == (5, 3, 2)
    assert np.all((sheep >= 3.0) & (sheep <= 5.7))
    assert len(np.unique(sheep.reshape(-1, 2), axis=0)) == 15


PLACES = {0.0: (0.5, 0.95), 3.0: (0.05, 0.95), 6.0: (0.05, 0.5)}


@pytest.mark.parametrize("goal_x", PLACES)
@pytest.mark.parametrize("goal_y", PLACES)
def test_random_starts_lie_opposite_the_goal_and_anywhere_where_it_is_in_the_middle(goal_x, goal_y):
    world = preset("paper", 6.0, goal=(goal_x, goal_y))
    share = np.asarray(cases(world, 400, "random").sheep) / 6.0
    for axis, goal in enumerate((goal_x, goal_y)):
        least, most = PLACES[goal]
        assert least <= share[..., axis].min() < least + 0.02
        assert most - 0.02 < share[..., axis].max() <= most


def test_paper_starts_lie_opposite_the_goal_too():
    far = cases(preset("paper", 6.0, goal=(6.0, 5.0)), 3)
    near = cases(WORLD, 3)
    np.testing.assert_allclose(far.sheep, 6.0 - near.sheep, atol=1e-5)
    there, here = shipped(preset("paper", 6.0, goal=(0.0, 6.0)), "random"), shipped(WORLD, "random")
    for one, other in ((there.sheep, here.sheep), (there.dogs, here.dogs)):
        np.testing.assert_allclose(one[..., 0], other[..., 0], atol=1e-5)
        np.testing.assert_allclose(one[..., 1], 6.0 - other[..., 1], atol=1e-5)


def test_sheep_anywhere_fill_the_arena_whatever_the_goal():
    for goal in ((0.0, 0.0), (6.0, 3.0)):
        sheep = np.asarray(cases(preset("paper", 6.0, goal=goal), 400, "anywhere", sheep=7).sheep)
        assert sheep.shape == (400, 7, 2)
        assert 0.0 <= sheep.min() < 0.02
        assert 5.98 < sheep.max() <= 6.0
        np.testing.assert_allclose(np.mean(sheep, axis=(0, 1)), 3.0, atol=0.1)


@pytest.mark.parametrize(
    ("asked", "bad", "remedy"),
    [
        ({"count": 0}, "0", "--cases"),
        ({"count": -3}, "-3", "--cases"),
        ({"sheep": 4}, "4", "--starts random"),
        ({"sheep": 0, "starts": "random"}, "0", "--sheep"),
        ({"dogs": 0}, "0", "--dogs"),
    ],
)
def test_cases_that_cannot_be_are_refused_with_the_bad_value_and_the_remedy(asked, bad, remedy):
    with pytest.raises(Refusal) as refusal:
        cases(WORLD, **asked)
    assert bad in str(refusal.value)
    assert remedy in str(refusal.value)


# The cases that ship


@pytest.mark.parametrize(
    ("name", "drawn"), [("paper", (30, "paper", 0)), ("random", (1000, "random", 1))]
)
@pytest.mark.parametrize("arena", [4.0, 6.0])
def test_shipped_cases_are_those_that_are_drawn_bit_for_bit(name, drawn, arena):
    world = preset("paper", arena)
    there, here = shipped(world, name), cases(world, *drawn)
    assert np.array_equal(there.sheep, here.sheep)
    assert np.array_equal(there.dogs, here.dogs)


def test_cases_survive_their_table():
    world = preset("paper", 4.0)
    drawn = cases(world, 5, "random", seed=3)
    head, *rows = as_table(world, drawn).splitlines()
    assert head.split(",")[:3] == ["dog_x", "dog_y", "sheep1_x"]
    shares = np.array([row.split(",") for row in rows], np.float32).reshape(5, 4, 2)
    np.testing.assert_array_equal(4.0 * shares[:, :1], drawn.dogs)
    np.testing.assert_array_equal(4.0 * shares[:, 1:], drawn.sheep)

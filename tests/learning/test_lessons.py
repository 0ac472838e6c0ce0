from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.learning import lessons
from skydog.learning.lessons import EVEN, Draws, Episode
from skydog.shepherds.networks import Actor
from skydog.shepherds.sheepdog import Sheepdog
from skydog.world import herding, mission
from skydog.world.presets import furthest_first, preset, with_nearness
from skydog.world.state import start

# In the world's own axes, where no frame and no draw of ours is meant.
Lesson = partial(lessons.Lesson, frame="paper", draws=EVEN)
WORLD = preset("paper", 4.0)
SIX = preset("paper", 6.0)
SKILLS = ("collect", "drive")
# Out of the dog's sight, so that sheep and subgoal stand still.
FAR = ([[0.5, 0.5], [1.6, 0.5], [0.5, 1.6]], [4.5, 4.5])
STARTS = 500

step = eqx.filter_jit(lambda lesson, episode, action: lesson.step(episode, action))


@eqx.filter_jit
def starts(lesson):
    return jax.vmap(lesson.start)(jax.random.split(jax.random.key(0), STARTS))


@eqx.filter_jit
def flown(lesson, pilot, episode, count):
    """Outcomes of `count` steps from one episode, without starting anew, and distances."""

    def fly(episode, _):
        after, outcome = lesson.step(episode, pilot(lesson, episode))
        return after, (outcome, jnp.linalg.norm(lesson.observe(after)[2:]))

    return jax.lax.scan(fly, episode, length=count)[1]


def idle(lesson, episode):
    return jnp.zeros(2)


def to_the_subgoal(lesson, episode):
    """As fast as needed to be there in one step; x and y from the subgoal are seen 3rd and 4th."""
    return jnp.clip(-lesson.observe(episode)[2:] / 0.1, -1.0, 1.0)


def an_episode(sheep, dog, scale=1.0):
    return Episode(
        state=start(jnp.array(sheep, jnp.float32), jnp.array([dog], jnp.float32)),
        goal=jnp.zeros(2),
        scale=jnp.asarray(scale),
        step=jnp.asarray(0),
        arrived=jnp.asarray(False),
    )


def spread_of(sheep):
    return np.linalg.norm(sheep - sheep.mean(axis=1, keepdims=True), axis=2).max(axis=1)


# Starts


@pytest.mark.parametrize("world", [WORLD, SIX], ids=["4x4", "6x6"])
@pytest.mark.parametrize("skill", SKILLS)
def test_every_start_is_a_legal_one(world, skill):
    begun = starts(Lesson(world, skill))
    size, edge = world.arena.size, world.dog.airspace
    sheep, dogs = np.asarray(begun.state.sheep), np.asarray(begun.state.dogs)
    size = np.asarray(size / begun.scale)[:, None, None]  # of the arena that each is in
    assert sheep.shape == (STARTS, 3, 2)
    assert dogs.shape == (STARTS, 1, 2)
    assert np.all(sheep >= 0.0)
    assert np.all(sheep <= size * (1 + 1e-6))
    assert np.all(dogs >= np.float32(-edge))
    assert np.all(dogs <= (size + edge) * (1 + 1e-6))
    assert begun.scale.min() >= np.float32(lessons.SCALES[0])
    assert begun.scale.max() <= np.float32(lessons.SCALES[1])
    assert not begun.step.any()
    assert not begun.arrived.any()
    assert not begun.state.force.any()


def test_starts_differ_and_reach_the_whole_arena_and_every_scale():
    begun = starts(Lesson(WORLD, "drive"))
    assert len(np.unique(np.asarray(begun.state.dogs)[:, 0, 0])) > 0.8 * STARTS
    share = np.asarray(begun.state.sheep * begun.scale[:, None, None]) / 4.0
    assert np.ptp(share, axis=(0, 1)).min() > 0.85
    assert begun.scale.min() < 0.11
    assert begun.scale.max() > 1.3


def test_lessons_at_one_scale_are_all_in_the_lessons_own_arena():
    begun = starts(Lesson(WORLD, "collect", scales=(1.0, 1.0)))
    assert np.unique(begun.scale).tolist() == [1.0]
    assert begun.state.sheep.max() <= 4.0


@pytest.mark.parametrize("world", [WORLD, SIX], ids=["4x4", "6x6"])
def test_a_flock_to_drive_starts_gathered_most_of_the_time(world):
    spread = spread_of(np.asarray(starts(Lesson(world, "drive")).state.sheep))
    assert np.mean(spread <= 1.3) > 0.85


@pytest.mark.parametrize("world", [WORLD, SIX], ids=["4x4", "6x6"])
def test_a_flock_to_collect_starts_scattered_most_of_the_time(world):
    spread = spread_of(np.asarray(starts(Lesson(world, "collect")).state.sheep))
    assert np.mean(spread > 1.3) > 0.5


@pytest.mark.parametrize("skill", SKILLS)
def test_a_share_of_the_lessons_has_its_goal_anywhere_and_the_others_where_the_world_has_it(skill):
    world = preset("paper", 4.0, goal=(1.0, 3.0))
    for share in (0.0, 0.5):
        goals = np.asarray(starts(Lesson(world, skill, draws=Draws(anywhere=share))).goal)
        own = np.all(goals == [0.25, 0.75], axis=1)
        assert abs(np.mean(~own) - share) < 0.1
        assert np.all((goals >= 0.0) & (goals <= 1.0))
    assert np.ptp(goals, axis=0).min() > 0.95


def test_flocks_to_drive_start_nearer_to_the_rim_the_smaller_the_power():
    spread = {
        power: np.median(
            spread_of(np.asarray(starts(Lesson(WORLD, "drive", draws=Draws(power))).state.sheep))
        )
        for power in (1.0, 0.5, 0.25)
    }
    assert spread[1.0] < spread[0.5] < spread[0.25] <= 1.3


def test_a_share_of_the_flocks_to_collect_starts_anywhere():
    far = {
        share: spread_of(
            np.asarray(starts(Lesson(WORLD, "collect", draws=Draws(anywhere=share))).state.sheep)
        )
        for share in (0.0, 1.0)
    }
    drawn = 4.0 * np.random.default_rng(0).uniform(size=(STARTS, 3, 2))
    drawn = drawn / np.asarray(starts(Lesson(WORLD, "collect")).scale)[:, None, None]
    assert np.median(far[1.0]) == pytest.approx(np.median(spread_of(drawn)), rel=0.15)
    assert np.median(far[0.0]) < 0.8 * np.median(far[1.0])


# What is seen


@pytest.fixture
def shown(monkeypatch):
    """What a sheepdog was shown last."""
    seen = []
    called = Actor.__call__

    def noting(self, observation):
        seen.append(np.asarray(observation).reshape(-1, 4)[0])
        return called(self, observation)

    monkeypatch.setattr(Actor, "__call__", noting)
    return seen


@pytest.mark.parametrize("skill", SKILLS)
@pytest.mark.parametrize("arena", [4.0, 6.0, 20.0])
@pytest.mark.parametrize("frame", ["folded", "paper"])
def test_a_lesson_shows_and_flies_what_a_sheepdog_does_in_an_arena_of_its_scale(
    skill, arena, frame, shown
):
    xi = 4.0 / arena
    lesson = Lesson(WORLD, skill, scales=(xi, xi), frame=frame, draws=Draws(anywhere=0.5))
    actor = Actor(4, 2, (3,), jax.random.key(0))
    sheepdog = Sheepdog(actor, actor, 4.0, frame)
    compared = 0
    for key in jax.random.split(jax.random.key(1), 8):
        episode = replace(lesson.start(key), scale=jnp.asarray(xi))
        goal_x, goal_y = map(float, arena * episode.goal)
        world = furthest_first(preset("paper", arena, goal=(goal_x, goal_y)))
        state = episode.state
        if bool(herding.gathered(world, state.sheep)) != (skill == "drive"):
            continue
        compared += 1
        seen = lesson.observe(episode)
        flown = sheepdog(world, state)
        np.testing.assert_allclose(shown[-1], seen, rtol=1e-5, atol=1e-6)
        after, _ = lesson.step(episode, actor(seen))
        expected = mission.step(world, state, flown)
        np.testing.assert_allclose(after.state.dogs, expected.dogs, rtol=1e-5, atol=1e-6)
    assert compared > 1


@pytest.mark.parametrize("scale", [0.2, 1.0, 1.3])
def test_the_scale_shrinks_what_is_seen(scale):
    sheep, dog = [[2.0, 2.0], [2.3, 2.0], [2.0, 2.3]], [1.0, 2.9]
    centre = np.mean(sheep, axis=0)
    point = centre + np.sqrt(3) * centre / np.linalg.norm(centre)
    seen = Lesson(WORLD, "drive").observe(an_episode(sheep, dog, scale))
    expected = scale * np.concatenate([dog - centre, dog - point])
    np.testing.assert_allclose(seen, expected, atol=1e-5)


def test_a_step_of_fixed_length_is_not_stretched():
    still = an_episode(*FAR, 0.2)
    ends = {
        stretches: Lesson(WORLD, "drive", stretches=stretches).step(still, jnp.array([0.5, 0.0]))[0]
        for stretches in (True, False)
    }
    moved = {key: float(end.state.dogs[0, 0]) - FAR[1][0] for key, end in ends.items()}
    assert moved[False] == pytest.approx(0.05, abs=1e-5)
    assert moved[True] == pytest.approx(0.1 * np.tanh(0.5 / 0.2), abs=1e-5)


def test_the_stray_of_a_lesson_is_the_furthest_whatever_the_gate_of_its_world():
    episode = an_episode([[0.2, 0.2], [3.8, 3.6], [0.3, 3.5]], [0.6, 3.0])
    sheep = np.asarray(episode.state.sheep, float)
    centre, _, subgoal = by_hand(sheep, None, "collect", 1.0)
    for nearness in (0.0, 1.0):
        seen = Lesson(with_nearness(WORLD, nearness), "collect").observe(episode)
        expected = np.concatenate([[0.6, 3.0] - centre, [0.6, 3.0] - subgoal])
        np.testing.assert_allclose(seen, expected, atol=1e-5)


# How it pays

SCENES = [
    ([[2.0, 2.0], [2.3, 2.0], [2.0, 2.3]], [3.1, 3.3]),
    ([[1.0, 1.2], [1.4, 1.0], [3.2, 2.4]], [3.0, 3.5]),
    ([[2.5, 1.0], [1.0, 2.5], [1.2, 1.1]], [0.2, 0.4]),
]


def by_hand(sheep, dog, skill, aim):
    """Centre, stray and subgoal, from positions."""
    centre = sheep.mean(axis=0)
    stray = np.argmax(np.linalg.norm(sheep - centre, axis=1))
    if skill == "drive":
        subgoal = centre + aim * np.sqrt(3) * centre / np.linalg.norm(centre)
    else:
        outward = (sheep[stray] - centre) / np.linalg.norm(sheep[stray] - centre)
        subgoal = sheep[stray] + aim * outward
    return centre, stray, np.clip(subgoal, -1.4, 6.4)


@pytest.mark.parametrize("skill", SKILLS)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("action", [(1.0, -0.5), (-0.7, -1.0), (0.0, 0.0)])
def test_progress_pays_metres_gained_on_the_subgoal_and_by_the_flock_less_what_it_costs(
    skill, scene, action
):
    scale = 0.8  # in an arena of 5 m
    before = an_episode(*scene, scale)  # pyright: ignore[reportCallIssue]
    after, outcome = step(Lesson(WORLD, skill), before, jnp.array(action))
    sheep, dog = (np.asarray(part, float) for part in (before.state.sheep, before.state.dogs[0]))
    sheep2, dog2 = (np.asarray(part, float) for part in (after.state.sheep, after.state.dogs[0]))
    aim = lessons.NEARER
    centre, stray, subgoal = by_hand(sheep, dog, skill, aim)
    centre2, _, subgoal2 = by_hand(sheep2, dog2, skill, aim)
    was, now = np.linalg.norm(dog - subgoal), np.linalg.norm(dog2 - subgoal2)
    if skill == "drive":
        gain = np.linalg.norm(centre) - np.linalg.norm(centre2)
    else:
        gain = np.linalg.norm(sheep[stray] - centre) - np.linalg.norm(sheep2[stray] - centre)
    flight = np.linalg.norm(dog2 - dog)
    paid = was - now + 4.0 * gain - 0.1 * scale * now - 0.5 * flight
    np.testing.assert_allclose(outcome.reward, paid, atol=1e-5)


@pytest.mark.parametrize(
    ("action", "paid"),
    [((-1.0, -1.0), 0.1), ((1.0, 1.0), -0.1), ((0.5, 0.4), -0.1), ((0.0, 0.0), 0.1)],
    ids=["nearer", "further", "a little further", "still"],
)
def test_the_papers_reward_pays_for_not_getting_further_away(action, paid):
    before = an_episode(*FAR)
    after, outcome = step(Lesson(WORLD, "drive", "paper"), before, jnp.array(action))
    assert np.array_equal(before.state.sheep, after.state.sheep)
    np.testing.assert_allclose(outcome.reward, paid, rtol=1e-6)
    assert not outcome.terminated


def test_an_idle_dog_games_the_papers_reward_and_a_diligent_one_earns_less():
    lesson = Lesson(WORLD, "drive", "paper")
    outcome, _ = flown(lesson, idle, an_episode(*FAR), 999)
    assert not outcome.terminated.any()
    np.testing.assert_allclose(outcome.reward.sum(), 99.9, rtol=1e-4)
    diligent, _ = flown(lesson, to_the_subgoal, an_episode(*FAR), 999)
    until = int(np.argmax(diligent.terminated)) + 1
    assert diligent.terminated.any()
    assert diligent.reward[:until].sum() < 10.0


@pytest.mark.parametrize("skill", SKILLS)
def test_progress_pays_an_idle_dog_far_less_than_one_that_flies_to_its_subgoal(skill):
    lesson = Lesson(WORLD, skill, scales=(1.0, 1.0))
    begun = jax.tree.map(lambda leaf: leaf[:30], starts(lesson))

    def earned(pilot):
        fly = jax.vmap(partial(flown, lesson, pilot), in_axes=(0, None))
        return fly(begun, lessons.HORIZON["progress"])[0].reward.sum(axis=1)

    lazy, diligent = np.asarray(earned(idle)), np.asarray(earned(to_the_subgoal))
    assert lazy.max() <= 0.2  # the flock may come together by itself, by centimetres
    assert np.mean(diligent > lazy) > 0.8
    assert diligent.mean() > lazy.mean() + 5.0


# How it ends


@pytest.mark.parametrize("skill", SKILLS)
@pytest.mark.parametrize("reward", ["progress", "paper"])
def test_an_outcome_is_never_both_terminated_and_truncated(skill, reward):
    lesson = Lesson(WORLD, skill, reward)
    horizon = lessons.HORIZON[reward]
    ends = 0
    for distance in (0.05, 0.2, 0.339, 0.341, 3.0):
        episode = lesson.start(jax.random.key(5))
        subgoal = episode.state.dogs[0] - lesson.observe(episode)[2:] / episode.scale
        there = replace(episode.state, dogs=(subgoal + jnp.array([distance, 0.0]))[None])
        last = replace(episode, state=there, step=jnp.asarray(horizon - 1))
        _, outcome = step(lesson, last, jnp.zeros(2))
        assert bool(outcome.terminated) != bool(outcome.truncated)
        ends += int(outcome.terminated)
    assert (ends > 0) == (reward == "paper")


def test_a_progress_lesson_goes_on_after_arrival_for_50_steps():
    lesson = Lesson(WORLD, "drive")
    outcome, distance = flown(lesson, to_the_subgoal, an_episode(*FAR), 50)
    assert (distance[:49] <= lessons.ARRIVAL).any()
    assert not outcome.terminated.any()
    assert np.flatnonzero(outcome.truncated).tolist() == [49]
    arrived = int(np.argmax(outcome.success))
    assert 0 < arrived < 49
    assert outcome.success[arrived:].all()


def test_the_papers_lesson_ends_on_arrival():
    outcome, distance = flown(
        Lesson(WORLD, "drive", "paper"), to_the_subgoal, an_episode(*FAR), 200
    )
    arrived = int(np.argmax(np.asarray(distance) <= lessons.ARRIVAL))
    assert 0 < arrived < 199
    assert int(np.argmax(outcome.terminated)) == arrived
    assert not outcome.truncated.any()
    assert bool(outcome.success[arrived])


def test_the_papers_lesson_is_cut_off_after_1000_steps():
    outcome, _ = flown(Lesson(WORLD, "drive", "paper"), idle, an_episode(*FAR), 1000)
    assert np.flatnonzero(outcome.truncated).tolist() == [999]
    assert not outcome.success.any()

import re
from typing import Any

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.wrappers import RecordEpisodeStatistics

import skydog
import skydog.envs
from skydog.envs import tasks
from skydog.errors import Refusal
from skydog.study import metrics
from skydog.world import mission

NAMES = ("skydog/Herd-v0", "skydog/Collect-v0", "skydog/Drive-v0")
STILL = np.zeros(2, np.float32)


def make(name, **options) -> Any:
    return gymnasium.make(name, **options)


def test_a_module_and_a_name_are_enough_for_gymnasium():
    assert make("skydog.envs:skydog/Herd-v0").spec.max_episode_steps == 1000


def flown(env, shepherd, seed):
    """A mission through the environment: observations are not asked, the state is."""
    env.reset(seed=seed)
    inner = env.unwrapped
    rewards, infos = [], []
    while True:
        state = inner.task.perceived(inner._env.episode)[0]
        velocity = shepherd(inner.task.world, state)[0]
        action = np.asarray(velocity / inner.task.world.dog.speed)
        _, reward, terminated, truncated, info = env.step(action)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            return rewards, infos, terminated


@pytest.mark.parametrize("preset", ["paper", "strombom2014"])
def test_a_mission_is_the_rollout_of_the_same_start_noise_included(preset):
    env = make("skydog/Herd-v0", preset=preset, max_episode_steps=60)
    inner = env.unwrapped
    env.reset(seed=5)
    before = inner._env.episode
    shepherd = skydog.Strombom()
    key = before.key if preset == "strombom2014" else None
    trace = mission.rollout(inner.task.world, shepherd, before.state, 60, key)
    _, infos, terminated = flown(env, shepherd, 5)
    assert terminated == bool(metrics.success(trace))
    assert infos[-1]["steps"] == int(metrics.steps(trace))
    assert infos[-1]["distance"] == pytest.approx(float(metrics.distance(trace)), rel=1e-4)
    np.testing.assert_allclose(inner._env.episode.state.sheep, trace.sheep[-1], atol=1e-3)


def test_a_sheepdog_that_ships_herds_through_its_observation_alone():
    sheepdog = skydog.load("h-ddpg-4x4")
    env = make("skydog/Herd-v0", starts="paper")
    for seed in range(5):
        seen, info = env.reset(seed=seed)
        terminated = truncated = False
        while not (terminated or truncated):
            skill = sheepdog.drive if info["drives"] else sheepdog.collect
            seen, _, terminated, truncated, info = env.step(np.asarray(skill(jnp.asarray(seen))))
        assert terminated
        assert info["success"]


def test_a_mission_pays_a_shepherd_more_than_chance():
    env = make("skydog/Herd-v0", max_episode_steps=300)
    env.action_space.seed(0)

    def chance(world, state):
        return world.dog.speed * env.action_space.sample()[None]

    for seed in range(3):
        ruled, _, home = flown(env, skydog.Strombom(), seed)
        aimless, _, _ = flown(env, chance, seed)
        assert home
        assert sum(ruled) > sum(aimless) + 1.0


def test_the_rewards_of_a_mission_add_up_to_what_was_to_do_less_the_time():
    env = make("skydog/Herd-v0")
    env.reset(seed=2)
    task, start = env.unwrapped.task, env.unwrapped._env.episode.state
    rewards, infos, _ = flown(env, skydog.Strombom(), 2)
    end = env.unwrapped._env.episode.state
    gained = task._remaining(start) - task._remaining(end)
    expected = float(gained) - tasks.STEP_COST * infos[-1]["steps"] + tasks.ACCOMPLISHED
    assert sum(rewards) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("name", "steps"), [("Herd", 1000), ("Drive", 50), ("Collect", 50)])
def test_running_out_of_time_truncates_and_does_not_terminate(name, steps):
    env = make(f"skydog/{name}-v0")
    env.reset(seed=0)
    for step in range(1, steps + 1):
        _, _, terminated, truncated, info = env.step(STILL)
        assert not terminated
        assert truncated == (step == steps)
        assert info["steps"] == step


def test_the_papers_lesson_terminates_on_arrival():
    env = make("skydog/Drive-v0", reward="paper")
    seen, info = env.reset(seed=1)
    terminated = truncated = False
    while not (terminated or truncated):
        seen, reward, terminated, truncated, info = env.step(np.clip(-seen[2:], -1, 1))
        assert abs(reward) == pytest.approx(0.1)
    assert terminated
    assert info["success"]


def test_one_seed_is_one_episode_and_the_next_episode_is_another():
    env = make("skydog/Herd-v0")
    first, again = env.reset(seed=7)[0], env.reset(seed=7)[0]
    other = env.reset()[0]
    env.reset(seed=7)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert np.array_equal(other, env.reset()[0])


def test_full_sees_everybody_from_the_dog():
    env = make("skydog/Herd-v0", observation="full")
    sheep, dog = [[1.0, 2.0], [2.0, 2.0], [2.0, 3.0]], [[3.0, 1.0]]
    seen, _ = env.reset(seed=0, options={"sheep": sheep, "dogs": dog})
    expected = np.array([*sheep, [0.0, 0.0]]) - dog
    np.testing.assert_allclose(seen, expected.ravel(), atol=1e-6)


def test_info_is_the_missions_metrics():
    env = make("skydog/Herd-v0")
    sheep = [[1.0, 1.0], [2.0, 1.0], [3.0, 1.0]]
    _, info = env.reset(seed=0, options={"sheep": sheep, "dogs": [[4.0, 1.0]]})
    assert info["centre_to_goal"] == pytest.approx(np.hypot(2, 1))
    assert info["spread"] == pytest.approx(1.0)
    assert info["drives"] is True
    assert info["success"] is False
    assert info["distance"] == 0.0
    *_, info = env.step(np.array([0.6, 0.8], np.float32))
    assert info["distance"] == pytest.approx(0.1)


def test_gymnasiums_own_wrapper_counts_what_we_count():
    env: Any = RecordEpisodeStatistics(make("skydog/Drive-v0"))
    env.reset(seed=0)
    total, info = 0.0, {}
    for _ in range(50):
        _, reward, _, _, info = env.step(env.action_space.sample())
        total += reward
    assert info["episode"]["l"] == 50
    assert info["episode"]["r"] == pytest.approx(total, rel=1e-5)


# Bad input


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(3, np.float32), r"shape \(2,\), got \(3,\)"),
        (np.zeros((1, 2), np.float32), r"shape \(2,\), got \(1, 2\)"),
        (0.5, r"shape \(2,\), got \(\)"),
        (np.array([np.nan, 0.0]), "finite"),
        (np.array([0.0, np.inf]), "finite"),
        (np.array(["fast", "slow"]), "numbers from -1 to 1"),
        (None, "numbers from -1 to 1"),
        ([[1.0], [2.0, 3.0]], "numbers from -1 to 1"),
        ([10**400, 0], "numbers from -1 to 1"),
        (np.zeros(2, complex), "numbers from -1 to 1"),
    ],
)
def test_a_bad_action_is_an_invalid_action_and_moves_nobody(action, message):
    env = make("skydog/Herd-v0", disable_env_checker=True)
    env.reset(seed=0)
    with pytest.raises(InvalidAction, match=message):
        env.step(action)
    *_, info = env.step(STILL)
    assert info["steps"] == 1


def test_an_action_beyond_the_limit_flies_at_the_limit():
    env = make("skydog/Herd-v0", disable_env_checker=True)
    ends = []
    for action in ([5.0, 0.0], [1.0, 0.0]):
        env.reset(seed=0)
        ends.append(env.step(np.array(action))[4]["distance"])
    assert ends[0] == ends[1] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"preset": "nowhere"}, "paper"),
        ({"observation": "everything"}, "compact, full"),
        ({"starts": "somewhere"}, "paper, random"),
        ({"reward": "sugar"}, "progress, paper"),
        ({"sheep": 0}, "sheep must be"),
        ({"sheep": 10**9}, "10,000"),
        ({"sheep": True}, "sheep must be"),
        ({"arena": 1.0}, "longer than 2 m"),
        ({"arena": float("nan")}, "the arena's side is a length"),
        ({"starts": "paper", "sheep": 5}, "random"),
    ],
)
def test_a_bad_option_is_refused_with_the_remedy(options, message):
    with pytest.raises(Refusal, match=re.escape(message)):
        make("skydog/Herd-v0", **options)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("Herd", {"cat": 1}, "no option 'cat'; choose from sheep, dogs"),
        ("Herd", {"sheep": [[1.0, 1.0]]}, "places 3"),
        ("Herd", {"sheep": [[1.0, 1.0]] * 2 + [[9.0, 1.0]]}, "from 0 to 4 m"),
        ("Herd", {"dogs": [[np.nan, 0.0]]}, "from -1.4 to 5.4 m"),
        ("Herd", {"dogs": "here"}, "places 1"),
        ("Herd", {"dogs": [[10**400, 0]]}, "places 1"),
        ("Herd", {"dogs": [["1", "2"]]}, "got [['1', '2']]"),
        ("Herd", {"dogs": [[True, False]]}, "places 1"),
        ("Herd", {"dogs": np.ones((1, 2), complex)}, "places 1"),
        ("Herd", {"dogs": [[1.0], [2.0, 3.0]]}, "places 1"),
        ("Drive", {"sheep": [[1.0, 1.0]] * 3}, "a lesson draws its start"),
        ("Herd", [1], "a dict"),
    ],
)
def test_a_bad_reset_is_refused_with_the_remedy(name, options, message):
    env = make(f"skydog/{name}-v0")
    with pytest.raises(Refusal, match=re.escape(message)):
        env.reset(options=options)


@pytest.mark.parametrize("seed", [-1, 0.5, "7", True])
def test_a_bad_seed_or_option_changes_nothing_of_what_follows(seed):
    env, other = make("skydog/Herd-v0").unwrapped, make("skydog/Herd-v0").unwrapped
    env.reset(seed=3)
    other.reset(seed=3)
    with pytest.raises(Refusal, match="whole number from 0 on"):
        env.reset(seed=seed)
    with pytest.raises(Refusal, match="no option"):
        env.reset(seed=9, options={"cat": 1})
    assert np.array_equal(env.reset()[0], other.reset()[0])


def test_numpys_integers_are_seeds_too():
    env = make("skydog/Herd-v0")
    assert np.array_equal(env.reset(seed=3)[0], env.reset(seed=np.int64(3))[0])


@pytest.mark.parametrize("seed", [2**64 + 3, 10**400], ids=["65 bits", "400 digits"])
def test_a_seed_of_any_length_counts_modulo_two_to_the_32(seed):
    env = make("skydog/Herd-v0")
    assert np.array_equal(env.reset(seed=seed)[0], env.reset(seed=seed % 2**32)[0])


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [
        ("arena", "size", 1e39),
        ("arena", "dt", 0.0),
        ("dog", "airspace", -1.0),
        ("dog", "speed", np.ones(2)),
        ("sheep", "speed", "fast"),
    ],
)
def test_a_world_whose_numbers_are_none_is_refused_by_their_name(part, name, value):
    odd = eqx.tree_at(lambda world: getattr(getattr(world, part), name), skydog.preset(), value)
    with pytest.raises(Refusal, match=rf"world\.{part}\.{name} is a number"):
        make("skydog/Herd-v0", world=odd)


def test_what_is_no_world_is_refused():
    with pytest.raises(Refusal, match=r"skydog\.preset"):
        make("skydog/Herd-v0", world="paper")


def test_step_and_render_before_reset_are_refused():
    env = make("skydog/Herd-v0", render_mode="rgb_array").unwrapped
    for call in (lambda: env.step(STILL), env.render):
        with pytest.raises(ResetNeeded, match=r"env\.reset\(\)"):
            call()


def test_a_world_of_your_own_is_herded_in():
    world = skydog.preset("paper", arena=5.0)
    env = make("skydog/Herd-v0", world=world)
    assert float(env.unwrapped.task.world.arena.size) == 5.0
    env.reset(seed=0)
    assert np.isfinite(env.step(STILL)[0]).all()


def test_a_lesson_sees_the_world_at_its_own_scale():
    env = make("skydog/Drive-v0", observation="full")
    seen, _ = env.reset(seed=4)
    episode = env.unwrapped._env.episode
    sheep = np.asarray(episode.state.sheep - episode.state.dogs)
    np.testing.assert_allclose(seen[:6].reshape(3, 2), np.asarray(episode.scale) * sheep, atol=1e-5)
    assert jax.tree.leaves(env.unwrapped.task.lesson.scales) == [0.1, 1.4]

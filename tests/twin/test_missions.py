"""Missions in the twin, from the outside: `Twin` as whoever measures and records calls it."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rigs import ROVER, TUM, ending, poses

from skydog.errors import Refusal
from skydog.flight import altitude, profiles
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate, metrics
from skydog.twin import Disturbances, Twin, missions, starts
from skydog.world import mission
from skydog.world import trace as traces
from skydog.world.mission import Fly
from skydog.world.presets import preset

pytestmark = pytest.mark.usefixtures("unchecked")

WORLD = preset("paper", 4.0)
STEPS = 260
SOON = Twin(profile="crazyflie", threads=1)  # it climbs fastest


def drawn(count=2, **options):
    return starts.draw(WORLD, count, "spaced", TUM, ROVER, **options)


def placed(sheep, dogs=((0.5, 0.5),)):
    state = mission.start(jnp.array(sheep, jnp.float32), jnp.array(dogs, jnp.float32))
    return jax.tree.map(lambda leaf: leaf[None], state)


def same(here, there):
    pairs = zip(jax.tree.leaves(here), jax.tree.leaves(there), strict=True)
    return all(np.array_equal(a, b) for a, b in pairs)


@pytest.fixture(scope="module")
def start():
    return drawn()


@pytest.fixture(scope="module")
def herded(start):
    return Twin(threads=1)(WORLD, Strombom(), start, STEPS)


# A mission as a trace


def test_the_twin_is_a_fly():
    assert isinstance(Twin(), Fly)


@pytest.mark.usefixtures("checked")
def test_a_mission_keeps_to_its_shapes_with_two_dogs_and_all_that_goes_wrong(monkeypatch):
    monkeypatch.setattr(altitude, "HEIGHT", 0.5)  # checked, a second of flight takes five
    monkeypatch.setattr(missions, "SETTLES", 0.5)
    begin = placed(((3.0, 3.0), (3.0, 3.6)), dogs=((0.5, 0.5), (0.5, 2.0)))
    told = []
    twin = replace(
        SOON, disturb="lab", wait=0.1, steering="turn", progress=lambda *n: told.append(n)
    )
    flown = twin(WORLD, Strombom(), begin, 2)
    assert told == [(0, 0), (1, 0), (2, 1)]
    assert poses(flown).attitude.shape == (1, 3, 2, 3)
    # Each further dog flies 0.6 m above the one before.
    np.testing.assert_allclose(poses(flown).altitude[0, -1], [0.5, 1.1], atol=0.1)


def test_missions_are_accomplished_and_count_as_in_the_kinematic_world(herded):
    row = evaluate.row(herded)
    assert (row["success"], row["cases"]) == (1.0, 2)
    assert 50 < row["steps"]["mean"] < STEPS
    for case in range(2):
        one = evaluate.one_case(herded, case)
        assert traces.how_it_ended(one) == "accomplished"
        done = traces.last_instant(one)
        assert bool(mission.accomplished(WORLD, mission.start(one.sheep[done], one.dogs[done])))
        assert int(metrics.steps(one)) == done
        # Then the world stands still, and nothing is commanded.
        assert not np.any(np.asarray(one.command)[done:])
        for part in jax.tree.leaves((one.sheep, one.dogs, one.poses)):
            assert np.ptp(np.asarray(part)[done:], axis=0).max() == 0.0


def test_what_is_flown_is_within_what_robots_and_room_allow(herded):
    flown = poses(herded)
    np.testing.assert_allclose(flown.altitude, 2.0, atol=0.1)
    assert np.abs(flown.attitude[..., :2]).max() < TUM.attitude.largest + 0.1
    assert np.abs(flown.speed).max() <= ROVER.motion.largest_speed + 1e-6
    assert np.abs(flown.turn_rate).max() <= ROVER.motion.largest_turn_rate + 1e-6
    assert -0.01 < float(herded.sheep.min()) <= float(herded.sheep.max()) < 4.01
    # A sheep moves no further in a step than its wheels bring it.
    moved = np.linalg.norm(np.diff(herded.sheep, axis=1), axis=-1)
    assert moved.max() < 1.05 * ROVER.motion.largest_speed * 0.1


def test_a_mission_begins_at_its_height_above_its_pad(herded, start):
    np.testing.assert_allclose(herded.dogs[:, 0], start.dogs, atol=0.02)
    np.testing.assert_allclose(poses(herded).altitude[:, 0], 2.0, atol=0.05)
    np.testing.assert_allclose(poses(herded).attitude[:, 0], 0.0, atol=0.01)


def test_a_mission_with_its_poses_and_its_ending_is_saved_and_read_back(tmp_path, herded):
    one = evaluate.one_case(herded, 0)
    traces.save(tmp_path / "flown.safetensors", one, "strombom")
    read, who = traces.load(tmp_path / "flown.safetensors")
    until = traces.last_instant(one) + 1
    assert who == "strombom"
    assert traces.how_it_ended(read) == "accomplished"
    assert int(ending(read).steps) == STEPS
    for name in ("sheep", "dogs", "command", "subgoal", "drives", "accomplished"):
        np.testing.assert_array_equal(getattr(read, name), getattr(one, name)[:until])
    for name, written in vars(one.poses).items():
        np.testing.assert_array_equal(getattr(read.poses, name), written[:until])


def test_a_mission_of_no_steps_is_the_start_alone(start):
    flown = SOON(WORLD, Strombom(), start, 0)
    assert flown.sheep.shape[:2] == (2, 1)
    assert not np.any(flown.command)
    assert [traces.how_it_ended(evaluate.one_case(flown, case)) for case in (0, 1)] == [
        "out of time"
    ] * 2


# The same again, and otherwise


@pytest.fixture(scope="module")
def shaken(start):
    return replace(SOON, disturb="lab")(WORLD, Strombom(), start, 20, jax.random.key(3))


def test_missions_are_the_same_bit_for_bit_on_one_core_and_on_two(start, shaken):
    twin = replace(SOON, disturb="lab", threads=2)
    assert same(shaken, twin(WORLD, Strombom(), start, 20, jax.random.key(3)))


def test_another_key_draws_other_disturbances_and_none_is_the_key_0(start, shaken):
    twin = replace(SOON, disturb="lab")
    none, zero = (twin(WORLD, Strombom(), start, 3, key) for key in (None, jax.random.key(0)))
    assert same(none, zero)
    assert not np.array_equal(none.dogs, shaken.dogs[:, :4])


def test_a_mission_is_the_same_in_any_company(start, shaken):
    one = jax.tree.map(lambda leaf: leaf[:1], start)
    alone = replace(SOON, disturb="lab")(WORLD, Strombom(), one, 10, jax.random.key(3))
    for who in ("dogs", "sheep"):
        together = getattr(shaken, who)[0, :11]
        np.testing.assert_allclose(getattr(alone, who)[0], together, atol=1e-5)


def test_the_worse_the_disturbances_the_further_off_is_what_is_flown(start, shaken):
    calm = SOON(WORLD, Strombom(), start, 3)
    mild = replace(SOON, disturb="mild")(WORLD, Strombom(), start, 3, jax.random.key(3))
    off = [
        np.abs(np.asarray(found.dogs[:, :4] - calm.dogs)).mean() for found in (calm, mild, shaken)
    ]
    assert 0.0 == off[0] < 1e-3 < off[1] < off[2] < 0.3


def test_half_the_time_step_changes_two_seconds_of_flight_by_less_than_a_centimetre(start):
    whole, half = (
        Twin(threads=1, timestep=timestep)(WORLD, Strombom(), start, 20)
        for timestep in (0.005, 0.0025)
    )
    for who in ("dogs", "sheep"):
        np.testing.assert_allclose(getattr(half, who), getattr(whole, who), atol=0.01)
    np.testing.assert_allclose(poses(half).altitude, poses(whole).altitude, atol=0.01)
    np.testing.assert_allclose(poses(half).yaw, poses(whole).yaw, atol=0.02)


def test_ideal_bodies_move_as_those_of_the_kinematic_world():
    # Everyone well within sight of one another: at the edge of it, millimetres decide. And they
    # decide on estimates, which are a tick old.
    begin = placed(((3.0, 3.0), (3.0, 3.6), (2.5, 2.6)), dogs=((1.6, 1.8),))
    twin = replace(SOON, ideal=frozenset({"sheep", "dogs"}))
    flown, kinematic = (fly(WORLD, Strombom(), begin, 8) for fly in (twin, evaluate.fly))
    np.testing.assert_allclose(flown.sheep, kinematic.sheep, atol=0.01)
    np.testing.assert_allclose(flown.dogs, kinematic.dogs, atol=0.01)
    np.testing.assert_array_equal(flown.drives, kinematic.drives)
    assert np.linalg.norm(kinematic.sheep[0, -1] - kinematic.sheep[0, 0], axis=-1).min() > 0.1
    np.testing.assert_allclose(poses(flown).altitude, 2.0, atol=1e-6)


def test_ideal_dogs_with_real_sheep_are_where_their_set_points_are(start):
    flown = replace(SOON, ideal=frozenset({"dogs"}))(WORLD, Strombom(), start, 5)
    setpoints = np.asarray(poses(flown).setpoint)[..., :2]
    # The set-point that an instant records is where the last decision was to end.
    np.testing.assert_allclose(flown.dogs[:, 1:], setpoints[:, 1:], atol=1e-5)


def test_a_set_point_is_held_until_the_drone_has_reached_it(start, herded):
    waits = replace(SOON, wait=0.05)(WORLD, Strombom(), start, 20)
    went, waited = (
        np.linalg.norm(np.diff(poses(each).setpoint[:, :21, 0, :2], axis=1), axis=-1)
        for each in (herded, waits)
    )
    assert went.min() > 0.05
    held = waited < 1e-6
    assert 0.2 < held.mean() < 0.95
    assert np.all(waited[~held] > 0.05)
    # A new one is taken only near the old one.
    away = np.linalg.norm(waits.dogs[..., 0, :] - poses(waits).setpoint[..., 0, :2], axis=-1)
    assert away[:, :-1][~held].max() < 0.05 + 0.02  # as the estimate has it, a tick ago


# What is refused


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"profile": "ardrone9"}, "no uav profile is called 'ardrone9'"),
        ({"rovers": "tank"}, "no rover profile is called 'tank'"),
        ({"disturb": "storm"}, "no disturbances are called 'storm'; choose from none, mild, lab"),
        ({"timestep": 0.004}, r"must divide 0.005 s, got 0.004 s"),
        ({"timestep": 0.0}, r"must divide 0.005 s, got 0 s|time ?step"),
        ({"timestep": 0.01}, r"must divide 0.005 s, got 0.01 s"),
    ],
)
def test_a_twin_of_what_is_not_there_is_refused_before_it_flies(start, options, told):
    with pytest.raises(Refusal, match=told):
        replace(SOON, **options)(WORLD, Strombom(), start, 1)


@pytest.mark.parametrize("dt", [0.125, 0.004, 0.0])
def test_decisions_that_are_not_ticks_apart_are_refused(start, dt):
    world = replace(WORLD, arena=replace(WORLD.arena, dt=dt))
    with pytest.raises(Refusal, match=f"0.01 s apart or a multiple of it, got {dt:g} s"):
        SOON(world, Strombom(), start, 1)


@pytest.mark.parametrize("dt", [0.05, 0.2])
def test_decisions_that_are_a_multiple_of_a_tick_apart_are_flown(start, dt):
    world = replace(WORLD, arena=replace(WORLD.arena, dt=dt))
    flown = SOON(world, Strombom(), start, 2)
    np.testing.assert_allclose(flown.time[0], [0.0, dt, 2 * dt], rtol=1e-6)


@pytest.mark.parametrize(
    ("begin", "told"),
    [
        (placed(((3.0, 3.0), (3.0, 3.3), (2.0, 2.0))), "in start 0 rovers overlap"),
        (placed(((3.0, 3.0), (2.0, 2.0)), dogs=((2.4, 2.0),)), "a drone's pad is not clear"),
        (placed(((3.0, 3.0),), dogs=((1.0, 1.0), (1.2, 1.0))), "a drone's pad is not clear"),
        (placed(((3.0, 3.0), (2.0, 2.0)), dogs=((3.9, 1.0),)), "a drone's pad is not clear"),
    ],
)
def test_a_start_that_cannot_be_flown_is_refused_by_its_reason_and_its_number(begin, told):
    with pytest.raises(Refusal, match=told):
        Twin()(WORLD, Strombom(), begin, 1)


def test_of_several_starts_the_one_that_cannot_be_flown_is_told_by_its_number():
    good, bad = placed(((3.0, 3.0), (2.0, 2.0))), placed(((3.0, 3.0), (3.1, 3.0)))
    both = jax.tree.map(lambda *parts: jnp.concatenate(parts), good, good, bad)
    with pytest.raises(Refusal, match=r"in start 2 rovers overlap.*skydog\.twin\.starts\.draw"):
        Twin()(WORLD, Strombom(), both, 1)


# Starts


@pytest.mark.parametrize("kind", ["paper", "spaced"])
def test_drawn_starts_can_all_be_flown_and_are_the_same_again(kind):
    begin, again, other = (
        starts.draw(preset("paper", 6.0), 16, kind, TUM, ROVER, seed) for seed in (1, 1, 2)
    )
    assert begin.sheep.shape == (16, 3, 2)
    assert all(fits.all() for fits in starts.flyable(begin, TUM, ROVER, 6.0))
    assert same(begin, again)
    assert not np.array_equal(begin.dogs, other.dogs)
    starts.check(begin, TUM, ROVER, 6.0)


def test_of_cases_that_are_not_drawn_for_it_some_cannot_be_flown():
    spaced, clear = starts.flyable(cases.cases(WORLD, 32, "random"), TUM, ROVER, 4.0)
    assert 0.2 < spaced.mean() < 1.0
    assert 0.2 < clear.mean() < 1.0


def test_the_drawn_starts_are_the_first_of_the_cases_that_can_be_flown():
    some = cases.cases(WORLD, 32, "random", seed=0)
    spaced, clear = starts.flyable(some, TUM, ROVER, 4.0)
    first = np.flatnonzero(spaced & clear)[:5]
    np.testing.assert_array_equal(drawn(5).sheep, some.sheep[first])


def test_a_flock_that_does_not_fit_is_refused():
    wide = replace(ROVER, body=replace(ROVER.body, radius=1.0))
    with pytest.raises(Refusal, match=r"3 rovers of 2 m do not find room .* arena of 4 m"):
        starts.draw(WORLD, 2, "spaced", TUM, wide)


def test_disturbances_of_ones_own_are_taken_as_they_are():
    own = Disturbances(gust=2.0)
    assert Twin(disturb=own).disturbances() is own
    assert Twin().disturbances() == Disturbances()


def test_every_profile_that_ships_brings_its_drone_to_its_height():
    begin = placed(((3.0, 3.0), (3.0, 3.6), (2.5, 2.6)), dogs=((1.0, 1.0),))
    for name in profiles.ship("uav"):
        flown = Twin(profile=name, threads=1)(WORLD, Strombom(), begin, 0)
        np.testing.assert_allclose(poses(flown).altitude, 2.0, atol=0.1)
        assert int(ending(flown).how[0]) == traces.OUT_OF_TIME


def test_a_plain_function_flies_what_a_module_does_and_is_traced_once(start):
    traced = []

    def shepherd(world, state):
        traced.append(1)
        return Strombom()(world, state)

    plain, module = (SOON(WORLD, steers, start, 5) for steers in (shepherd, Strombom()))
    assert len(traced) == 1
    # Compiled apart: the last bit may differ.
    np.testing.assert_allclose(plain.sheep, module.sheep, atol=1e-4)
    np.testing.assert_allclose(plain.dogs, module.dogs, atol=1e-4)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"steering": "fly"}, "do not steer by 'fly'"),
        ({"ideal": frozenset({"cats"})}, "'cats'"),
        ({"wait": -1.0}, "got -1.0"),
        ({"wait": float("nan")}, "got nan"),
        ({"threads": -1}, "got -1"),
        ({"disturb": Disturbances(gust=float("nan"))}, "gust is at least 0, got nan"),
        ({"disturb": Disturbances(action_delay=-1.0)}, "action_delay is at least 0, got -1.0"),
    ],
)
def test_an_option_that_is_none_is_refused_before_anything_is_flown(start, options, told):
    with pytest.raises(Refusal, match=told):
        replace(SOON, **options)(WORLD, Strombom(), start, 1)


def test_a_rover_that_starts_outside_the_arena_is_refused():
    begin = placed(((3.0, 3.0), (5.0, 2.0)))
    with pytest.raises(Refusal, match=r"in start 0 rovers .*outside the arena"):
        SOON(WORLD, Strombom(), begin, 1)


def test_a_drone_that_hardly_climbs_is_refused(start, tmp_path):
    path = tmp_path / "slow.toml"
    ships = profiles.__file__.replace("profiles.py", "profiles/crazyflie.toml")
    text = Path(ships).read_text()
    path.write_text(text.replace("largest_climb = 1.0 ", "largest_climb = 1e-9 "))
    with pytest.raises(Refusal, match=r"slow takes 2e\+09 s to climb to 2 m"):
        Twin(profile=str(path), threads=1)(WORLD, Strombom(), start, 1)


@pytest.mark.parametrize("threads", [1, 2])
def test_physics_that_breaks_down_is_told_in_one_line_and_leaves_no_log(
    start, tmp_path, monkeypatch, capfd, threads
):
    monkeypatch.chdir(tmp_path)
    slippery = replace(SOON, disturb=Disturbances(friction=0.0), threads=threads)
    with pytest.raises(Refusal, match="physics broke down in mission"):
        slippery(WORLD, Strombom(), start, 60)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr().err == ""

"""What is drawn for a mission, and what comes late."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from rigs import ARDRONE, TUM

from skydog.flight.rovers import Twist
from skydog.flight.station import DT, Commands
from skydog.twin.disturbances import DISTURBANCES, DRIFT_LASTS, GUST_LASTS, Disturbances
from skydog.twin.noise import Luck
from skydog.twin.plant import Truth

pytestmark = pytest.mark.usefixtures("unchecked")


def luck(uav=TUM, missions=2, seed=0, **disturbances):
    keys = jax.random.split(jax.random.key(seed), missions)
    return Luck(Disturbances(**disturbances), uav, keys, 3, 1)


def truth(value, missions=2):
    return Truth(
        np.full((missions, 1, 3), float(value)),
        np.zeros((missions, 1, 3)),
        np.full((missions, 3, 2), float(value)),
        np.full((missions, 3), float(value)),
    )


def commands(value, missions=2):
    sheep = np.full((missions, 3), float(value))
    dogs = np.full((missions, 1, 3), float(value))
    return Commands(dogs, dogs[..., :2], Twist(sheep, sheep))


def test_every_mission_draws_for_itself():
    (drawn,) = luck(mocap_noise=1.0).draw(1)
    assert drawn is not None
    one, other = drawn.dogs
    assert not np.any(one == other)
    yaw = luck().yaw
    assert np.all(np.abs(yaw) <= np.pi)
    assert len(np.unique(yaw)) == yaw.size


def test_without_disturbances_nothing_is_drawn_and_all_comes_as_it_is():
    calm = luck()
    assert calm.is_calm
    (drawn,) = calm.draw(1)
    assert drawn is None
    seen = calm.frame(truth(1.5), drawn)
    assert np.all(seen.dogs_seen)
    assert np.all(seen.sheep_seen)
    np.testing.assert_array_equal(seen.dogs, 1.5)
    np.testing.assert_array_equal(calm.hear(commands(0.3), drawn).velocity, 0.3)
    np.testing.assert_array_equal(calm.shake(commands(0.3).velocity, drawn), 0.3)
    np.testing.assert_array_equal(calm.grip(), 1.0)
    assert calm.wind(drawn) is None


@pytest.mark.parametrize("name", ["mild", "lab"])
def test_what_ships_is_not_calm(name):
    keys = jax.random.split(jax.random.key(0), 2)
    assert not Luck(DISTURBANCES[name], TUM, keys, 3, 1).is_calm
    assert Luck(DISTURBANCES["none"], TUM, keys, 3, 1).is_calm


@pytest.mark.parametrize(("uav", "own"), [(TUM, 0), (ARDRONE, 10)], ids=["tum", "ardrone2"])
def test_frames_and_commands_come_as_late_as_is_said(uav, own):
    late = luck(uav, observation_delay=0.03, action_delay=0.02)
    seen, heard = [], []
    for tick in range(30):
        (drawn,) = late.draw(1)
        seen.append(late.frame(truth(tick), drawn).dogs[0, 0, 0])
        heard.append(late.hear(commands(tick), drawn).twist.speed[0, 0])
    # Until the first has come, it stands for those before.
    np.testing.assert_array_equal(seen, np.maximum(np.arange(30) - 3, 0))
    np.testing.assert_array_equal(heard, np.maximum(np.arange(30) - 2 - own, 0))


def test_noise_and_dropouts_are_as_large_and_as_many_as_is_said():
    shaken = luck(missions=20, mocap_noise=0.002, yaw_noise=0.01, dropout=0.1)
    frames = [shaken.frame(truth(0.0, 20), drawn) for drawn in shaken.draw(200)]
    for part, size in (("dogs", 0.002), ("sheep", 0.002), ("yaw", 0.01)):
        assert np.std([getattr(frame, part) for frame in frames]) == pytest.approx(size, rel=0.05)
    for part in ("dogs_seen", "sheep_seen"):
        assert np.mean([getattr(frame, part) for frame in frames]) == pytest.approx(0.9, abs=0.02)


def test_who_does_not_hear_a_command_obeys_the_last_that_it_heard():
    deaf = luck(missions=20, command_loss=0.3)
    before, lost = None, []
    for number, drawn in enumerate(deaf.draw(100)):
        heard = deaf.hear(commands(number, 20), drawn).twist.speed
        if before is not None:
            assert np.all((heard == number) | (heard == before))
            lost.append(heard != number)
        before = heard
    assert np.mean(lost) == pytest.approx(0.3, abs=0.03)


def test_gusts_have_their_size_and_last_as_long_as_is_said():
    windy = luck(missions=50, gust=0.3)
    blown = np.array([windy.wind(drawn) for drawn in windy.draw(1000)])
    assert blown.std() == pytest.approx(0.3, rel=0.05)
    lag = round(GUST_LASTS / DT)
    alike = np.mean(blown[lag:] * blown[:-lag]) / blown.var()
    assert alike == pytest.approx(np.exp(-1.0), abs=0.1)


def test_a_drones_own_errors_are_bounded_and_its_drift_changes_every_5_seconds():
    shaken = luck(missions=20, own_errors=1.0)
    found = []
    for drawn in shaken.draw(2 * round(DRIFT_LASTS / DT)):
        found.append(shaken.shake(commands(0.0, 20).velocity, drawn))
        shaken.grip()
    found = np.array(found)
    link = TUM.link
    assert 0.9 * (link.noise + link.drift) < np.abs(found).max() <= link.noise + link.drift
    half = len(found) // 2
    first, second = found[: half - 1].mean(axis=0), found[half:].mean(axis=0)
    assert np.abs(first).max() <= link.drift + 0.005
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] < 0.5
    # Half of its errors is half as much.
    mild = luck(missions=20, own_errors=0.5)
    drawn = mild.draw(len(found))[0]
    np.testing.assert_allclose(mild.shake(commands(0.0, 20).velocity, drawn), 0.5 * found[0])


def test_a_slipping_wheel_brings_less_of_its_speed_and_never_more():
    slips = luck(missions=200, slip=0.1).grip()
    assert slips.shape == (2, 200, 3)
    assert np.all((slips >= 0.5) & (slips <= 1.0))
    assert np.std(slips) == pytest.approx(0.06, abs=0.01)  # of a half-normal of SD 0.1


def test_the_trim_of_a_drone_has_its_size_in_any_direction():
    trims = luck(ARDRONE, missions=100, own_errors=1.0).trim
    np.testing.assert_allclose(np.linalg.norm(trims, axis=-1), ARDRONE.link.trim)
    assert np.all(np.abs(trims.mean(axis=(0, 1))) < 0.3 * ARDRONE.link.trim)
    no_trim = replace(ARDRONE, link=replace(ARDRONE.link, trim=0.0))
    np.testing.assert_array_equal(luck(no_trim, own_errors=1.0).trim, 0.0)

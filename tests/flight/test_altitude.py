"""Take-off, hold and landing of a drone that is nothing but its climb loop and the air's drag."""

import numpy as np
import pytest

from skydog.flight import altitude, profiles

UAVS = profiles.ship("uav")
DT = 0.01


def climbs(uav, start, height, seconds):
    """The altitude and the climb rate over time of a drone that is to be at `height` metres."""
    loop, drag = uav.velocity, uav.body.drag / uav.body.mass
    z, rate, found = np.array([start]), np.zeros(1), []
    for _ in range(round(seconds / DT)):
        wanted = altitude.climb(uav, z, height)
        rate = rate + DT * (loop.climb_gain + drag) * (wanted - rate)
        z = z + DT * rate
        found.append((z[0], rate[0]))
    return np.array(found).T


@pytest.mark.parametrize("name", UAVS)
@pytest.mark.parametrize(
    ("start", "height"),
    [(0.05, altitude.HEIGHT), (2.4, altitude.HEIGHT), (altitude.HEIGHT, 0.05)],
    ids=["take-off", "descent", "landing"],
)
def test_a_drone_comes_to_its_height_no_faster_than_it_may_and_holds_it(name, start, height):
    uav = profiles.uav(name)
    z, rate = climbs(uav, start, height, 8.0)
    assert np.all(np.abs(rate) <= uav.velocity.largest_climb + 1e-9)
    assert z[-1] == pytest.approx(height, abs=0.01)
    # It overshoots by a hand's breadth; ardrone2, whose climb follows in 0.7 s, by two.
    beyond = (z - height) * np.sign(height - start)
    assert beyond.max() < (0.18 if name == "ardrone2" else 0.06)
    assert np.abs(rate[-1]) < 0.02


def test_a_drone_at_its_height_is_commanded_neither_up_nor_down():
    uav = profiles.uav("crazyflie")
    assert altitude.climb(uav, np.array([2.0, 1.0, 3.0]), 2.0).tolist() == [0.0, 1.0, -1.0]

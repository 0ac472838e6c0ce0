import time

import numpy as np
import pytest

pytest.importorskip("mcap", reason="the lab's packages are not installed: skydog[lab]")
pytest.importorskip("rosbags", reason="the lab's packages are not installed: skydog[lab]")

from flightlogs import DOGS, PATIENCE, SHEEP, TURN, flown, written

from skydog.lab.playback import Playback


@pytest.fixture
def logged(tmp_path):
    return written(tmp_path / "flight-one")


def test_playback_shows_what_was_seen_at_the_pace_of_the_flight(logged):
    began = time.monotonic()
    seen = Playback(logged)
    numbers, times = [], []
    while len(numbers) < 4 and time.monotonic() < began + PATIENCE:
        if seen.wait(time.monotonic() + 0.05):
            bodies = seen.bodies()
            assert set(bodies) == {*DOGS, *SHEEP}
            numbers.append(bodies["ugv2"].number)
            times.append(bodies["ugv2"].came)
            assert bodies["ugv2"].attitude == TURN
            np.testing.assert_allclose(bodies["ugv2"].position, (1, 2, 0.01 * numbers[-1]))
            assert times[-1] <= time.monotonic()
    seen.close()
    seen.close()
    assert numbers == sorted(set(numbers))
    np.testing.assert_allclose(np.diff(times), 0.1 * np.diff(numbers), atol=1e-6)


def test_playback_as_fast_as_asked_shows_every_frame_once_and_then_nothing(logged):
    seen = Playback(logged, fast=True)
    heights = []
    while seen.wait(time.monotonic()):
        heights.append(seen.bodies()["uav1"].position[2])
    np.testing.assert_allclose(heights, 0.01 * np.arange(len(flown().time)))
    assert seen.bodies()["uav1"].number == len(flown().time) - 1
    assert not seen.wait(time.monotonic())

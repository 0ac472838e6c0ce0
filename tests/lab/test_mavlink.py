"""Flights by MAVLink, with pymavlink at both ends."""

import math
import random
import socket
import threading
import time
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pymavlink", reason="pymavlink is not installed")

from vehicles import PATIENCE, Flight, heartbeat, packed, told, until, vector

from skydog.flight.supervisor import Mode
from skydog.lab import mavlink as adapter
from skydog.lab.emulation import mavlink as emulated
from skydog.lab.mavlink import ned

NORTH = math.pi / 2
AUTOPILOTS = ("px4", "ardupilot")
number = st.floats(-100.0, 100.0)
vectors = st.tuples(number, number, number)
angles = st.floats(-math.pi, math.pi)


@pytest.fixture
def flights(monkeypatch):
    """Flights on a clock that outruns the heartbeats, which keep the machine's time."""
    monkeypatch.setattr(emulated, "STATION_LOSS", 1000.0)
    made = []

    def make(autopilot):
        made.append(Flight(autopilot))
        return made[-1]

    yield make
    for flight in made:
        flight.close()


@given(vectors, angles)
def test_the_change_of_frame_is_a_proper_rotation_and_its_own_inverse(arrow, yaw):
    matrix = np.array([ned(vector(axis), 0.0)[0] for axis in np.eye(3)]).T
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3))
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    np.testing.assert_allclose(ned(arrow, yaw)[0], matrix @ arrow)
    back, again = ned(*ned(arrow, yaw))
    assert back == arrow
    assert math.remainder(again - yaw, math.tau) == pytest.approx(0.0, abs=1e-12)


@given(angles)
def test_a_nose_points_the_same_way_in_both_frames(yaw):
    nose, heading = ned((math.cos(yaw), math.sin(yaw), 0.0), yaw)
    np.testing.assert_allclose(nose, (math.cos(heading), math.sin(heading), 0.0), atol=1e-12)


@pytest.mark.parametrize(
    ("world", "yaw", "north_east_down", "heading"),
    [
        ((1.0, 0.0, 0.0), 0.0, (0.0, 1.0, 0.0), NORTH),  # right is east
        ((0.0, 1.0, 0.0), NORTH, (1.0, 0.0, 0.0), 0.0),  # up on the map is north
        ((0.0, 0.0, 1.0), math.pi, (0.0, 0.0, -1.0), -NORTH),  # above is minus down; west
        ((-1.0, 0.0, 0.0), -NORTH, (0.0, -1.0, 0.0), math.pi),  # south
    ],
)
def test_right_is_east_and_up_on_the_map_is_north(world, yaw, north_east_down, heading):
    turned, angle = ned(world, yaw)
    assert turned == north_east_down
    assert math.remainder(angle - heading, math.tau) == pytest.approx(0.0)


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_it_takes_off_flies_where_it_is_told_and_lands(flights, autopilot):
    flight = flights(autopilot)
    assert flight.drone.status().connected
    assert flight.drone.status().flying is False
    flight.take_off()
    assert flight.drone.status().battery == pytest.approx(0.8)
    for way in np.vstack([np.eye(3), -np.eye(3)]).tolist():
        want = tuple(0.3 * part for part in way)
        flight.fly(
            Mode.MISSION, lambda want=want: flight.flown.velocity == pytest.approx(want), want
        )
    flight.fly(Mode.LANDING, lambda: not flight.vehicle.armed)
    assert flight.position[2] < 0.05
    until(lambda: flight.drone.status().flying is False)
    assert not flight.drone.others()


def test_offboard_engages_only_after_a_second_of_setpoints(flights):
    flight = flights("px4")
    took = flight.fly(Mode.TAKING_OFF, lambda: flight.vehicle.mode == "guided")
    assert took > emulated.PROOF
    assert flight.drone.complaint == "MAV_CMD_DO_SET_MODE: MAV_RESULT_TEMPORARILY_REJECTED"


@pytest.mark.parametrize("unseen", [{"hover": True}, {"off": 5.0}])
def test_it_does_not_arm_without_poses_that_agree_with_its_own(flights, unseen):
    flight = flights("px4")
    flight.fly(Mode.READY, flight.lasts(1.2), **unseen)
    flight.fly(Mode.TAKING_OFF, lambda: "ARM_DISARM" in flight.drone.complaint, **unseen)
    assert flight.vehicle.mode == "guided"
    assert not flight.vehicle.armed


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_it_lands_by_itself_when_the_base_station_falls_silent(flights, monkeypatch, autopilot):
    flight = flights(autopilot)
    flight.take_off()
    monkeypatch.setattr(emulated, "STATION_LOSS", 5.0)
    flight.drone.close()
    end = time.monotonic() + PATIENCE
    while flight.vehicle.armed:
        assert time.monotonic() < end
        flight.tick()
    assert flight.position[2] < 0.05


def test_ardupilot_stands_still_when_setpoints_stop_but_the_station_lives(flights):
    flight = flights("ardupilot")
    flight.take_off()
    want = (0.3, 0.0, 0.0)
    flight.fly(Mode.MISSION, lambda: flight.flown.velocity == pytest.approx(want), want)
    end = time.monotonic() + PATIENCE
    while flight.flown.velocity != (0.0, 0.0, 0.0):
        assert time.monotonic() < end
        flight.tick(0.1)
    assert flight.vehicle.mode == "guided"


def test_a_hovering_drone_is_sent_no_velocity_and_lands_once_it_is_blind_for_long(flights):
    flight = flights("px4")
    flight.take_off()
    flight.fly(Mode.HOLD, flight.lasts(1.0), (0.5, 0.0, 0.0), hover=True)
    assert flight.flown is not None
    assert flight.flown.velocity == (0.0, 0.0, 0.0)
    flight.fly(Mode.HOLD, lambda: not flight.vehicle.armed, hover=True)


def test_an_emergency_stops_the_motors_in_flight(flights):
    flight = flights("px4")
    flight.take_off()
    flight.fly(Mode.EMERGENCY, lambda: not flight.vehicle.armed)
    flight.tick()
    assert flight.flown is None
    assert flight.position[2] > 0.1


def test_a_vehicle_that_falls_silent_is_disconnected(flights, monkeypatch):
    flight = flights("px4")
    flight.vehicle.close()
    assert flight.drone.status().connected
    monkeypatch.setattr(adapter, "SILENCE", 0.3)
    until(lambda: not flight.drone.status().connected)
    flight.drone.send(told(Mode.MISSION), flight.now)


def test_rubbish_kills_neither_end(flights):
    flight = flights("px4")
    stranger = random.Random(1)
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
        address = flight.vehicle._socket.getsockname()
        until(lambda: flight.vehicle._peer)
        for length in (0, 1, 3, 12, 300, 1400):
            for first in (b"", b"\xfd", b"\xfe", packed(heartbeat())[:9]):
                rubbish = first + stranger.randbytes(length)
                sender.sendto(rubbish, address)
                flight.vehicle._socket.sendto(rubbish, flight.vehicle._peer)
    flight.take_off()


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_close_leaves_no_thread(autopilot):
    before = set(threading.enumerate())
    flight = Flight(autopilot)
    assert set(threading.enumerate()) > before
    flight.close()
    flight.close()
    assert set(threading.enumerate()) <= before
    flight.drone.send(told(Mode.MISSION), 5.0)

"""Crazyswarm2: the drone's adapter and an emulated server, over real DDS on loopback."""

import math
import os
import time
from collections.abc import Callable
from typing import Any
from uuid import uuid4

import pytest

pytest.importorskip("rosbags", reason="skydog[lab] is not installed")
pytest.importorskip("cyclonedds", reason="skydog[lab] is not installed")

from skydog.flight.supervisor import Mode
from skydog.lab import messages
from skydog.lab.adapters import DroneCommand, Status
from skydog.lab.crazyswarm2 import Crazyswarm2Drone, EmptyRequest, emergency
from skydog.lab.domain import Domain
from skydog.lab.emulation.dds import DDSCrazyswarm2
from skydog.lab.emulation.drivers import Shown
from skydog.lab.site import DDS, UAVSite

WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
SITE = DDS(domain=(os.getppid() * 7 + WORKER) % 90)
DT = 0.01  # s
POSITION = (1.0, -2.0, 0.03)
COMMAND = DroneCommand(
    mode=Mode.READY,
    hover=False,
    velocity=(0.3, -0.2, 0.1),
    tilt=(0.0, 0.0),
    setpoint=(1.0, -2.0, 1.5),
    position=POSITION,
    yaw=0.4,
)


def until(happened: Callable[[], Any], seconds: float = 30.0) -> Any:
    """What happened, once it did."""
    end = time.monotonic() + seconds
    while not (seen := happened()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)
    return seen


class Flight:
    """An adapter and an emulated server, in a world where a drone flies as it is commanded."""

    def __init__(self, station: Domain, robots: Domain, name: str):
        site = UAVSite(name, adapter="crazyswarm2")
        self.drone, self.driver = Crazyswarm2Drone(station, site), DDSCrazyswarm2(robots, site)
        self.position, self.now = POSITION, 0.0
        self.flown: Any = None
        until(lambda: self.drone.status().connected)

    def fly(self, mode: Mode, seconds: float, **other) -> None:
        for _ in range(round(seconds / DT)):
            self.now += DT
            told = COMMAND._replace(mode=mode, position=self.position)._replace(**other)
            self.drone.send(told, self.now)
            self.step()

    def step(self) -> None:
        shown = Shown(self.position, (0.0, 0.0, 0.0), (0.0, 0.0, 0.4), battery=0.5)
        self.flown = self.driver.step(shown, self.now)
        velocity = self.flown.velocity if self.flown else (0.0, 0.0, -1.0)
        x, y, z = (at + DT * speed for at, speed in zip(self.position, velocity, strict=True))
        self.position = (x, y, max(z, POSITION[2]))


@pytest.fixture
def station():
    domain = Domain(SITE)
    yield domain
    domain.close()


@pytest.fixture
def robots():
    domain = Domain(SITE)
    yield domain
    domain.close()


@pytest.fixture
def name():
    return f"cf{uuid4().hex[:8]}"


@pytest.fixture
def flight(station, robots, name):
    return Flight(station, robots, name)


def test_it_climbs_to_its_set_point_flies_lands_and_rests(flight):
    flight.fly(Mode.READY, 0.5)
    assert not flight.flown
    flight.fly(Mode.TAKING_OFF, 8.0)
    assert flight.position == pytest.approx((1.0, -2.0, 1.5), abs=0.05)
    assert flight.drone.status().flying
    flight.fly(Mode.MISSION, 1.0)
    assert flight.flown.velocity == pytest.approx(COMMAND.velocity)
    flight.fly(Mode.HOLD, 0.1, hover=True)
    assert flight.flown.velocity == (0.0, 0.0, 0.0)
    flight.fly(Mode.LANDING, 10.0)
    assert flight.flown is None
    assert flight.position[2] == POSITION[2]
    assert not flight.drone.status().flying
    assert not flight.drone.status().emergency


def test_it_lands_unseen(flight):
    flight.fly(Mode.TAKING_OFF, 6.0)
    lost = flight.position
    flight.fly(Mode.LANDING, 9.0, hover=True, position=lost)
    assert flight.flown is None
    assert flight.position[2] == POSITION[2]


def test_motors_never_stop_above_the_floor(flight):
    flight.fly(Mode.TAKING_OFF, 6.0)
    height = flight.position[2]
    while True:
        flight.fly(Mode.LANDING, 0.1)
        if flight.flown is None:
            break
        height = flight.position[2]
    assert height <= POSITION[2] + 0.05


def test_the_ramp_waits_for_a_drone_that_does_not_climb(flight, robots, name):
    heard = robots.subscribe(
        f"/{name}/cmd_full_state", "crazyflie_interfaces/msg/FullState", reliable=True
    )
    until(lambda: len(flight.drone._place._writer.get_matched_subscriptions()) == 2)
    for second in range(10):
        flight.drone.send(COMMAND._replace(mode=Mode.TAKING_OFF), float(second))
        (place,) = until(heard.take)
        assert place.pose.position.z <= POSITION[2] + 0.4 + 1e-9
        turned = place.pose.orientation
        assert 2 * math.atan2(turned.z, turned.w) == pytest.approx(0.4)


def test_emergency_stops_the_motors_for_ever(flight):
    flight.fly(Mode.TAKING_OFF, 4.0)
    flight.fly(Mode.EMERGENCY, 0.1)
    assert flight.flown is None
    flight.fly(Mode.TAKING_OFF, 1.0)
    assert flight.flown is None
    assert until(flight.drone.status).emergency


def test_without_the_service_thrust_zero_alone_stops_the_motors(flight):
    flight.driver._emergency.close()
    flight.fly(Mode.TAKING_OFF, 4.0)
    flight.fly(Mode.EMERGENCY, 0.1)
    assert flight.flown is None
    assert not flight.driver.locked


def test_an_emergency_request_has_rmw_cyclonedds_header(station, robots, name):
    server = robots.read(emergency(f"/{name}"), EmptyRequest, reliable=True)
    drone = Crazyswarm2Drone(station, UAVSite(name, adapter="crazyswarm2"))
    until(lambda: drone._emergency.heard())
    for tenth in range(11):
        drone.send(COMMAND._replace(mode=Mode.EMERGENCY), tenth / 10)
    requests = until(server.take)
    assert [one.seq for one in requests] == [1, 2, 3]
    assert len({one.guid for one in requests}) == 1
    raw = EmptyRequest(guid=2, seq=1).serialize()
    assert raw[4:] == b"\2" + 7 * b"\0" + b"\1" + 7 * b"\0" + b"\0"
    assert emergency("/cf1/") == "rq/cf1/emergencyRequest"


def test_a_server_without_set_points_levels_out_then_stops(flight):
    flight.fly(Mode.TAKING_OFF, 4.0)
    flight.fly(Mode.MISSION, 0.1)
    for _ in range(60):
        flight.now += DT
        flight.step()
    assert flight.flown.velocity == (0.0, 0.0, 0.0)
    for _ in range(160):
        flight.now += DT
        flight.step()
    assert flight.flown is None


def test_a_position_is_obeyed_too(flight, station, name):
    position = station.publish(f"/{name}/cmd_position", "crazyflie_interfaces/msg/Position")
    until(position.heard)
    position.send(x=1.0, y=-2.0, z=1.03)
    flight.step()
    assert flight.flown.velocity == pytest.approx((0.0, 0.0, 1.0), abs=0.01)


@pytest.mark.parametrize(
    ("bits", "volts", "said"),
    [
        (1 | 2 | 8, 4.2, Status(battery=1.0, flying=False, emergency=False)),
        (2 | 8 | 16, 3.6, Status(battery=0.5, flying=True, emergency=False)),
        (32, 2.5, Status(battery=0.0, flying=False, emergency=True)),
        (64 | 16, 9.0, Status(battery=1.0, flying=True, emergency=True)),
    ],
)
def test_status_reads_the_supervisors_bits(station, robots, name, bits, volts, said):
    drone = Crazyswarm2Drone(station, UAVSite(name, adapter="crazyswarm2"))
    assert drone.status() == Status(connected=False)
    server = robots.publish(f"/{name}/status", "crazyflie_interfaces/msg/Status")
    robots.subscribe(f"/{name}/cmd_velocity_world", "crazyflie_interfaces/msg/VelocityWorld")
    until(lambda: server.heard() and drone.status().connected)
    server.send(supervisor_info=bits, battery_voltage=volts)
    status = until(lambda: drone.status().battery is not None and drone.status())
    assert status._replace(battery=round(status.battery, 3)) == said


def test_bits_are_those_of_the_message():
    from skydog.lab import crazyswarm2

    constants = {
        name: value
        for name, _, value in messages.store2().fielddefs["crazyflie_interfaces/msg/Status"][0]
    }
    for name in ("FLYING", "TUMBLED", "LOCKED"):
        assert constants[f"SUPERVISOR_INFO_IS_{name}"] == getattr(crazyswarm2, name)


def test_another_that_sends_set_points_is_named(flight, robots, name):
    assert flight.drone.others() == ()
    robots.publish(f"/{name}/cmd_full_state", "crazyflie_interfaces/msg/FullState")
    assert until(flight.drone.others)
    flight.drone.close()
    flight.driver.close()

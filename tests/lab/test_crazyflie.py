import math
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab.adapters import DroneCommand, Status
from skydog.lab.emulation.crazyflie import CrazyflieDriver
from skydog.lab.emulation.drivers import Flown, Shown

pytest.importorskip("cflib", reason="a Crazyflie needs cflib")

from skydog.lab.crazyflie import FLYING, LOCKED, CrazyflieDrone, flown, said

STANDING = Shown((1.0, 2.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.75)


def told(mode: Mode, velocity=(0.0, 0.0, 0.0), hover=False, height=1.0, yaw=0.0) -> DroneCommand:
    at = (1.0, 2.0, height)
    return DroneCommand(mode, hover, velocity, (0.0, 0.0), at, at, yaw)


def until(happened: Callable[[], object]) -> None:
    end = time.monotonic() + 20.0
    while not happened():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.005)


class Flight:
    """A drone at its emulated driver, whose clock is the test's own."""

    def __init__(self) -> None:
        self.driver = CrazyflieDriver()
        self.drone = CrazyflieDrone("dog", self.driver.uri)
        self.now = 100.0
        self.shown = STANDING
        self.flown: Flown | None = None

    def step(self, command: DroneCommand | None, seconds: float = 0.01) -> Flown | None:
        """A command or silence, and what is flown `seconds` later."""
        self.now += seconds
        if command is not None:
            self.drone.send(command, self.now)
            time.sleep(0.005)
        self.flown = self.driver.step(self.shown, self.now)
        return self.flown

    def takes_off(self) -> None:
        climb = told(Mode.TAKING_OFF, (0.0, 0.0, 0.5), height=0.0)
        until(lambda: self.step(climb) is not None)
        until(lambda: self.step(climb) and self.drone.status().flying)

    def is_flown(self, command: DroneCommand, velocity: tuple[float, float, float]) -> None:
        until(lambda: self.step(command) == Flown(velocity))

    def close(self) -> None:
        self.drone.close()
        self.driver.close()


@pytest.fixture
def flight() -> Iterator[Flight]:
    flight = Flight()
    yield flight
    flight.close()


@pytest.fixture
def driver() -> Iterator[CrazyflieDriver]:
    driver = CrazyflieDriver()
    yield driver
    driver.close()


@pytest.fixture
def link(driver: CrazyflieDriver) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", int(driver.uri.rsplit(":", 1)[1])))
        link.settimeout(20.0)
        yield link


def asked(link: socket.socket, port: int, channel: int, data: bytes) -> bytes:
    """The data of the answer to a packet."""
    link.send(bytes([port << 4 | channel]) + data)
    while True:
        answer = link.recv(64)
        if answer[0] & 0xF3 == port << 4 | channel:
            return answer[1:]


def streamed(link: socket.socket, data: bytes) -> None:
    """Send a set-point, and wait until it has been heard."""
    link.send(b"\x70" + data)
    asked(link, 15, 0, b"echo")


def armed(link: socket.socket) -> None:
    assert asked(link, 9, 1, b"\x01\x01") == b"\x81\x01\x01"


def test_a_drone_takes_off_flies_lands_and_takes_off_again(flight):
    flight.takes_off()
    flight.is_flown(told(Mode.MISSION, (0.25, -0.5, 0.125)), (0.25, -0.5, 0.125))
    flight.is_flown(told(Mode.LANDING, (0.0, 0.0, -0.25)), (0.0, 0.0, -0.25))
    down = told(Mode.LANDING, (0.0, 0.0, -0.25), height=0.05)
    until(lambda: flight.step(down) is None)
    until(lambda: flight.step(down, 0.1) is None and flight.drone.status().flying is False)
    assert not flight.drone.status().emergency
    flight.takes_off()


def test_a_command_before_take_off_leaves_the_motors_off(flight):
    for mode in (Mode.DISARMED, Mode.READY):
        for _ in range(5):
            assert flight.step(told(mode, (0.5, 0.0, 0.5))) is None


def test_a_drone_that_waits_an_hour_on_the_ground_still_takes_off(flight):
    for _ in range(10):
        flight.step(told(Mode.READY), 360.0)
    flight.takes_off()


def test_its_estimator_is_started_where_motion_capture_sees_it(flight):
    until(lambda: flight.driver.parameters["stabilizer.estimator"] == 2)
    flight.step(told(Mode.READY, height=0.0, yaw=0.5))
    until(lambda: flight.driver.parameters["kalman.initialYaw"] == 0.5)
    assert flight.driver.parameters["kalman.initialY"] == 2.0
    until(lambda: flight.driver.external == (1.0, 2.0, 0.0))


def test_a_drone_that_nobody_sees_is_told_no_position_and_stands_still(flight):
    flight.takes_off()
    flight.driver.external = None
    flight.is_flown(told(Mode.HOLD, (0.25, 0.5, 0.25), hover=True), (0.0, 0.0, 0.0))
    assert flight.driver.external is None


def test_a_landing_that_nobody_sees_sinks_on_the_spot():
    assert flown(told(Mode.LANDING, (0.25, 0.5, -0.25), hover=True)) == (0.0, 0.0, -0.25)


def test_motors_of_an_unseen_landing_stop_once_it_must_be_down(flight):
    flight.takes_off()
    flight.step(told(Mode.MISSION, height=0.125))
    sink = told(Mode.LANDING, (0.0, 0.0, -0.25), hover=True)
    flight.is_flown(sink, (0.0, 0.0, -0.25))
    until(lambda: flight.step(sink, 0.05) is None)
    assert not flight.drone.status().emergency


def test_battery_and_links_state_come_back(flight):
    flight.step(None)
    until(lambda: flight.drone.status() == Status(0.75, False, False, True))
    assert flight.drone.others() == ()


def test_an_emergency_cuts_the_motors_until_it_is_restarted(flight):
    flight.takes_off()
    until(lambda: flight.step(told(Mode.EMERGENCY)) is None)
    until(lambda: flight.step(None) is None and flight.drone.status().emergency)
    for _ in range(5):
        assert flight.step(told(Mode.TAKING_OFF, (0.0, 0.0, 0.5))) is None


def test_a_client_that_falls_silent_is_levelled_and_then_stopped(flight):
    flight.takes_off()
    moving = (0.5, 0.0, 0.125)
    flight.is_flown(told(Mode.MISSION, moving), moving)
    until(lambda: flight.step(None, 0.1) == Flown((0.0, 0.0, 0.125), (0.0, 0.0)))
    until(lambda: flight.step(None, 0.1) is None)
    until(lambda: flight.drone.status().emergency)


def test_a_client_that_is_heard_again_in_time_flies_on(flight):
    flight.takes_off()
    flight.step(None, 1.0)
    flight.is_flown(told(Mode.MISSION, (0.25, 0.0, 0.0)), (0.25, 0.0, 0.0))


def test_letting_go_in_flight_does_not_drop_the_drone(flight):
    flight.takes_off()
    flight.drone.close()
    levelled = Flown((0.0, 0.0, 0.5), (0.0, 0.0))
    until(lambda: flight.step(None, 0.1) in (levelled, None))
    assert flight.flown == levelled


def test_a_link_that_breaks_is_noticed_and_send_never_raises(flight):
    flight.driver.close()
    until(lambda: flight.step(told(Mode.READY)) or not flight.drone.status().connected)
    flight.step(told(Mode.MISSION))


def test_close_leaves_no_thread_and_may_be_called_twice():
    before = set(threading.enumerate())
    flight = Flight()
    flight.close()
    flight.close()
    until(lambda: set(threading.enumerate()) <= before)


def test_an_address_where_nobody_is_is_refused_in_one_line():
    before = set(threading.enumerate())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        uri = f"udp://127.0.0.1:{taken.getsockname()[1]}"
    for wrong in (uri, "crazyflie-7"):
        with pytest.raises(Refusal, match=f"dog: no Crazyflie answers at '{wrong}'") as refused:
            CrazyflieDrone("dog", wrong)
        assert "\n" not in str(refused.value)
    until(lambda: set(threading.enumerate()) <= before)


def test_a_missing_cflib_is_refused_with_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "cflib", None)
    with pytest.raises(Refusal, match=r"pip install 'skydog\[crazyflie\]'"):
        CrazyflieDrone("dog", "udp://127.0.0.1:19850")


@pytest.mark.parametrize(
    ("data", "status"),
    [
        ({"pm.vbat": 3.0 + 0.5 * 1.2}, Status(0.5, False)),
        ({"pm.vbat": 4.3}, Status(1.0, False)),
        ({"pm.vbat": 3.6, "pm.batteryLevel": 40}, Status(0.4, False)),
        ({"supervisor.info": FLYING}, Status(None, True)),
        ({"supervisor.info": LOCKED}, Status(None, False, True)),
        ({"sys.isFlying": 1, "sys.isTumbled": 1}, Status(None, True, True)),
    ],
)
def test_old_and_new_firmware_say_the_same(data, status):
    assert said(data) == status


def test_motors_stay_locked_until_it_is_armed(driver, link):
    climb = struct.pack("<Bffff", 8, 0.0, 0.0, 0.5, 0.0)
    streamed(link, climb)
    assert driver.step(STANDING, 0.0) is None
    armed(link)
    assert driver.step(STANDING, 0.01) == Flown((0.0, 0.0, 0.5))


def test_set_points_level_out_after_half_a_second_and_stop_after_two(driver, link):
    armed(link)
    streamed(link, struct.pack("<Bffff", 8, 0.5, 0.0, 0.125, 0.0))
    level = Flown((0.0, 0.0, 0.125), (0.0, 0.0))
    flights = [driver.step(STANDING, now) for now in (0.0, 0.5, 0.75, 2.0, 2.25)]
    assert flights == [Flown((0.5, 0.0, 0.125))] * 2 + [level] * 2 + [None]
    assert asked(link, 9, 1, b"\x01\x01") == b"\x81\x00\x00"


def test_set_points_that_cease_right_after_a_landing_lock_it(driver, link):
    armed(link)
    streamed(link, struct.pack("<Bffff", 8, 0.0, 0.0, 0.5, 0.0))
    assert driver.step(STANDING, 0.0) is not None
    streamed(link, b"\x00")
    for now in (0.1, 1.0, 2.2):
        assert driver.step(STANDING, now) is None
    assert asked(link, 9, 1, b"\x01\x01") == b"\x81\x00\x00"


def test_set_points_are_read_in_their_own_frames_and_units(driver, link):
    armed(link)
    left = STANDING._replace(attitude=(0.0, 0.0, math.pi / 2))
    cases = {
        struct.pack("<Bffff", 10, 0.5, 0.25, 0.0, 0.125): (-0.25, 0.5, 0.25),
        struct.pack("<Bffff", 7, 1.25, 0.0, 0.0, 90.0): (0.5, -1.0, 0.0),
        struct.pack("<B9hI3h", 6, 1000, 2000, 100, 300, 0, 0, *[0] * 7): (0.3, 0.0, 0.2),
    }
    for data, velocity in cases.items():
        streamed(link, data)
        step = driver.step(left, 0.0)
        assert step is not None
        assert step.velocity == pytest.approx(velocity)
    streamed(link, b"\x00")
    assert driver.step(left, 0.0) is None


def test_the_high_level_commander_takes_off_goes_and_lands(driver, link):
    def flies(command: bytes, seconds: float) -> None:
        nonlocal shown, now
        assert asked(link, 8, 0, command)[3] == 0
        for _ in range(round(seconds / 0.01)):
            now += 0.01
            step = driver.step(shown, now)
            velocity = step.velocity if step else (0.0, 0.0, 0.0)
            x, y, z = (a + 0.01 * v for a, v in zip(shown.position, velocity, strict=True))
            shown = shown._replace(position=(x, y, z), velocity=velocity)

    shown, now = STANDING, 0.0
    armed(link)
    driver.step(shown, now)
    flies(struct.pack("<BBff?f", 7, 0, 1.0, 0.0, True, 2.0), 3.0)
    assert shown.position == pytest.approx((1.0, 2.0, 1.0), abs=0.01)
    flies(struct.pack("<BBBBfffff", 12, 0, 1, 0, 1.0, -1.0, 0.0, 0.0, 2.0), 3.0)
    assert shown.position == pytest.approx((2.0, 1.0, 1.0), abs=0.01)
    flies(struct.pack("<BBff?f", 8, 0, 0.0, 0.0, True, 2.0), 3.0)
    assert shown.position == pytest.approx((2.0, 1.0, 0.0), abs=0.02)
    assert driver.step(shown, now) is None


def test_a_drone_on_its_back_stops_and_says_so(driver, link):
    armed(link)
    streamed(link, struct.pack("<Bffff", 8, 0.0, 0.0, 0.5, 0.0))
    fallen = STANDING._replace(attitude=(3.0, 0.0, 0.0))
    assert driver.step(STANDING, 0.0) is not None
    assert driver.step(fallen, 0.4) is not None
    streamed(link, struct.pack("<Bffff", 8, 0.0, 0.0, 0.5, 0.0))
    assert driver.step(fallen, 1.1) is None
    (info,) = struct.unpack("<xH", asked(link, 9, 0, b"\x0c"))
    assert info == 1 << 5 | 1 << 6


def test_garbage_is_dropped_and_the_drone_lives_on(driver, link):
    armed(link)
    streamed(link, struct.pack("<Bffff", 8, 0.25, 0.0, 0.0, 0.0))
    nan = struct.pack("<Bffff", 8, math.nan, 0.0, 0.0, 0.0)
    for port in range(16):
        if port == 9:  # arming and emergency stop are commands of two bytes
            continue
        for channel in range(4):
            for data in (b"", b"\xff", b"\xff" * 30, b"\x08\x01\x02", bytes(range(64)) * 20, nan):
                link.send(bytes([port << 4 | channel]) + data)
            link.send(b"")
            asked(link, 15, 0, b"still there")
    assert driver.step(STANDING, 0.0) == Flown((0.25, 0.0, 0.0))


def test_the_log_refuses_what_does_not_fit(driver, link):
    variable = struct.pack("<BH", 7, 0)
    assert asked(link, 5, 1, b"\x06\x01" + 9 * variable)[2] != 0
    assert asked(link, 5, 1, b"\x06\x01" + struct.pack("<BH", 7, 999))[2] != 0
    for name in range(16):
        assert asked(link, 5, 1, bytes([6, name]) + variable)[2] == 0
    assert asked(link, 5, 1, b"\x06\x11" + variable)[2] != 0
    assert asked(link, 5, 1, b"\x05") == b"\x05\x00\x00"

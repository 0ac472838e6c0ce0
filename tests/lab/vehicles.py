"""Vehicles for the tests of MAVLink: an emulated one, and one that the test plays."""

import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager

import numpy as np

from skydog.flight.supervisor import Mode
from skydog.lab.adapters import DroneCommand
from skydog.lab.emulation.drivers import Shown
from skydog.lab.emulation.mavlink import MavlinkDriver
from skydog.lab.mavlink import MavlinkDrone, mavlink, parsed

PATIENCE = 30.0  # s
HEIGHT = 0.5  # m


def told(mode, velocity=(0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0), hover=False, yaw=0.0):
    setpoint = (position[0], position[1], HEIGHT)
    return DroneCommand(mode, hover, velocity, (0.0, 0.0), setpoint, position, yaw)


def vector(array):
    x, y, z = map(float, array)
    return x, y, z


def until(holds):
    """Wait for something that another thread does."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.005)


class Flight:
    """An adapter, an emulated vehicle and a point that flies as it is told, on a clock of ours."""

    def __init__(self, autopilot):
        self.vehicle = MavlinkDriver(autopilot)
        self.drone = MavlinkDrone("dog", self.vehicle.uri)
        self.now = time.monotonic()
        self.position, self.velocity = np.zeros(3), np.zeros(3)
        self.flown = None

    def tick(self, seconds=0.01):
        self.now += seconds
        shown = Shown(vector(self.position), vector(self.velocity), (0.0, 0.0, 0.0), 0.8)
        self.flown = self.vehicle.step(shown, self.now)
        wanted = (0.0, 0.0, -3.0) if self.flown is None else self.flown.velocity
        before = self.position
        self.position = before + 0.01 * np.array(wanted)
        self.position[2] = max(self.position[2], 0.0)
        self.velocity = (self.position - before) / 0.01
        time.sleep(0.001)

    def fly(self, mode, holds, velocity=(0.0, 0.0, 0.0), hover=False, off=0.0):
        """Tell it until something holds; how long that took on our clock, in seconds."""
        start, end = self.now, time.monotonic() + PATIENCE
        while not holds():
            assert time.monotonic() < end, f"{mode!r} {self.vehicle.mode} {self.drone.complaint}"
            x, y, z = self.position.tolist()
            self.drone.send(told(mode, velocity, (x + off, y, z), hover), self.now)
            self.tick()
        return self.now - start

    def lasts(self, seconds):
        end = self.now + seconds
        return lambda: self.now >= end

    def take_off(self):
        self.fly(Mode.READY, self.lasts(1.2))
        climb = (0.0, 0.0, 0.5)
        self.fly(Mode.TAKING_OFF, lambda: self.position[2] > 0.9 * HEIGHT, climb)
        self.fly(Mode.MISSION, lambda: self.drone.status().flying)

    def close(self):
        self.drone.close()
        self.vehicle.close()


class Vehicle:
    """The far end of a UDP link, played by the test."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(PATIENCE)
        self.uri = f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"
        self.peer = ("", 0)

    def hear(self):
        data, self.peer = self.socket.recvfrom(65535)
        return parsed(mavlink.MAVLink(None), data, False)[0]

    def hear_until(self, marker):
        """All that came before a HEARTBEAT whose custom mode is the marker."""
        heard = []
        while getattr(message := self.hear(), "custom_mode", None) != marker:
            heard.append(message)
        return heard

    def say(self, message, source=(1, 1)):
        self.socket.sendto(packed(message, source), self.peer)


def packed(message, source=(1, 1)):
    return bytes(message.pack(mavlink.MAVLink(None, *source)))


def heartbeat(autopilot=12, kind=2, armed=False, mode=0, state=4):
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 128 * armed, mode, state, 3)


@contextmanager
def played(autopilot=12):
    """A drone and the vehicle that the test plays."""
    vehicle = Vehicle()
    with closing(vehicle.socket), ThreadPoolExecutor(1) as pool:
        made = pool.submit(MavlinkDrone, "dog", vehicle.uri)
        vehicle.hear()
        vehicle.say(heartbeat(autopilot))
        with closing(made.result(PATIENCE)) as drone:
            yield drone, vehicle


def heard(drone, vehicle, mode, seconds, now, **what):
    """What a vehicle hears while its drone is told at 100 Hz."""
    for i in range(round(100 * seconds)):
        drone.send(told(mode, **what), now + i / 100)
    drone._tell(mavlink.MAVLink_heartbeat_message(6, 8, 0, 4242, 4, 3))
    return vehicle.hear_until(4242)


def commands(messages):
    return [m for m in messages if m.get_type() == "COMMAND_LONG" and m.command != 511]

"""A base station whose robots obey at once, in time that passes as fast as it is computed."""

from contextlib import contextmanager
from math import cos, sin

import numpy as np

from skydog.flight.station import DT
from skydog.flight.supervisor import Mode
from skydog.lab import flying
from skydog.lab.adapters import Body, Status
from skydog.lab.emulation.chain import a_site
from skydog.lab.flying import BaseStation
from skydog.lab.orders import Orders
from skydog.lab.policy import Policy
from skydog.lab.running import Automatic
from skydog.lab.setup import setup
from skydog.lab.site import Mission
from skydog.lab.stop_topic import StopTopic
from skydog.lab.wires import Wires

PAD = 1.7  # m: it stands on something high, so that a flight is short
STARTS = ((3.3, 4.5), (3.6, 4.0), (4.5, 2.1))


def a_small_site(**mission):
    """A site with a drone and three rovers, and a rule dog."""
    return a_site(Mission(**{"sheepdog": "strombom", "steps": 10, **mission}), 6.0, "dds")


class Clock:
    """Stands in for the module `time`."""

    def __init__(self):
        self.now = 1000.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += max(seconds, 0.0)


class Room:
    """Bodies that do what they were told, and a tracker: a `Source`."""

    def __init__(self, site, clock):
        self.clock, self.number = clock, 0
        self.hidden: set[str] = set()
        self.stuck: set[int] = set()  # rovers whose wheels stand
        self.names = [robot.name for robot in (*site.uav, *site.ugv)]
        self.drone, self.rovers = Drone(), [Rover() for _ in site.ugv]
        self.uav = np.array([1.0, 5.0, PAD])
        self.ugv = np.array([(*at, 0.0) for at in STARTS])  # x, y, yaw
        self._random = np.random.default_rng(0)
        self._due = clock.now + DT
        self._bodies: dict[str, Body] = {}
        self.closed = False

    def wait(self, until):
        come = self._due <= until
        self.clock.now = max(self.clock.now, min(until, self._due))
        if come:
            self._due += DT
            self.number += 1
            self._move()
            self._show()
        return come

    def bodies(self):
        return self._bodies

    def close(self):
        self.closed = True

    def _move(self):
        if self.drone.told is not None and self.drone.told.mode >= Mode.TAKING_OFF:
            self.uav = self.uav + DT * np.array(self.drone.told.velocity)
            self.uav[2] = max(self.uav[2], PAD)
        self.drone.said = self.drone.said._replace(flying=bool(self.uav[2] > PAD + 0.01))
        for number, (at, rover) in enumerate(zip(self.ugv, self.rovers, strict=True)):
            speed, turn_rate = (0.0, 0.0) if number in self.stuck else rover.told
            at += DT * np.array([speed * cos(at[2]), speed * sin(at[2]), turn_rate])

    def _show(self):
        noise = self._random.normal(0.0, 1e-5, (len(self.names), 3))
        places = [(*self.uav, 0.0), *((x, y, 0.03, yaw) for x, y, yaw in self.ugv)]
        for name, (x, y, z, yaw), (dx, dy, dz) in zip(self.names, places, noise, strict=True):
            if name not in self.hidden:
                position = (float(x + dx), float(y + dy), float(z + dz))
                attitude = (0.0, 0.0, sin(yaw / 2), cos(yaw / 2))
                self._bodies[name] = Body(position, attitude, self.clock.now, self.number)


class Drone:
    """Keeps what it is told."""

    def __init__(self):
        self.told, self.said, self.also = None, Status(1.0, False), ()
        self.modes: list[Mode] = []

    def send(self, command, now):
        self.told = command
        if self.modes[-1:] != [command.mode]:
            self.modes.append(command.mode)

    def status(self):
        return self.said

    def others(self):
        return self.also

    def close(self):
        pass


class Rover:
    """Keeps what it is told."""

    def __init__(self):
        self.told, self.also = (0.0, 0.0), ()

    def send(self, speed, turn_rate, now):
        self.told = speed, turn_rate

    def others(self):
        return self.also

    def close(self):
        pass


@contextmanager
def station(monkeypatch, tmp_path, site, shepherd=None, log=None, patience=30.0, show=None):
    """A base station, its room and orders. Time stands while it waits for a decision."""
    clock = Clock()
    monkeypatch.setattr(flying, "time", clock)
    monkeypatch.setattr(flying, "PATIENCE", patience)
    made = setup(site)
    made = made._replace(shepherd=shepherd or made.shepherd)
    room, orders = Room(site, clock), Orders()
    stop = StopTopic(None, None, orders)
    wires = Wires(room, (room.drone,), tuple(room.rovers), stop, lambda _: None, lambda _: (), ())
    policy = Policy(made.world, made.shepherd, len(site.ugv), len(site.uav))
    try:
        yield (
            BaseStation(site, made, wires, policy, orders, log, show, None, tmp_path),
            room,
            orders,
        )
    finally:
        policy.close()


class When:
    """An `Automatic` operator, who also does something once when something is so."""

    def __init__(self, orders, happens, act, seconds=100.0):
        self._fly, self._happens, self._act = Automatic(orders, patience=5.0), happens, act
        self._done, self._seconds = False, seconds

    def __call__(self, base):
        if not self._done and self._happens(base):
            self._done = True
            self._act()
        over = self._fly(base)
        assert base.memory.now - base.began < self._seconds, "the flight does not end"
        return over


def mode(base):
    return Mode(int(base.memory.supervisor.mode[0]))

"""The room of an emulated laboratory: the twin's bodies in real time, behind real wires.

It runs in a process of its own, as robots do, and goes on when the base station dies.
"""

import contextlib
import signal
import time
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from skydog.flight import autopilot, profiles, rovers
from skydog.flight.rovers import Twist
from skydog.flight.station import DT, Commands
from skydog.lab.adapters import Quaternion, Vector
from skydog.lab.emulation.drivers import DroneDriver, Flown, RoverDriver, Shown
from skydog.lab.site import Site
from skydog.twin import bodies, plant
from skydog.twin.disturbances import DISTURBANCES
from skydog.twin.noise import Luck
from skydog.twin.plant import Plant, Truth

ANSWERS = 0.5 * DT  # s after a frame until which commands that answer it count in the same tick
REPORT = 0.1  # s
HARD = 2.5  # m/s at which a drone that comes to the floor has crashed: a fall from 0.3 m
DRIVEN = 0.05  # m/s: a rover that is faster moves
SINKS = -0.25  # m/s of climb that the driver of a landing drone asks for, or less


@dataclass(frozen=True)
class Start:
    """What the room begins with: where everyone stands in metres, and what goes wrong."""

    dogs: tuple[tuple[float, float], ...]
    sheep: tuple[tuple[float, float], ...]
    size: float  # m, of the arena
    goal: tuple[float, float, float]  # x, y and radius in metres
    disturb: str = "none"
    key: tuple[int, ...] = (0, 0)  # that draws the disturbances of this mission, as the twin's
    latches: frozenset[str] = frozenset()  # rovers that obey their last command for ever
    guarded: frozenset[str] = frozenset()  # robots that a guard stands before


class Report(NamedTuple):
    """What the room says of its bodies, ten times a second. Metres, world frame."""

    t: float  # s, monotonic
    dogs: tuple[Vector, ...]
    sheep: tuple[tuple[float, float], ...]
    speeds: tuple[float, ...]  # m/s, of the rovers
    off: tuple[bool, ...]  # drones whose motors stand
    sinks: tuple[float, ...]  # s, monotonic: since when each drone's driver lands it; inf: not
    beyond: float  # m: the furthest that a drone was outside the hard fence so far; below 0 inside
    rover_beyond: float
    crashed: bool
    late: float  # share of ticks that began late


@dataclass
class Wrong:
    """What is wrong with the robots. May be changed while they move."""

    stuck: set[str] = field(default_factory=set)  # rovers whose wheels stand
    battery: float | None = None  # share that the drones say they have


class Room:
    """Bodies, drivers and a tracker, a hundredth of a second at a time."""

    def __init__(self, site: Site, start: Start):
        self.site, self.start = site, start
        self.uav = profiles.uav(site.uav[0].profile)
        self.rover = profiles.rover(site.ugv[0].profile)
        disturb = DISTURBANCES[start.disturb]
        sheep, dogs = len(start.sheep), len(start.dogs)
        built = bodies.build(
            self.uav, self.rover, start.size, start.goal, sheep, dogs, disturb.friction
        )
        self.plant = Plant(self.uav, built, 1, 1)
        keys = jax.random.wrap_key_data(jnp.array([start.key], jnp.uint32))
        self.luck = Luck(disturb, self.uav, keys, sheep, dogs)
        pad, wheel = bodies.rest(self.uav, self.rover)
        self.plant.place(
            np.array([[(*at, pad) for at in start.dogs]]),
            np.array([[(*at, wheel) for at in start.sheep]]),
            self.luck.yaw,
        )
        self.wheel = wheel
        self.wrong = Wrong()
        self.drivers: list[DroneDriver] = []
        self.rover_drivers: list[RoverDriver] = []
        self.closes: list[Any] = []
        self.beyond = self.rover_beyond = -np.inf
        self.crashed = False
        self._flown = [0.0] * dogs  # s
        self.sinks = (np.inf,) * dogs
        self._drawn: list[Any] = []

    def look(self) -> dict[str, tuple[Vector, Quaternion]]:
        """What a tracker sees in this tick, by name: noisy and late, and not always everybody."""
        if not self._drawn:
            self._drawn = self.luck.draw(100)
        frame = self.luck.frame(self.plant.truth(), self._drawn[0])
        shown: dict[str, tuple[Vector, Quaternion]] = {}
        attitude = self.plant.truth().quaternion[0]
        for number, robot in enumerate(self.site.uav):
            if frame.dogs_seen[0, number]:
                w, x, y, z = attitude[number].tolist()
                shown[robot.name] = tuple(frame.dogs[0, number].tolist()), (x, y, z, w)
        for number, robot in enumerate(self.site.ugv):
            if frame.sheep_seen[0, number]:
                half = 0.5 * float(frame.yaw[0, number])
                x, y = frame.sheep[0, number].tolist()
                shown[robot.name] = (x, y, self.wheel), (0.0, 0.0, np.sin(half), np.cos(half))
        return shown

    def move(self, now: float) -> None:
        """Let the bodies do for a tick what their drivers make of what they were told."""
        drawn = self._drawn.pop(0)
        truth, speed = self.plant.truth(), self.plant.speed()
        flown = [
            driver.step(self._shown(number, truth, speed), now)
            for number, driver in enumerate(self.drivers)
        ]
        told = np.array([driver.step(now) for driver in self.rover_drivers]).reshape(-1, 2)
        off = np.array([[one is None for one in flown]])
        heard = self.luck.hear(self._commands(flown, told, truth, speed), drawn)
        velocity, tilt = heard.velocity, None
        if self.uav.velocity.on_board:
            velocity = self.luck.shake(velocity, drawn)
        else:
            tilt = self.luck.shake(heard.tilt, drawn)
        gust = self.luck.wind(drawn)
        if gust is not None:
            self.plant.push(np.where(off[..., None], 0.0, gust))
        left, right = rovers.wheels(self.rover, heard.twist)
        turning = np.array([[robot.name not in self.wrong.stuck for robot in self.site.ugv]])
        grip = self.luck.grip() * turning
        self.plant.drive(left * grip[0], right * grip[1])
        self.plant.step(velocity, tilt, self.luck.trim, round(DT / plant.DT), None, off)
        self._flown = [
            flown_for + (not stands) * DT
            for flown_for, stands in zip(self._flown, off[0], strict=True)
        ]
        self._judge(off)
        self.off = tuple(map(bool, off[0]))
        self.sinks = tuple(
            min(since, now) if one is not None and one.velocity[2] <= SINKS else np.inf
            for since, one in zip(self.sinks, flown, strict=True)
        )

    def report(self, now: float, late: float) -> Report:
        """What is true now."""
        truth = self.plant.truth()
        velocity = self.plant.rover_speed()[0]
        return Report(
            now,
            tuple(tuple(at) for at in truth.dogs[0].tolist()),
            tuple(tuple(at) for at in truth.sheep[0].tolist()),
            tuple(velocity.tolist()),
            self.off,
            self.sinks,
            float(self.beyond),
            float(self.rover_beyond),
            self.crashed,
            late,
        )

    def close(self) -> None:
        """Let go of every wire."""
        for part in (*self.drivers, *self.rover_drivers, *reversed(self.closes)):
            part.close()

    def _shown(self, number: int, truth: Truth, speed: np.ndarray) -> Shown:
        lasts = 60.0 * self.site.uav[number].battery_minutes
        battery = self.wrong.battery
        if battery is None:
            battery = max(0.0, 1.0 - self._flown[number] / lasts)
        x, y, z = truth.dogs[0, number].tolist()
        vx, vy, vz = speed[0, number].tolist()
        roll, pitch, yaw = truth.attitude[0, number].tolist()
        return Shown((x, y, z), (vx, vy, vz), (roll, pitch, yaw), battery)

    def _commands(
        self, flown: list[Flown | None], told: np.ndarray, truth: Truth, speed: np.ndarray
    ) -> Commands:
        """What the drivers ask of the bodies. One without motors asks for nothing."""
        velocity = np.array([[(0.0, 0.0, 0.0) if one is None else one.velocity for one in flown]])
        tilt = np.zeros((*velocity.shape[:2], 2))
        if not self.uav.velocity.on_board:
            # A drone that hovers by its own sensors has the velocity loop on board all the same.
            tilt = autopilot.tilt(
                self.uav,
                velocity[..., :2],
                np.zeros_like(velocity[..., :2]),
                speed[..., :2],
                np.zeros_like(velocity[..., :2]),
                truth.attitude[..., 2],
            )
            for number, one in enumerate(flown):
                if one is not None and one.tilt is not None:
                    tilt[0, number] = one.tilt
        return Commands(velocity, tilt, Twist(told[None, :, 0], told[None, :, 1]))

    def _judge(self, off: np.ndarray) -> None:
        """Note how far outside anybody is, and whether a drone has come down hard."""
        truth, cage = self.plant.truth(), self.site.cage
        spans = np.array([cage.x, cage.y, cage.z])
        out = np.maximum(spans[:, 0] - truth.dogs[0], truth.dogs[0] - spans[:, 1])
        above = truth.dogs[0, :, 2] - cage.z[1]  # the floor is near wherever a drone lands
        self.beyond = max(self.beyond, float(out[:, :2].max()), float(above.max()))
        rover = np.maximum(spans[:2, 0] - truth.sheep[0], truth.sheep[0] - spans[:2, 1])
        self.rover_beyond = max(self.rover_beyond, float(rover.max()))
        low = truth.dogs[0, :, 2] < 0.15
        hard = self.plant.speed()[0, :, 2] < -HARD
        tipped = np.cos(truth.attitude[0, :, :2]).prod(axis=-1) < plant.FALLEN
        self.crashed = self.crashed or bool(((low & hard) | tipped).any())


def run(site: Site, start: Start, wire: Connection) -> None:
    """The room's process: it ends when the other end of the wire says so, or is gone.

    What comes over the wire: `(what, name, value)` to change an attribute of the tracker's
    "faults" or of what is "wrong"; None to end. What goes: first the addresses of drones that are
    packets' ends, by name; then `Report`s.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # it ends with its wire
        signal.signal(number, signal.SIG_IGN)
    from skydog.lab.emulation.wires import connect

    room = Room(site, start)
    show = connect(room)
    wire.send(
        {uav.name: getattr(end, "uri", "") for uav, end in zip(site.uav, room.drivers, strict=True)}
    )
    ticks = late = 0
    due = time.monotonic()
    told = due
    try:
        while True:
            while wire.poll():
                change = wire.recv()
                if change is None:
                    return
                what, name, value = change
                setattr(
                    getattr(show, "faults", None) if what == "faults" else room.wrong, name, value
                )
            due += DT
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            late += now - due > 0.5 * DT
            ticks += 1
            if now - due > 10 * DT:  # the machine was away: time that is lost stays lost
                due = now
            show.show(room.look())
            time.sleep(ANSWERS)
            room.move(time.monotonic())
            if now - told >= REPORT:
                told = now
                wire.send(room.report(now, late / ticks))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    finally:
        with contextlib.suppress(Exception):
            room.close()

"""The base station's loops: from what motion capture sees to what drones and rovers are commanded.

A hundred times a second `see` and `act`; at every decision `take` the set-points that it moves.
Pure functions of a memory, which `skydog.flight.base` calls, supervised.
"""

from math import inf
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from skydog.flight import altitude, autopilot, estimate, rovers, setpoints, sni
from skydog.flight.bounds import clipped
from skydog.flight.estimate import Estimate
from skydog.flight.limits import Corner
from skydog.flight.options import Steering
from skydog.flight.profiles import UAV, Rover
from skydog.flight.rovers import Pose, Twist, YawMemory
from skydog.flight.setpoints import Setpoint, Slide

DT = 0.01  # s: motion capture's 100 Hz (paper, Section "Environment and Control Network Setups")
LEASH = 0.6  # m: a drone's set-point is never further ahead when it is decided; ours
LEVEL = 0.6  # m by which each further drone flies above the one before; ours


class Station(NamedTuple):
    """What the base station knows of its robots."""

    uav: UAV
    rover: Rover
    steering: Steering
    tolerance: float | None  # m: the next set-point waits until the drone is so near; None: each dt
    period: float  # s between decisions
    speed: Float[np.ndarray, "..."]  # m/s of a rover under a force of 1
    acceleration: float = inf  # m/s² at which what a drone is commanded may change


class Memory(NamedTuple):
    """What the base station remembers."""

    dogs: Estimate  # of three axes
    sheep: Estimate  # of two
    yaw: Estimate  # of one
    dog_setpoint: Setpoint
    sheep_setpoint: Setpoint
    lag: Float[np.ndarray, "*batch dogs 2"]  # of the SNI controller
    trim: Float[np.ndarray, "*batch dogs 2"]  # m/s
    command: Float[np.ndarray, "*batch dogs 3"]  # m/s, the latest
    steered: YawMemory
    twist: Twist


class Frame(NamedTuple):
    """A frame of motion capture, and which bodies are in it."""

    dogs: Float[np.ndarray, "*batch dogs 3"]  # m
    sheep: Float[np.ndarray, "*batch sheep 2"]
    yaw: Float[np.ndarray, "*batch sheep"]  # rad, of the rovers
    dogs_seen: Bool[np.ndarray, "*batch dogs"]
    sheep_seen: Bool[np.ndarray, "*batch sheep"]


class Commands(NamedTuple):
    """What the base station sends."""

    velocity: Float[np.ndarray, "*batch dogs 3"]  # m/s, world frame
    tilt: Float[np.ndarray, "*batch dogs 2"]  # rad, roll and pitch; unless the drone takes velocity
    twist: Twist  # of the rovers


def start(station: Station, frame: Frame) -> Memory:
    """The memory when all stand where the first frame has them, and are to stand there."""
    sheep = estimate.start(frame.sheep)
    at = rovers.steered(station.rover, Pose(frame.sheep, frame.yaw))
    still = np.zeros_like(frame.yaw)
    level = np.zeros_like(frame.dogs[..., :2])
    return Memory(
        dogs=estimate.start(frame.dogs),
        sheep=sheep,
        yaw=estimate.start(frame.yaw[..., None]),
        dog_setpoint=setpoints.stand(frame.dogs[..., :2]),
        sheep_setpoint=setpoints.stand(at),
        lag=level,
        trim=level,
        command=np.zeros_like(frame.dogs),
        steered=YawMemory(still, still),
        twist=Twist(still, still),
    )


def see(memory: Memory, frame: Frame, dt: float = DT) -> Memory:
    """The memory after a frame of motion capture, `dt` seconds after the one before."""
    turned = memory.yaw.position + rovers.wrapped(frame.yaw[..., None] - memory.yaw.position)
    return memory._replace(
        dogs=estimate.update(memory.dogs, frame.dogs, frame.dogs_seen, dt),
        sheep=estimate.update(memory.sheep, frame.sheep, frame.sheep_seen, dt),
        yaw=estimate.update(memory.yaw, turned, frame.sheep_seen, dt),
    )


def anew(
    memory: Memory,
    frame: Frame,
    dogs: Bool[np.ndarray, "*batch dogs"],
    sheep: Bool[np.ndarray, "*batch sheep"],
) -> Memory:
    """The memory in which some drones and rovers stand where the frame has them."""

    def begun(before: Estimate, seen: np.ndarray, which: np.ndarray) -> Estimate:
        there = estimate.start(seen)
        return Estimate(
            *(np.where(which[..., None], *pair) for pair in zip(there, before, strict=True))
        )

    return memory._replace(
        dogs=begun(memory.dogs, frame.dogs, dogs),
        sheep=begun(memory.sheep, frame.sheep, sheep),
        yaw=begun(memory.yaw, frame.yaw[..., None], sheep),
    )


def stand(station: Station, memory: Memory) -> Memory:
    """The memory in which every set-point stands where its body is."""
    return memory._replace(
        dog_setpoint=setpoints.stand(memory.dogs.position[..., :2]),
        sheep_setpoint=setpoints.stand(rovers.steered(station.rover, pose(memory))),
    )


def pose(memory: Memory) -> Pose:
    """Where the rovers are, as far as is known."""
    return Pose(memory.sheep.position, memory.yaw.position[..., 0])


def flock(station: Station, memory: Memory) -> Float[np.ndarray, "*batch sheep 2"]:
    """Where the flock is, in metres, for whoever decides."""
    if station.steering == "reference":
        return setpoints.at(memory.sheep_setpoint, station.period)
    return memory.sheep.position


def waiting(station: Station, memory: Memory) -> Bool[np.ndarray, "*batch dogs"]:
    """Which drones are still on their way to a waypoint that the next one waits for."""
    here = memory.dogs.position[..., :2]
    if station.tolerance is None:
        return np.zeros(here.shape[:-1], bool)
    return ~setpoints.reached(memory.dog_setpoint, here, station.period, station.tolerance)


def take(
    station: Station,
    memory: Memory,
    dog_velocity: Float[np.ndarray, "*batch dogs 2"],
    sheep_velocity: Float[np.ndarray, "*batch sheep 2"],
    airspace: tuple[Corner, Corner],
    arena: tuple[Corner, Corner],
    slide: Slide | None = None,
) -> Memory:
    """The memory with the set-points that a decision moves, velocities in m/s.

    `airspace` and `arena` are the least and the greatest coordinates in metres at which a drone
    and a rover may be. Set-points of rovers `slide` along what stands in the arena.
    """
    dt, here = station.period, memory.dogs.position[..., :2]
    held = waiting(station, memory)[..., None]
    dogs = setpoints.integrate(
        memory.dog_setpoint, np.where(held, 0.0, dog_velocity), here, dt, LEASH
    )
    at = rovers.steered(station.rover, pose(memory))
    sheep = setpoints.integrate(
        memory.sheep_setpoint, sheep_velocity, at, dt, station.rover.tracking.leash
    )
    sheep = _within(sheep, arena, dt)
    if slide is not None:
        sheep = _slid(sheep, slide, memory.sheep.position, dt)
    return memory._replace(dog_setpoint=_within(dogs, airspace, dt), sheep_setpoint=sheep)


def act(
    station: Station,
    memory: Memory,
    elapsed: float | Float[np.ndarray, "*batch 1 1"],
    height: Float[np.ndarray, "*batch dogs"],
    dt: float = DT,
) -> tuple[Memory, Commands]:
    """What is commanded so many seconds after a decision, drones to be at `height` metres.

    `dt` is the time in seconds since what was commanded before.
    """
    here, loop = memory.dogs, station.uav.position
    error = setpoints.at(memory.dog_setpoint, elapsed) - here.position[..., :2]
    lag, level = sni.step(loop, memory.lag, error, dt)
    trim = sni.trim(loop, memory.trim, error, dt)
    level = loop.feedforward * memory.dog_setpoint.velocity + level + trim
    size = np.hypot(level[..., :1], level[..., 1:])
    most = station.uav.velocity.largest
    level = level * np.minimum(1.0, most / np.maximum(size, most))
    climb = altitude.climb(station.uav, here.position[..., 2], height)
    if station.acceleration < inf:
        change = level - memory.command[..., :2]
        size = np.hypot(change[..., :1], change[..., 1:])
        level = memory.command[..., :2] + change * np.minimum(
            1.0, station.acceleration * dt / np.maximum(size, 1e-9)
        )
    command = np.concatenate([level, climb[..., None]], axis=-1)
    tilt = np.zeros_like(level)
    if not station.uav.velocity.on_board:
        tilt = autopilot.tilt(
            station.uav,
            level,
            (level - memory.command[..., :2]) / dt,
            here.velocity[..., :2],
            np.zeros_like(level),
            np.zeros_like(climb),
        )
    steered, twist = _steer(station, memory, elapsed, dt)
    twist = rovers.within_limits(station.rover, memory.twist, twist, dt)
    memory = memory._replace(lag=lag, trim=trim, command=command, steered=steered, twist=twist)
    return memory, Commands(command, tilt, twist)


def _steer(
    station: Station, memory: Memory, elapsed: float | Float[np.ndarray, "*batch 1 1"], dt: float
) -> tuple[YawMemory, Twist]:
    at = pose(memory)
    if station.steering == "turn":
        velocity = memory.sheep_setpoint.velocity
        return rovers.turn_then_drive(station.rover, memory.steered, at, velocity, dt)
    goal = setpoints.at(memory.sheep_setpoint, elapsed)
    return memory.steered, rovers.track(station.rover, at, goal, station.speed)


def _within(setpoint: Setpoint, bounds: tuple[Corner, Corner], dt: float) -> Setpoint:
    """The set-point, turned aside so that it ends within bounds."""
    origin = clipped(setpoint.origin, *bounds)
    end = clipped(origin + dt * setpoint.velocity, *bounds)
    return Setpoint(origin, (end - origin) / dt)


def _slid(
    setpoint: Setpoint, slide: Slide, position: Float[np.ndarray, "*batch sheep 2"], dt: float
) -> Setpoint:
    """The set-point, turned aside by obstacles, also by those between it and its body.

    A body cannot follow a set-point that is behind one: such a set-point starts from the body.
    """
    origin = slide(position, setpoint.origin)
    end = slide(origin, origin + dt * setpoint.velocity)
    return Setpoint(origin, (end - origin) / dt)

"""From the direction of a force to the wheels of a rover, in two ways.

A rover has no sideways. `track` follows an integrated set-point, and is what missions use;
`turn_then_drive` is the paper's reading: [vel_x, vel_y, yaw], with the yaw held by fuzzy-SNI.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from skydog.flight import fuzzy, sni
from skydog.flight.bounds import clipped
from skydog.flight.profiles import Rover


class Pose(NamedTuple):
    """Where rovers are: metres, and yaw in radians from the x axis, counterclockwise."""

    position: Float[np.ndarray, "*batch sheep 2"]
    yaw: Float[np.ndarray, "*batch sheep"]


class Twist(NamedTuple):
    """What rovers are commanded: forward speed in m/s and turn rate in rad/s."""

    speed: Float[np.ndarray, "*batch sheep"]
    turn_rate: Float[np.ndarray, "*batch sheep"]


def steered(rover: Rover, pose: Pose) -> Float[np.ndarray, "*batch sheep 2"]:
    """The point of a rover that follows its set-point: a little ahead of the axle, in metres.

    Unlike the axle it can go sideways, by turning.
    """
    heading = np.stack([np.cos(pose.yaw), np.sin(pose.yaw)], axis=-1)
    return pose.position + rover.tracking.ahead * heading


def track(
    rover: Rover,
    pose: Pose,
    setpoint: Float[np.ndarray, "*batch sheep 2"],
    speed: float | Float[np.ndarray, "..."],
) -> Twist:
    """Follow a set-point, in metres, no faster than `speed` in m/s.

    The velocity of the point that is `steered` is linearised: v along the heading, and across it
    ω times its distance from the axle.
    """
    loop = rover.tracking
    wanted = loop.gain * (setpoint - steered(rover, pose))
    size = np.hypot(wanted[..., 0], wanted[..., 1])
    wanted = wanted * np.minimum(1.0, speed / np.maximum(size, 1e-9))[..., None]
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    along = cos * wanted[..., 0] + sin * wanted[..., 1]
    across = cos * wanted[..., 1] - sin * wanted[..., 0]
    most = rover.motion.largest_turn_rate
    return Twist(along, clipped(across / loop.ahead, -most, most))


class YawMemory(NamedTuple):
    """What the yaw loop remembers."""

    lag: Float[np.ndarray, "*batch sheep"]  # of the SNI controller
    error: Float[np.ndarray, "*batch sheep"]  # rad, a step ago


def turn_then_drive(
    rover: Rover,
    memory: YawMemory,
    pose: Pose,
    velocity: Float[np.ndarray, "*batch sheep 2"],
    dt: float,
) -> tuple[YawMemory, Twist]:
    """Turn to the direction of `velocity`, m/s, and drive at its length once turned.

    Also returns the loop's memory `dt` seconds later.
    """
    size = np.hypot(velocity[..., 0], velocity[..., 1])
    error = wrapped(np.arctan2(velocity[..., 1], velocity[..., 0]) - pose.yaw)
    error = np.where(size > 0.0, error, 0.0)
    scale = fuzzy.gain(error, wrapped(error - memory.error) / dt)
    lag, turn_rate = sni.step(rover.yaw, memory.lag, error, dt, scale)
    most = rover.motion.largest_turn_rate
    turned = np.abs(error) <= rover.yaw.moves_within
    twist = Twist(np.where(turned, size, 0.0), clipped(turn_rate, -most, most))
    return YawMemory(lag, error), twist


def within_limits(rover: Rover, before: Twist, wanted: Twist, dt: float) -> Twist:
    """The twist that a rover may be commanded `dt` seconds after the one before."""
    limits = rover.motion
    faster, turning = limits.acceleration * dt, limits.turn_acceleration * dt
    speed = clipped(wanted.speed, -limits.largest_speed, limits.largest_speed)
    rate = clipped(wanted.turn_rate, -limits.largest_turn_rate, limits.largest_turn_rate)
    return Twist(
        before.speed + clipped(speed - before.speed, -faster, faster),
        before.turn_rate + clipped(rate - before.turn_rate, -turning, turning),
    )


def wheels(
    rover: Rover, twist: Twist
) -> tuple[Float[np.ndarray, "*batch sheep"], Float[np.ndarray, "*batch sheep"]]:
    """How fast the left and the right wheel turn, in rad/s."""
    body = rover.body
    half = 0.5 * body.wheel_separation * twist.turn_rate
    return (twist.speed - half) / body.wheel_radius, (twist.speed + half) / body.wheel_radius


def wrapped(angle: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """The angle in radians, from -π to π."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi

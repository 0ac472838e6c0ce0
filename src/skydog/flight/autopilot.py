"""What runs on board a drone: velocity to tilt, tilt to torque, torque to four rotors.

World frame x right, y up as seen from above, z up; body frame x forward, y left, z up (REP-103).
Attitudes are roll, pitch and yaw in radians, R = Rz(yaw) Ry(pitch) Rx(roll).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from skydog.flight.bounds import clipped
from skydog.flight.profiles import UAV

GRAVITY = 9.81  # m/s²


class Motion(NamedTuple):
    """How a drone moves, as its own sensors have it."""

    velocity: Float[np.ndarray, "*batch dogs 3"]  # m/s, world frame
    acceleration: Float[np.ndarray, "*batch dogs 3"]  # m/s², world frame
    attitude: Float[np.ndarray, "*batch dogs 3"]  # rad: roll, pitch, yaw
    rates: Float[np.ndarray, "*batch dogs 3"]  # rad/s, body frame


class Memory(NamedTuple):
    """What the autopilot remembers from its step before."""

    velocity: Float[np.ndarray, "*batch dogs 3"]  # m/s, as commanded
    tilt: Float[np.ndarray, "*batch dogs 2"]  # rad: roll and pitch, as commanded


def tilt(
    uav: UAV,
    command: Float[np.ndarray, "*batch dogs 2"],
    change: Float[np.ndarray, "*batch dogs 2"],
    velocity: Float[np.ndarray, "*batch dogs 2"],
    acceleration: Float[np.ndarray, "*batch dogs 2"],
    yaw: Float[np.ndarray, "*batch dogs"],
) -> Float[np.ndarray, "*batch dogs 2"]:
    """Roll and pitch in radians for a commanded velocity in m/s, which changes by `change` m/s².

    The law of tum_simulator: acceleration = P × error + D × its rate, and tilt = that / g. What
    the air's drag takes at the commanded velocity is added.
    """
    loop, drag = uav.velocity, uav.body.drag / uav.body.mass
    wanted = loop.gain * (command - velocity) + loop.damping * (change - acceleration)
    wanted = wanted + drag * command
    cos, sin = np.cos(yaw), np.sin(yaw)
    forward = cos * wanted[..., 0] + sin * wanted[..., 1]
    left = cos * wanted[..., 1] - sin * wanted[..., 0]
    tilted = np.stack([-left, forward], axis=-1) / GRAVITY
    return clipped(tilted, -uav.attitude.largest, uav.attitude.largest)


def rotors(
    uav: UAV,
    memory: Memory,
    motion: Motion,
    velocity: Float[np.ndarray, "*batch dogs 3"],
    tilted: Float[np.ndarray, "*batch dogs 2"] | None,
    dt: float,
) -> tuple[Memory, Float[np.ndarray, "*batch dogs 4"]]:
    """The thrust in newtons of each rotor, and the memory `dt` seconds later.

    `velocity` is commanded in m/s; its part in the plane is flown by the velocity loop on board,
    unless the drone is commanded `tilted`, roll and pitch in radians. Yaw is held at 0.
    """
    change = (velocity - memory.velocity) / dt
    yaw = motion.attitude[..., 2]
    if tilted is None:
        wanted = tilt(
            uav,
            velocity[..., :2],
            change[..., :2],
            motion.velocity[..., :2],
            motion.acceleration[..., :2],
            yaw,
        )
    else:
        wanted = tilted
    loop = uav.attitude
    most = loop.largest_rate * dt
    step = clipped(wanted - memory.tilt, -most, most)
    leant, rate = memory.tilt + step, step / dt
    angular = np.empty_like(motion.attitude)
    angular[..., :2] = loop.gain * (leant - motion.attitude[..., :2]) + loop.damping * (
        loop.lead * rate - motion.rates[..., :2]
    )
    angular[..., 2] = loop.yaw_gain * (-yaw * loop.yaw_gain / 4.0 - motion.rates[..., 2])
    climb = uav.velocity
    # The acceleration that D takes away is what thrust makes in this very step: solved for it. The
    # one measured a step ago would make each step's thrust the opposite of the last one's.
    lift = climb.climb_gain * (velocity[..., 2] - motion.velocity[..., 2])
    lift = (lift + climb.climb_damping * change[..., 2]) / (1.0 + climb.climb_damping)
    lift = lift + uav.body.drag / uav.body.mass * velocity[..., 2]
    upright = np.cos(motion.attitude[..., 0]) * np.cos(motion.attitude[..., 1])
    thrust = uav.body.mass * (GRAVITY + lift) / np.maximum(upright, 0.5)
    torque = np.asarray(uav.body.inertia) * angular
    return Memory(velocity, leant), mix(uav, thrust, torque)


def mix(
    uav: UAV, thrust: Float[np.ndarray, "*batch dogs"], torque: Float[np.ndarray, "*batch dogs 3"]
) -> Float[np.ndarray, "*batch dogs 4"]:
    """The thrust in newtons of each rotor, for a total thrust in N and a torque in N m.

    Rotors are numbered as `ROTORS` has them. Where a rotor cannot do what is asked, torque goes
    before thrust: a drone that keeps upright can climb again.
    """
    body = uav.body
    most = body.rotor_thrust
    reach = body.arm / np.sqrt(2.0)
    turned = (0.25 * torque / (reach, reach, body.rotor_torque)) @ ROTORS.T
    turned = clipped(turned, -0.5 * most, 0.5 * most)
    least = -np.min(turned, axis=-1)
    share = clipped(0.25 * thrust, least, most - np.max(turned, axis=-1))
    return clipped(share[..., None] + turned, 0.0, most)


# Where each rotor stands and how its drag turns the body: the signs of the torque about x, y and z
# that its thrust makes. Front left, rear left, rear right, front right; neighbours turn opposite.
ROTORS = np.array([(1.0, -1.0, -1.0), (1.0, 1.0, 1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)])

"""What an instant of a flight leaves in its log."""

import numpy as np

from skydog.flight import base
from skydog.flight.base import Base, Sent
from skydog.lab.adapters import Body, Quaternion
from skydog.lab.eyes import Sighting
from skydog.lab.flightlog import Decision, FlightLog, Timing
from skydog.lab.policy import Answer


def decision(
    built: Base, memory: base.Memory, answer: Answer, sighting: Sighting, step: int, last: bool
) -> Decision:
    """An instant at which something was decided; the last commands nothing."""
    known, decided = memory.station, answer.decision
    end = known.dog_setpoint.origin + built.station.period * known.dog_setpoint.velocity
    dogs = known.dogs.position[0]
    attitude = np.zeros_like(dogs)
    attitude[:, 2] = sighting.dog_yaw
    return Decision(
        0,
        step,
        known.sheep.position[0],
        dogs[:, :2],
        decided.subgoal,
        decided.drives,
        np.zeros_like(decided.velocity) if last else decided.velocity,
        decided.force,
        answer.accomplished,
        dogs[:, 2],
        attitude,
        np.concatenate([end[0], built.height[0][:, None]], axis=1),
        known.yaw.position[0, :, 0],
        known.twist.speed[0],
        known.twist.turn_rate[0],
    )


def tick(
    log: FlightLog,
    names: list[str],
    memory: base.Memory,
    sent: Sent,
    sighting: Sighting,
    bodies: dict[str, Body],
    timing: Timing,
    now: float,
) -> None:
    """Where everyone is believed to be, what each was told, and what the tracker showed."""
    known, twist = memory.station, sent.commands.twist
    dogs = known.dogs.position.shape[1]
    for number, name in enumerate(names[:dogs]):
        x, y, z = known.dogs.position[0, number].tolist()
        log.pose(name, (x, y, z), _turned(float(sighting.dog_yaw[number])), now)
        vx, vy, vz = sent.commands.velocity[0, number].tolist()
        log.command(name, (vx, vy, vz), (0.0, 0.0, 0.0), now)
    for number, name in enumerate(names[dogs:]):
        x, y = known.sheep.position[0, number].tolist()
        log.pose(name, (x, y, 0.0), _turned(float(known.yaw.position[0, number, 0])), now)
        speed, turn = float(twist.speed[0, number]), float(twist.turn_rate[0, number])
        log.command(name, (speed, 0.0, 0.0), (0.0, 0.0, turn), now)
    for name, why in zip(names, sighting.why, strict=True):
        if why is None and name in bodies:
            log.seen(name, bodies[name].position, bodies[name].attitude, now)
    log.timing(timing, now)


def _turned(yaw: float) -> Quaternion:
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))

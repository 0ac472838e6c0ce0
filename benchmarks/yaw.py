"""The yaw loop of a rover in the twin: fuzzy-SNI beside SNI and a P controller, as a table.

    python benchmarks/yaw.py

A kobuki turns by 30, 90 and 170 degrees, and follows a heading that swings by 60 degrees in 4 s.
"""

import math
from collections.abc import Callable

import numpy as np

from skydog.flight import fuzzy, profiles, rovers, sni
from skydog.flight.rovers import Pose, Twist, YawMemory
from skydog.flight.station import DT
from skydog.study.report import markdown_table
from skydog.twin import bodies, plant
from skydog.twin.plant import Plant

SECONDS = 5.0
SETTLED = math.radians(2.0)
ROVER, UAV = profiles.rover("kobuki"), profiles.uav("tum-simulator")
STILL = np.zeros((1, 1))

Controller = Callable[[YawMemory, float], tuple[YawMemory, float]]
"""From memory and error in radians to memory and turn rate in rad/s."""


def by_fuzzy(memory: YawMemory, error: float) -> tuple[YawMemory, float]:
    now = np.full((1, 1), error)
    scale = fuzzy.gain(now, (now - memory.error) / DT)
    lag, rate = sni.step(ROVER.yaw, memory.lag, now, DT, scale)
    return YawMemory(lag, now), float(rate[0, 0])


def by_sni(memory: YawMemory, error: float) -> tuple[YawMemory, float]:
    now = np.full((1, 1), error)
    lag, rate = sni.step(ROVER.yaw, memory.lag, now, DT)
    return YawMemory(lag, now), float(rate[0, 0])


def by_p(memory: YawMemory, error: float) -> tuple[YawMemory, float]:
    """P with the gain that SNI starts with."""
    return memory, ROVER.yaw.delta * error


CONTROLLERS: dict[str, Controller] = {
    "fuzzy-SNI": by_fuzzy,
    "SNI, Γ as it is": by_sni,
    f"P, gain {ROVER.yaw.delta:g} 1/s": by_p,
}


def turn(controller: Controller, heading: Callable[[float], float]) -> np.ndarray:
    """The yaw in radians, tick by tick, of a rover that is to look along `heading(seconds)`."""
    built = bodies.build(UAV, ROVER, 4.0, (0.0, 0.0, 2.0), sheep=1, dogs=1)
    rig = Plant(UAV, built, missions=1, threads=1)
    pad, wheel = bodies.rest(UAV, ROVER)
    rig.place(np.array([[[1.0, 1.0, pad]]]), np.array([[[3.0, 3.0, wheel]]]), STILL)
    memory, twist = YawMemory(STILL, STILL), Twist(STILL, STILL)
    seen = []
    hover = np.zeros((1, 1, 3))
    for tick in range(round(SECONDS / DT)):
        pose = Pose(rig.truth().sheep, rig.truth().yaw)
        seen.append(float(pose.yaw[0, 0]))
        error = float(rovers.wrapped(np.asarray(heading(tick * DT) - seen[-1])))
        memory, rate = controller(memory, error)
        wanted = Twist(STILL, np.full((1, 1), rate))
        twist = rovers.within_limits(ROVER, twist, wanted, DT)
        rig.drive(*rovers.wheels(ROVER, twist))
        rig.step(hover, None, np.zeros((1, 1, 2)), round(DT / plant.DT), None)
    return np.unwrap(np.array(seen))


def step(controller: Controller, degrees: float) -> tuple[float, float]:
    """Overshoot in degrees, and the time in seconds after which the error stays small."""
    goal = math.radians(degrees)
    yaw = turn(controller, lambda _: goal)
    off = np.flatnonzero(np.abs(yaw - goal) > SETTLED)
    return math.degrees(max(0.0, float(yaw.max()) - goal)), (off[-1] + 1) * DT


def tracking(controller: Controller) -> float:
    """RMS error in degrees behind a heading that swings, after its first second."""

    def heading(seconds: float) -> float:
        return math.radians(60.0) * math.sin(2 * math.pi * seconds / 4.0)

    wanted = np.array([heading(tick * DT) for tick in range(round(SECONDS / DT))])
    error = (turn(controller, heading) - wanted)[round(1.0 / DT) :]
    return math.degrees(float(np.sqrt(np.mean(error**2))))


def table() -> str:
    angles = (30.0, 90.0, 170.0)
    head = ["yaw by"]
    head += [f"{what}, {angle:g}°" for angle in angles for what in ("overshoot", "settles in")]
    rows = []
    for name, controller in CONTROLLERS.items():
        cells = [name]
        for angle in angles:
            over, settles = step(controller, angle)
            cells += [f"{over:.1f}°", f"{settles:.2f} s"]
        rows.append([*cells, f"{tracking(controller):.1f}°"])
    return markdown_table([*head, "tracking error (RMS)"], rows)


if __name__ == "__main__":
    print(table())

# pyright: reportAttributeAccessIssue=false
"""Bodies on a test rig: in a bare model, or in a plant that the autopilot flies."""

import mujoco
import numpy as np

from skydog.flight import profiles, rovers
from skydog.flight.autopilot import GRAVITY
from skydog.flight.rovers import Twist
from skydog.twin import bodies
from skydog.twin.bodies import TIMESTEP, Bodies
from skydog.twin.plant import DT, Plant
from skydog.world.trace import Ending, Poses, Trace

ROVER = profiles.rover("kobuki")
TUM, ARDRONE, CRAZYFLIE = map(profiles.uav, ("tum-simulator", "ardrone2", "crazyflie"))
SIZE = 6.0
WHEEL = ROVER.body.wheel_radius


def model(uav=TUM, sheep=1, rover=ROVER, **options) -> tuple[Bodies, mujoco.MjData]:
    """A model and its state, the drone 2 m up and all at rest."""
    built = bodies.build(uav, rover, SIZE, (0.0, 0.0, 2.0), sheep, 1, **options)
    data = mujoco.MjData(built.model)
    data.qpos[built.dogs[0] : built.dogs[0] + 3] = (1.0, 1.0, 2.0)
    for number, at in enumerate(built.sheep):
        data.qpos[at : at + 3] = (3.0 + number, 3.0, rover.body.wheel_radius)
    return built, data


def run(built: Bodies, data: mujoco.MjData, seconds: float) -> None:
    mujoco.mj_step(built.model, data, nstep=round(seconds / built.model.opt.timestep))


class Rig:
    """One mission's plant, whose drone hovers; `fly` and `drive` return what was flown."""

    def __init__(self, uav=TUM, sheep=((3.0, 3.0, 0.0),), height=2.0, timestep=TIMESTEP, **options):
        self.uav = uav
        goal = 0.0, 0.0, 2.0
        built = bodies.build(uav, ROVER, SIZE, goal, len(sheep), 1, timestep=timestep, **options)
        self.bodies, self.plant = built, Plant(uav, built, 1, 1)
        x, y, yaw = np.array(sheep).T
        at = np.stack([x, y, np.full_like(x, WHEEL)], axis=-1)
        self.plant.place(np.array([[[1.0, 1.0, height]]]), at[None], yaw[None])
        self.level = np.zeros((1, 1, 2))
        if uav.body.motor_lag:  # its motors already turn
            self.plant._batch.bind("act")[:] = GRAVITY * uav.body.mass / 4.0

    def fly(self, commands, tilted=None):
        """The drone's position, velocity and attitude after each 5 ms at its commanded velocity."""
        found = []
        for command in commands:
            tilt = None if tilted is None else np.array([[tilted]], float)
            self.plant.step(np.array([[command]], float), tilt, self.level, 1, None)
            truth, at = self.plant.truth(), self.bodies.dog_speeds[0]
            moves = self.plant._qvel[0, at : at + 3]
            found.append(np.concatenate([truth.dogs[0, 0], moves, truth.attitude[0, 0]]))
        return np.split(np.array(found), 3, axis=1)

    def drive(self, twists, seconds):
        """The rovers' places and yaws at the end of each 5 ms of driving at these twists."""
        speed, rate = np.array(twists, float).T
        left, right = rovers.wheels(ROVER, Twist(speed[None], rate[None]))
        found = []
        for _ in range(round(seconds / DT)):
            self.plant.drive(left, right)
            self.plant.step(np.zeros((1, 1, 3)), None, self.level, 1, None)
            truth = self.plant.truth()
            found.append(np.concatenate([truth.sheep[0], truth.yaw[0, :, None]], axis=1))
        return np.array(found)


def poses(trace: Trace) -> Poses:
    assert trace.poses is not None
    return trace.poses


def ending(trace: Trace) -> Ending:
    assert trace.ending is not None
    return trace.ending

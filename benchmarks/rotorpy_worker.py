"""Their side: one Crazyflie of RotorPy, under its controller on SE(3). Started by the benchmark."""
# pyright: reportMissingImports=false

import sys

import slices

slices.pin(int(sys.argv[1]))

from importlib.metadata import version  # noqa: E402

import numpy as np  # noqa: E402
from flights import SECONDS, Flight, serve  # noqa: E402
from rotorpy.controllers.quadrotor_control import SE3Control  # noqa: E402
from rotorpy.environments import Environment  # noqa: E402
from rotorpy.trajectories.hover_traj import HoverTraj  # noqa: E402
from rotorpy.vehicles.crazyflie_params import quad_params  # noqa: E402
from rotorpy.vehicles.multirotor import Multirotor  # noqa: E402

GOAL = np.array([1.0, 0.0, 0.0])  # m; a flight begins at the origin, hovering

asked = slices.requests()
sensors = next(asked)["sensors"]
drone, controller, goal = Multirotor(quad_params), SE3Control(quad_params), HoverTraj(x0=GOAL)
# As it comes: physics (RK45) and control at 100 Hz, an IMU and a motion capture with noise.
room = Environment(vehicle=drone, controller=controller, trajectory=goal)


def fly_whole() -> Flight:
    """The library's own loop."""
    found = room.run(t_final=SECONDS, terminate=False)
    times, (began, *_, ended) = found["time"], found["state"]["x"].tolist()
    return Flight(len(times) - 1, float(times[-1]), [began], [ended], GOAL.tolist())


def fly_bare() -> Flight:
    """Vehicle, controller and goal alone: no sensor, no record."""
    state = {name: np.array(value) for name, value in drone.initial_state.items()}
    began, dt, steps = state["x"].tolist(), 1 / room.sim_rate, round(SECONDS * room.sim_rate)
    for step in range(steps):
        control = controller.update(step * dt, state, goal.update(step * dt))
        state = drone.step(state, control, dt)
    return Flight(steps, steps * dt, [began], [state["x"].tolist()], GOAL.tolist())


serve(
    asked,
    fly_whole if sensors else fly_bare,
    **{name: version(name) for name in ("rotorpy", "numpy", "scipy")},
)

"""Their side: a Crazyflie in each world of crazyflow. Started by the benchmark."""
# pyright: reportMissingImports=false

import sys

import slices

slices.pin(int(sys.argv[1]))

from contextlib import chdir, redirect_stdout  # noqa: E402
from importlib.metadata import version  # noqa: E402
from tempfile import TemporaryDirectory  # noqa: E402

import numpy as np  # noqa: E402
from flights import SECONDS, Flight, serve  # noqa: E402

with redirect_stdout(sys.stderr):  # mjx prints what it could not import; ours is for answers
    from crazyflow.control import Control
    from crazyflow.sim import Sim

asked = slices.requests()
task = next(asked)
# All else as it comes: first principles, Euler at 500 Hz, attitude at 500 Hz, position at 100 Hz.
with TemporaryDirectory() as folder, chdir(folder):  # mujoco leaves MUJOCO_LOG.TXT
    sim = Sim(n_worlds=task["worlds"], control=Control.state)
calls = round(SECONDS * task["command_rate"])
call = round(sim.freq / task["command_rate"])  # physics steps
command = np.zeros((sim.n_worlds, sim.n_drones, 16))
command[..., 2] = 1.0  # m; x is 0 or 1 in turn
command[..., 9:13] = 0.0, 0.0, 0.0, 1.0
flown = 0


def places() -> list[list[float]]:
    return np.asarray(sim.data.states.pos)[:, 0].tolist()


def fly() -> Flight:
    """Take off, and then a metre there or back."""
    global flown
    command[..., 0] = flown % 2
    began = places()
    for _ in range(calls):
        sim.state_control(command)
        sim.step(call)
    flown += 1
    steps = calls * call * sim.n_worlds
    return Flight(steps, steps / sim.freq, began, places(), command[0, 0, :3].tolist())


sim.reset()
serve(asked, fly, **{name: version(name) for name in ("crazyflow", "jax", "mujoco", "numpy")})

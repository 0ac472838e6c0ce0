# pyright: reportAttributeAccessIssue=false
"""Bodies in simulated time: a batch of missions, what is true of them, and what moves them."""

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco import batch

from skydog.errors import Refusal
from skydog.flight import autopilot
from skydog.flight.autopilot import Motion
from skydog.flight.profiles import UAV
from skydog.twin.bodies import Bodies, attitudes

DT = 0.005  # s: 200 Hz of the autopilot, whatever the physics' time step

UPRIGHT = 0.5  # cosine of the tilt, at 60 degrees, from which a rover is upset
FALLEN = 0.26  # cosine of 75 degrees: the drone will not recover (MRS UAV system's limit)
LOW = 0.3  # m: a drone in a mission that is lower is down


class Truth(NamedTuple):
    """Where the bodies are in truth. Metres, radians."""

    dogs: Float[np.ndarray, "batch dogs 3"]
    quaternion: Float[np.ndarray, "batch dogs 4"]
    sheep: Float[np.ndarray, "batch sheep 2"]
    yaw: Float[np.ndarray, "batch sheep"]

    @property
    def attitude(self) -> Float[np.ndarray, "batch dogs 3"]:
        """Roll, pitch and yaw of the drones."""
        return attitudes(self.quaternion)


class Plant:
    """A batch of simulations, stepped on `threads` cores; the same for any number of them."""

    def __init__(self, uav: UAV, bodies: Bodies, missions: int, threads: int):
        self.uav, self.bodies = uav, bodies
        if mujoco.get_mju_user_warning() is None:
            # MuJoCo would write MUJOCO_LOG.TXT to the current folder; `_check` says it in one line.
            mujoco.set_mju_user_warning(lambda _: None)
        self._batch = batch.Batch(bodies.model, missions, threads)
        self._substeps = _substeps(bodies.model.opt.timestep)
        self._qpos, self._qvel, self._ctrl, self._time = (
            self._batch.bind(name) for name in ("qpos", "qvel", "ctrl", "time")
        )
        self._due = np.zeros(missions)  # s: what `_time` is, unless physics began anew
        self._applied = self._batch.bind("qfrc_applied")
        self._dogs = bodies.dogs[:, None] + np.arange(7)
        self._dog_speeds = bodies.dog_speeds[:, None] + np.arange(6)
        self._sheep = bodies.sheep[:, None] + np.arange(7)
        self._velocity = self._qvel[:, self._dog_speeds[:, :3]]
        self._memory = autopilot.Memory(
            np.zeros((missions, len(bodies.dogs), 3)), np.zeros((missions, len(bodies.dogs), 2))
        )

    def place(
        self,
        dogs: Float[np.ndarray, "batch dogs 3"],
        sheep: Float[np.ndarray, "batch sheep 3"],
        yaw: Float[np.ndarray, "batch sheep"],
    ) -> None:
        """Put all bodies somewhere, in metres, level and still; rovers turned to `yaw`."""
        self._qvel[:] = 0.0
        self._qpos[:, self._dogs[:, :3]] = dogs
        self._qpos[:, self._dogs[:, 3:]] = (1.0, 0.0, 0.0, 0.0)
        self._qpos[:, self._sheep[:, :3]] = sheep
        zero = np.zeros_like(yaw)
        turned = np.stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)], axis=-1)
        self._qpos[:, self._sheep[:, 3:]] = turned

    def truth(self) -> Truth:
        """Where the bodies are."""
        dogs, sheep = self._qpos[:, self._dogs], self._qpos[:, self._sheep]
        w, x, y, z = (sheep[..., part] for part in range(3, 7))
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return Truth(dogs[..., :3], dogs[..., 3:], sheep[..., :2], yaw)

    def speed(self) -> Float[np.ndarray, "batch dogs 3"]:
        """How fast the drones are, in m/s."""
        return self._qvel[:, self._dog_speeds[:, :3]]

    def rover_speed(self) -> Float[np.ndarray, "batch sheep"]:
        """How fast the rovers move over the floor, in m/s."""
        moves = self._qvel[:, self.bodies.sheep_speeds[:, None] + np.arange(2)]
        return np.hypot(moves[..., 0], moves[..., 1])

    def crashed(self) -> tuple[Bool[np.ndarray, " batch"], Bool[np.ndarray, " batch"]]:
        """In which missions a rover is upset, and in which a drone is down."""
        dogs, sheep = self._qpos[:, self._dogs], self._qpos[:, self._sheep]
        upset = np.any(_upright(sheep) < UPRIGHT, axis=1)
        down = np.any((dogs[..., 2] < LOW) | (_upright(dogs) < FALLEN), axis=1)
        return upset, down

    def carry(
        self,
        who: str,
        position: Float[np.ndarray, "batch bodies 2"],
        height: Float[np.ndarray, "batch dogs"],
        flying: Int[np.ndarray, " flying"],
    ) -> None:
        """Put the "sheep" or the "dogs" of missions where an ideal body would be, level."""
        places = self._sheep if who == "sheep" else self._dogs
        speeds = self.bodies.sheep_speeds if who == "sheep" else self.bodies.dog_speeds
        rows = flying[:, None, None]
        self._qpos[rows, places[:, :2]] = position[flying]
        self._qvel[rows, speeds[:, None] + np.arange(6)] = 0.0
        if who == "dogs":
            self._qpos[rows[..., 0], places[:, 2]] = height[flying]
            self._qpos[rows, places[:, 3:]] = (1.0, 0.0, 0.0, 0.0)

    def push(self, acceleration: Float[np.ndarray, "batch dogs 2"]) -> None:
        """Let wind accelerate the drones by so many m/s², from now on."""
        self._applied[:, self._dog_speeds[:, :2]] = self.uav.body.mass * acceleration

    def drive(
        self,
        left: Float[np.ndarray, "batch sheep"],
        right: Float[np.ndarray, "batch sheep"],
    ) -> None:
        """Let the rovers' wheels turn at so many rad/s, from now on."""
        self._ctrl[:, self.bodies.wheels[:, 0]] = left
        self._ctrl[:, self.bodies.wheels[:, 1]] = right

    def step(
        self,
        velocity: Float[np.ndarray, "batch dogs 3"],
        tilt: Float[np.ndarray, "batch dogs 2"] | None,
        trim: Float[np.ndarray, "batch dogs 2"],
        steps: int,
        flying: Int[np.ndarray, " flying"] | None,
        off: Bool[np.ndarray, "batch dogs"] | None = None,
    ) -> None:
        """So many steps of the autopilot, in the missions that are `flying`.

        The drones are commanded a velocity in m/s, or its part in the plane as a tilt in radians.
        `trim` is by how much each takes itself to be level when it is not; the motors of those that
        are `off` stand. Raises `Refusal` if physics does not stay finite.
        """
        for _ in range(steps):
            moves = self._qvel[:, self._dog_speeds]
            attitude = attitudes(self._qpos[:, self._dogs[:, 3:]])
            attitude[..., :2] -= trim
            speed = moves[..., :3]
            motion = Motion(speed, (speed - self._velocity) / DT, attitude, moves[..., 3:])
            self._velocity = speed
            self._memory, thrust = autopilot.rotors(
                self.uav, self._memory, motion, velocity, tilt, DT
            )
            if off is not None:
                thrust = np.where(off[..., None], 0.0, thrust)
            self._ctrl[:, self.bodies.rotors] = thrust
            self._batch.step(flying, nstep=self._substeps)
        self._due[slice(None) if flying is None else flying] += steps * DT
        self._check()

    def _check(self) -> None:
        """Raise `Refusal` if MuJoCo has put a mission back to its beginning.

        It does so, and resets the time, when a number is not finite or is huge.
        """
        again = self._time < self._due - 0.5 * DT
        if again.any():
            raise Refusal(
                f"physics broke down in mission {int(np.argmax(again))}: {self.uav.name}, the "
                "rovers or what disturbs them ask for more than its time step can take; "
                "try profiles that ship"
            )


def _substeps(timestep: float) -> int:
    """The physics' steps in one of the autopilot. Raises `Refusal` for a broken number."""
    steps = round(DT / timestep) if timestep > 0.0 else 0
    if steps < 1 or abs(steps * timestep - DT) > 1e-9:
        raise Refusal(f"the twin's time step must divide {DT:g} s, got {timestep:g} s; try 0.0025")
    return steps


def _upright(body: Float[np.ndarray, "batch bodies 7"]) -> Float[np.ndarray, "batch bodies"]:
    """The cosine of a body's tilt, from its position and quaternion."""
    return 1.0 - 2.0 * (body[..., 4] ** 2 + body[..., 5] ** 2)

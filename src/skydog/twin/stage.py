# pyright: reportAttributeAccessIssue=false
"""What draws any frame of a film: the bodies posed, two cameras, and OpenGL without a window.

It draws by EGL on Linux. The environment variable MUJOCO_GL names another way, as MuJoCo has it.
"""

import os
import sys
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco import MjvCamera, mjtGeom
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from skydog.errors import Refusal
from skydog.flight import autopilot
from skydog.flight.profiles import UAV, Rover
from skydog.twin import bodies, looks
from skydog.view.animation import RATE, Picture
from skydog.view.colours import behaviour
from skydog.world.params import World

WIDTH, HEIGHT = 1280, 720
PANEL = HEIGHT  # pixels: the width of the left picture, which shows the arena
SAMPLES = 4  # of each pixel; one would leave jagged edges, and take half the time
FACETS = 20, 10, 1  # of round parts, around and along, and of flat ones; half of MuJoCo's own
FIELD = np.radians(40.0)  # of view of both cameras, upwards
DOWN, DOWN_BEHIND = np.radians(56.0), np.radians(36.0)  # that they look below the horizon
STEADY, SLOW = 0.3, 1.8  # s of film over which the one that follows smooths its place, its turns
BLADES = 1.1  # rad that they turn from frame to frame: it looks as if they were much faster

WHITE, INK = (250, 250, 248), (40, 42, 46)
EDGE = 14  # pixels around what is written


class Scenes(NamedTuple):
    """What each frame of a film shows. Metres, radians, seconds of the mission."""

    time: Float[np.ndarray, " frames"]
    step: Int[np.ndarray, " frames"]
    dogs: Float[np.ndarray, "frames dogs 3"]
    attitude: Float[np.ndarray, "frames dogs 3"]
    sheep: Float[np.ndarray, "frames sheep 2"]
    yaw: Float[np.ndarray, "frames sheep"]
    subgoal: Float[np.ndarray, "frames dogs 2"]
    drives: Bool[np.ndarray, "frames dogs"]


class Stage:
    """Draws frames while it is entered.

    `texts` are the title, how fast the film is, and how the mission ended, for the last frame.
    To enter raises `Refusal` if there is no OpenGL.
    """

    def __init__(
        self, uav: UAV, rover: Rover, world: World, scenes: Scenes, texts: tuple[str, str, str]
    ):
        arena, dogs = world.arena, scenes.dogs.shape[1]
        sides = arena.plain_sides
        closed = bodies.closed_to(rover, world.obstacles)
        goal = float(arena.goal_x), float(arena.goal_y), float(arena.goal_radius)
        dress = partial(looks.dress, uav=uav, rover=rover, sides=sides, goal=goal, closed=closed)
        self.uav, self.rover, self.scenes, self.texts = uav, rover, scenes, texts
        self.bodies = bodies.build(
            uav, rover, sides, goal, scenes.sheep.shape[1], dogs, dress=dress, closed=closed
        )
        self.model = self.bodies.model
        see = self.model.vis
        see.global_.offwidth, see.global_.offheight = WIDTH, HEIGHT
        see.global_.fovy = np.degrees(FIELD)
        see.quality.offsamples = SAMPLES
        see.quality.numslices, see.quality.numstacks, see.quality.numquads = FACETS
        self.model.stat.extent = max(sides)  # metres in which MuJoCo counts how far it draws
        self.data = mujoco.MjData(self.model)
        self.blades = [
            (self.model.geom(f"dog{dog}_propeller{rotor}").id, spin)
            for dog in range(dogs)
            for rotor, spin in enumerate(autopilot.ROTORS[:, 2])
        ]
        for geom, _ in self.blades:
            self.model.geom_sameframe[geom] = 0  # MuJoCo would take it to stand as its body does
        self.above = _overview(sides, rover, scenes.dogs, uav.body.radius)
        self.behind = _behind(scenes, uav)

    def __enter__(self) -> "Stage":
        self._context = _opengl()
        self._context.make_current()
        self._gl = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._gl)
        marks = 11 * self.scenes.dogs.shape[1]  # of `_mark`
        self._view = mujoco.MjvScene(self.model, self.model.ngeom + marks)
        self._view.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False  # they double the time
        self._options = mujoco.MjvOption()
        return self

    def __exit__(self, *problem: object) -> None:
        self._gl.free()
        self._context.free()

    def draw(self, frame: int) -> Picture:
        """A frame: the arena at the left, and at the right what the camera behind a drone sees."""
        self._pose(frame)
        left = mujoco.MjrRect(0, 0, PANEL, HEIGHT)
        right = mujoco.MjrRect(PANEL, 0, WIDTH - PANEL, HEIGHT)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        for where, camera in ((left, self.above), (right, self.behind[frame])):
            mujoco.mjv_updateScene(
                self.model, self.data, self._options, None, camera, everything, self._view
            )
            self._mark(frame)
            mujoco.mjr_render(where, self._view, self._gl)
        pixels = np.empty((HEIGHT, WIDTH, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, mujoco.MjrRect(0, 0, WIDTH, HEIGHT), self._gl)
        picture = Image.fromarray(pixels[::-1])  # OpenGL's first row is the lowest
        self._write(ImageDraw.Draw(picture), frame)
        return np.asarray(picture)

    def _pose(self, frame: int) -> None:
        """Put the bodies where they are, and turn the blades."""
        scenes, qpos = self.scenes, self.data.qpos
        for dog, first in enumerate(self.bodies.dogs):
            qpos[first : first + 3] = scenes.dogs[frame, dog]
            turned = Rotation.from_euler("ZYX", scenes.attitude[frame, dog, ::-1])
            qpos[first + 3 : first + 7] = np.roll(turned.as_quat(), 1)  # MuJoCo: real part first
        for sheep, first in enumerate(self.bodies.sheep):
            qpos[first : first + 2] = scenes.sheep[frame, sheep]
            qpos[first + 2] = self.rover.body.wheel_radius
            qpos[first + 3 : first + 7] = _about_z(scenes.yaw[frame, sheep])
        for geom, spin in self.blades:
            self.model.geom_quat[geom] = _about_z(spin * BLADES * frame)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def _mark(self, frame: int) -> None:
        """Add each drone's shadow straight below it, a plumb line to it, and its subgoal."""
        body, scenes = self.uav.body, self.scenes
        disc, bar = mjtGeom.mjGEOM_CYLINDER, mjtGeom.mjGEOM_BOX
        for dog, (x, y, z) in enumerate(scenes.dogs[frame]):
            line = max(0.02 * body.radius, 0.005), z / 2, 0.0
            self._add(disc, line, (x, y, z / 2), 0.0, looks.colour("dog", 0.3))
            turn = scenes.attitude[frame, dog, 2]
            for rotor in looks.rotors(body) @ _turn(turn).T + (x, y, 0.008):
                for share in (0.9, 1.1):
                    size = share * looks.ring(body), 0.001, 0.0
                    self._add(disc, size, rotor, 0.0, looks.SHADOW)
            at = (*scenes.subgoal[frame, dog], 0.012)
            for turn in (np.pi / 4, -np.pi / 4):
                self._add(bar, (0.12, 0.025, 0.002), at, turn, looks.colour("subgoal"))

    def _add(self, kind: mjtGeom, size: Any, at: Any, turn: float, colour: looks.Colour) -> None:
        mujoco.mjv_initGeom(
            self._view.geoms[self._view.ngeom],
            kind.value,
            np.array(size, float),
            np.array(at, float),
            _turn(turn).ravel(),
            np.array(colour, np.float32),
        )
        self._view.ngeom += 1

    def _write(self, ink: ImageDraw.ImageDraw, frame: int) -> None:
        scenes, (title, pace, ending) = self.scenes, self.texts
        drives = bool(scenes.drives[frame].all())
        doing = "driving" if drives else "collecting"
        if frame == len(scenes.time) - 1:
            doing = ending
        clock = f"{scenes.time[frame]:.1f} s, step {scenes.step[frame]}"
        ink.line([(PANEL, 0), (PANEL, HEIGHT)], WHITE, 3)
        ink.text((EDGE, EDGE), title, INK, _font(22))
        ink.text((EDGE, HEIGHT - EDGE), pace, INK, _font(16), anchor="lb")
        ink.text((PANEL + EDGE, EDGE), clock, INK, _font(18))
        corner = (WIDTH - EDGE, EDGE)
        left, top, right, bottom = ink.textbbox(corner, doing, _font(18), anchor="ra")
        ink.rounded_rectangle((left - 8, top - 5, right + 8, bottom + 6), 6, behaviour(drives))
        ink.text(corner, doing, "black", _font(18), anchor="ra")


def _opengl() -> Any:
    """An OpenGL context without a window. Raises `Refusal` if there is none."""
    way = os.environ.get("MUJOCO_GL", "").lower() or ("egl" if sys.platform == "linux" else "")
    named = way in ("egl", "osmesa", "glfw", "cgl")
    try:
        # By its module: mujoco.GLContext is what MUJOCO_GL was when MuJoCo was imported.
        found: Any = import_module(f"mujoco.{way}") if named else mujoco
        return found.GLContext(WIDTH, HEIGHT)
    except Exception as problem:  # PyOpenGL and drivers raise what they like
        raise Refusal(
            f"a film needs OpenGL without a window, and {way or 'MuJoCo'} has none "
            f"({str(problem).split('. ')[0]:.80}); install it, apt-get install libegl1 "
            "libgl1-mesa-dri, or libosmesa6 and set MUJOCO_GL=osmesa"
        ) from None


def _overview(
    sides: tuple[float, float],
    rover: Rover,
    dogs: Float[np.ndarray, "frames dogs 3"],
    radius: float,
) -> MjvCamera:
    """The camera that looks along y and is as near as it sees the whole arena and all flights.

    A camera at c sees what is at p if |axis · (p - c)| <= slope × (forward · (p - c)), where the
    axis is right or up: each of them bounds how far forward c may be.
    """
    beyond = rover.body.radius + 2 * bodies.WALL_THICKNESS
    cube = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    wide, high = (side + 2 * beyond for side in sides)
    arena = cube * (wide, high, bodies.WALL) - (beyond, beyond, 0.0)
    flights = dogs.reshape(-1, 1, 3) + (2 * cube - 1) * radius
    points = np.concatenate([arena, flights.reshape(-1, 3)])
    forward = np.array([0.0, np.cos(DOWN), -np.sin(DOWN)])
    right = np.array([1.0, 0.0, 0.0])
    slope, depth = 0.97 * np.tan(FIELD / 2), points @ forward
    place, nearest = np.zeros(3), float("inf")
    for axis in (right, np.cross(right, forward)):
        along = points @ axis
        least, most = np.max(along - slope * depth), np.min(along + slope * depth)
        nearest = min(nearest, float(most - least) / (2 * slope))
        place += axis * (least + most) / 2
    distance = float(np.mean(depth)) - nearest
    return _camera(place + (nearest + distance) * forward, distance, np.pi / 2, -DOWN)


def _behind(scenes: Scenes, uav: UAV) -> list[MjvCamera]:
    """The camera, in each frame, that looks over the first drone to the flock."""
    dog = scenes.dogs[:, 0]
    ahead = scenes.sheep.mean(axis=1) - dog[:, :2]
    ahead = gaussian_filter1d(ahead, SLOW * RATE, axis=0, mode="nearest")
    turn = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    turn = gaussian_filter1d(turn, SLOW * RATE, mode="nearest")
    away = 1.6 + 4.0 * uav.body.radius  # a larger drone from further away
    onward = np.stack([np.cos(turn), np.sin(turn), np.full_like(turn, -1.0)], axis=-1)
    centre = gaussian_filter1d(dog, STEADY * RATE, axis=0, mode="nearest") + 0.16 * away * onward
    return [_camera(at, away, way, -DOWN_BEHIND) for at, way in zip(centre, turn, strict=True)]


def _camera(
    centre: Float[np.ndarray, "3"], distance: float, azimuth: float, elevation: float
) -> MjvCamera:
    camera = MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
    camera.lookat, camera.distance = centre, distance
    camera.azimuth, camera.elevation = np.degrees(azimuth), np.degrees(elevation)
    return camera


def _about_z(angle: float) -> Float[np.ndarray, "4"]:
    """The quaternion of a turn about z, real part first."""
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def _turn(angle: float) -> Float[np.ndarray, "3 3"]:
    """The matrix of a turn about z."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """The font of all our figures."""
    from matplotlib import get_data_path  # once `skydog.view` has seen to its import

    return ImageFont.truetype(Path(get_data_path(), "fonts/ttf/DejaVuSans.ttf"), size)

# pyright: reportAttributeAccessIssue=false
"""What there is to see: parts with neither mass nor contact, in the colours of their roles."""

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco import MjsBody, MjSpec, mjtGeom

from skydog.flight import autopilot
from skydog.flight.profiles import UAV, Rover, RoverBody, UAVBody
from skydog.twin.bodies import WALL, WALL_THICKNESS, outlines, plain
from skydog.view.colours import ROLES
from skydog.world.obstacles import Obstacles

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""

DARK: Colour = (0.13, 0.14, 0.16, 1.0)
LIGHT: Colour = (0.92, 0.92, 0.90, 1.0)
WOOL: Colour = (0.96, 0.95, 0.91, 1.0)
GLASS: Colour = (0.86, 0.90, 0.93, 0.45)
SHADOW: Colour = (0.0, 0.0, 0.0, 0.16)
FLOOR = (0.86, 0.87, 0.87)
LINES = (0.74, 0.76, 0.78)
AROUND: Colour = (0.66, 0.69, 0.72, 1.0)

BOX, MESH, SPHERE = mjtGeom.mjGEOM_BOX, mjtGeom.mjGEOM_MESH, mjtGeom.mjGEOM_SPHERE
CYLINDER, CAPSULE = mjtGeom.mjGEOM_CYLINDER, mjtGeom.mjGEOM_CAPSULE
ELLIPSOID, PLANE = mjtGeom.mjGEOM_ELLIPSOID, mjtGeom.mjGEOM_PLANE


def colour(role: str, opacity: float = 1.0) -> Colour:
    """The colour of a role, as pictures everywhere have it."""
    red, green, blue = (int(ROLES[role][at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue, opacity


def ring(has: UAVBody) -> float:
    """The radius in metres of the hull around each propeller."""
    return max(has.radius - has.arm, 0.2 * has.arm)


def rotors(has: UAVBody) -> Float[np.ndarray, "4 3"]:
    """Where the rotors are in their body, in metres, in the order of `autopilot.ROTORS`."""
    roll, pitch, _ = autopilot.ROTORS.T
    return np.stack([-pitch, roll, 0.0 * roll], axis=-1) * has.arm / np.sqrt(2.0)


def dress(
    spec: MjSpec,
    uav: UAV,
    rover: Rover,
    sides: float | tuple[float, float],
    goal: tuple[float, float, float],
    closed: Obstacles | None = None,
) -> None:
    """Add to what `bodies.build` specifies all that there is to see of it.

    The blades on rotor n of drone m turn about the z axis of the geom `dog{m}_propeller{n}`.
    """
    _light(spec)
    _dress_room(spec, plain(sides), rover.body.radius)
    for kind, size, pos, turn in outlines(closed, rover):
        quat = (np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2))
        _draw(spec.worldbody, kind, size, colour("arena"), pos=pos, quat=quat)
    _dress_goal(spec, goal)
    _dress_hull(spec, uav.body)
    for body in spec.bodies:
        if body.name.endswith(("_left", "_right")):
            _dress_wheel(body, rover.body.wheel_radius)
        elif body.name.startswith("sheep"):
            _dress_rover(body, rover.body)
        elif body.name.startswith("dog"):
            _dress_drone(body, uav.body)


def _light(spec: MjSpec) -> None:
    spec.worldbody.add_light(
        dir=(0.25, 0.35, -1.0),
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=(0.62, 0.62, 0.60),
        specular=(0.2, 0.2, 0.2),
        castshadow=False,
    )
    see = spec.visual
    see.headlight.ambient = (0.42, 0.42, 0.44)
    see.headlight.diffuse = (0.15, 0.15, 0.15)
    see.headlight.specular = (0.0, 0.0, 0.0)


def _dress_room(spec: MjSpec, sides: tuple[float, float], beyond: float) -> None:
    """The floor, whose squares are metres, and walls to look through."""
    spec.add_texture(
        name="metres",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=FLOOR,
        markrgb=LINES,
        width=64,
        height=64,
    )
    floor = spec.add_material(name="metres", reflectance=0.0, specular=0.0)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "metres"
    ends = [np.array([-beyond, side + beyond]) for side in sides]
    corners = np.stack([*np.meshgrid(*ends), np.zeros((2, 2))], axis=-1).reshape(4, 3)
    spec.add_mesh(
        name="floor",
        uservert=corners.ravel(),
        usertexcoord=corners[:, :2].ravel(),
        userface=[0, 1, 3, 0, 3, 2],
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    _draw(spec.worldbody, MESH, (), LIGHT, meshname="floor", material="metres")
    middle, thick = np.array(sides) / 2, WALL_THICKNESS / 2
    far = 20 * max(sides)
    _draw(spec.worldbody, PLANE, (far, far, 1.0), AROUND, pos=(*middle, -0.01))
    for x, y in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        half = middle + beyond + (2 * thick if x else 0.0)
        side = (thick if x else half[0], thick if y else half[1])
        at = middle + (middle + beyond + thick) * (x, y)
        _draw(spec.worldbody, BOX, (*side, WALL / 2), GLASS, pos=(*at, WALL / 2))
        _draw(spec.worldbody, BOX, (*side, 0.01), LIGHT, pos=(*at, WALL))


def _dress_goal(spec: MjSpec, goal: tuple[float, float, float]) -> None:
    x, y, radius = goal
    at = (x, y, 0.004)
    _draw(spec.worldbody, CYLINDER, (radius, 0.002, 0.0), colour("goal", 0.45), pos=at)
    rim = 0.06 * radius
    edge = [(radius - rim, 0.0), (radius, 0.0), (radius, 0.006), (radius - rim, 0.006)]
    _turned(spec, "goal", edge)
    _draw(spec.worldbody, MESH, (), colour("goal"), pos=at, meshname="goal")


def _dress_hull(spec: MjSpec, has: UAVBody) -> None:
    """A mesh: the ring around one propeller."""
    outer, half = ring(has), 0.2 * has.height
    inner, brim = 0.88 * outer, 0.94 * outer
    _turned(spec, "hull", [(inner, -half), (outer, -half), (outer, half), (brim, half)])


def _dress_drone(body: MjsBody, has: UAVBody) -> None:
    """A fuselage with an eye in front, and four propellers in the rings of a hull."""
    reach, around, half = has.arm / np.sqrt(2.0), ring(has), has.height / 2
    _draw(body, ELLIPSOID, (0.95 * reach, 0.38 * reach, 0.65 * half), DARK)
    canopy = (-0.12 * reach, 0.0, 0.45 * half)
    _draw(body, ELLIPSOID, (0.75 * reach, 0.3 * reach, 0.35 * half), colour("dog"), pos=canopy)
    _draw(body, SPHERE, (0.25 * half,), LIGHT, pos=(0.92 * reach, 0.0, 0.1 * half))
    blade = 0.88 * around
    for number, at in enumerate(rotors(has)):
        top = (at[0], at[1], 0.4 * half)
        _draw(body, CAPSULE, (0.07 * around,), DARK, fromto=(0.0, 0.0, 0.0, *at))
        _draw(body, CYLINDER, (0.16 * around, 0.3 * half), DARK, pos=at)
        _draw(body, MESH, (), colour("dog"), pos=at, meshname="hull")
        _draw(body, CYLINDER, (blade, 0.02 * half), (*DARK[:3], 0.18), pos=top)
        name = f"{body.name}_propeller{number}"
        _draw(body, ELLIPSOID, (blade, 0.11 * blade, 0.06 * half), DARK, pos=top, name=name)


def _dress_rover(body: MjsBody, has: RoverBody) -> None:
    """A robot that wears wool, and a head in front that tells where it looks."""
    radius, top = has.radius, has.height - has.wheel_radius
    floor, half = 0.004 - has.wheel_radius, 0.3 * has.height
    for share in (1.0, 1.18):
        _draw(body, CYLINDER, (share * radius, 0.001), SHADOW, pos=(0.0, 0.0, floor))
    base = 0.3 * has.wheel_radius - has.wheel_radius + half
    _draw(body, CYLINDER, (radius, half), colour("sheep"), pos=(0.0, 0.0, base))

    def put(kind: mjtGeom, size: tuple[float, ...], colour: Colour, *at: float) -> None:
        """A part whose size and place are in radii, its place above the top."""
        pos = (at[0] * radius, at[1] * radius, top + at[2] * radius)
        _draw(body, kind, tuple(radius * part for part in size), colour, pos=pos)

    for curl in np.arange(0.5, 7) * 2 * np.pi / 7:
        put(SPHERE, (0.38,), WOOL, 0.46 * np.cos(curl), 0.46 * np.sin(curl), 0.08)
    put(SPHERE, (0.50,), WOOL, -0.05, 0.0, 0.28)
    put(ELLIPSOID, (0.36, 0.27, 0.29), DARK, 0.88, 0.0, 0.35)
    for side in (1.0, -1.0):
        put(SPHERE, (0.10,), LIGHT, 1.10, side * 0.13, 0.48)
        put(ELLIPSOID, (0.09, 0.22, 0.06), DARK, 0.74, side * 0.34, 0.47)


def _dress_wheel(axle: MjsBody, radius: float) -> None:
    upright = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
    _draw(axle, CYLINDER, (radius, 0.012), DARK, quat=upright)


def _turned(spec: MjSpec, name: str, outline: list[tuple[float, float]], slices: int = 48) -> None:
    """A mesh: a closed outline of (radius, z), counter-clockwise, turned about z."""
    at = np.arange(slices)[:, None] * 2 * np.pi / slices
    radius, z = np.array(outline).T
    points = np.stack([np.cos(at) * radius, np.sin(at) * radius, np.tile(z, (slices, 1))], axis=-1)
    here = np.arange(slices * len(outline)).reshape(slices, -1)
    along, up = np.roll(here, -1, axis=0), np.roll(here, -1, axis=1)
    both = np.roll(along, -1, axis=1)
    faces = np.stack([here, along, both, here, both, up], axis=-1)
    spec.add_mesh(name=name, uservert=points.ravel(), userface=faces.ravel())


def _draw(
    body: MjsBody, kind: mjtGeom, size: tuple[float, ...], colour: Colour, **where: object
) -> None:
    """A part that is seen and has neither mass nor contact."""
    full = (*size, 0.0, 0.0, 0.0)[:3]
    body.add_geom(type=kind, size=full, rgba=colour, contype=0, conaffinity=0, mass=0.0, **where)

# pyright: reportAttributeAccessIssue=false
"""The bodies in MuJoCo: quadrotors with four rotors, rovers, floor, walls and obstacles."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float, Int
from mujoco import MjSpec, mjtGeom

from skydog.errors import Refusal
from skydog.flight import autopilot
from skydog.flight.bounds import clipped
from skydog.flight.profiles import UAV, Rover
from skydog.world.obstacles import Obstacles

TIMESTEP = 0.005  # s; see docs/twin.md for what half of it changes
WALL = 0.25  # m: its height; rovers cannot pass, and a drone at 2 m does not notice
WALL_THICKNESS = 0.05  # m; an obstacle is at least as thick

# Who touches whom: bits of what a geom is, and of what it can touch.
FLOOR, ROVER, DRONE = 1, 2, 4
PHYSICAL = 3  # the group of geoms that touch, which renderers hide


@dataclass(frozen=True)
class Bodies:
    """A model, and where in its state each body stands."""

    model: mujoco.MjModel
    dogs: Int[np.ndarray, " dogs"]  # the first of the seven places of a drone in `qpos`
    dog_speeds: Int[np.ndarray, " dogs"]  # the first of its six in `qvel`
    sheep: Int[np.ndarray, " sheep"]
    sheep_speeds: Int[np.ndarray, " sheep"]
    rotors: Int[np.ndarray, "dogs 4"]  # in `ctrl`
    wheels: Int[np.ndarray, "sheep 2"]  # left and right


def build(
    uav: UAV,
    rover: Rover,
    sides: float | tuple[float, float],
    goal: tuple[float, float, float],
    sheep: int,
    dogs: int,
    friction: float = 1.0,
    timestep: float = TIMESTEP,
    dress: Callable[[MjSpec], None] | None = None,
    closed: Obstacles | None = None,
) -> Bodies:
    """The model of an arena with so many rovers and drones in it.

    `sides` are those along x and y in metres, of a square one number. `goal` is x, y and radius in
    metres. The walls stand a rover's radius outside the arena, so that the rovers' centres have
    all of it. `friction` is the floor's, for the wheels. `closed` is what `closed_to` returns.
    What there is to see is for `dress` to add, see `skydog.twin.looks`; physics does without it.
    """
    wide, high = plain(sides)
    spec = MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = (0.0, 0.0, -autopilot.GRAVITY)
    _add_walls(spec, (wide, high), rover.body.radius)
    for kind, size, pos, turn in outlines(closed, rover):
        _add_wall(spec, kind, size, pos, turn)
    floor = spec.worldbody.add_geom(
        name="floor",
        type=mjtGeom.mjGEOM_PLANE,
        size=(wide, high, 0.1),
        pos=(wide / 2, high / 2, 0.0),
        group=PHYSICAL,
        contype=FLOOR,
        conaffinity=ROVER | DRONE,
    )
    floor.friction = (friction, 0.005, 0.0001)
    for number in range(dogs):
        _add_drone(spec, f"dog{number}", uav)
    for number in range(sheep):
        _add_rover(spec, f"sheep{number}", rover, friction)
    if dress is not None:
        dress(spec)
    try:
        model = spec.compile()
    except ValueError as problem:
        what = str(problem).splitlines()[0].removeprefix("Error: ")
        raise Refusal(
            f"physics has no bodies as {uav.name} and {rover.name} have them: {what:.80}; "
            "see the [body] of a profile that ships"
        ) from None
    for number in range(dogs):
        place = model.joint(f"dog{number}").dofadr[0]
        # The air's drag: a damping of the free joint's translation, which is implicit in the step.
        model.dof_damping[place : place + 3] = uav.body.drag
    joints = {
        who: [model.joint(f"{who}{number}") for number in range(count)]
        for who, count in (("dog", dogs), ("sheep", sheep))
    }
    return Bodies(
        model=model,
        dogs=np.array([joint.qposadr[0] for joint in joints["dog"]]),
        dog_speeds=np.array([joint.dofadr[0] for joint in joints["dog"]]),
        sheep=np.array([joint.qposadr[0] for joint in joints["sheep"]]),
        sheep_speeds=np.array([joint.dofadr[0] for joint in joints["sheep"]]),
        rotors=_actuators(model, "dog", dogs, ["rotor0", "rotor1", "rotor2", "rotor3"]),
        wheels=_actuators(model, "sheep", sheep, ["left", "right"]),
    )


Outline = tuple[mjtGeom, tuple[float, float, float], tuple[float, float, float], float]
"""What stands on the floor: a geom's kind, size and place in metres, and its turn about z."""


def plain(sides: float | tuple[float, float]) -> tuple[float, float]:
    """The sides along x and y, of what may be one number for both."""
    return sides if isinstance(sides, tuple) else (sides, sides)


def closed_to(rover: Rover, obstacles: Obstacles | None) -> Obstacles | None:
    """Where the centre of a rover cannot be: the obstacles, or a little more.

    An obstacle's body is a rover's radius thinner than the obstacle, so that rovers' centres come
    as near as a point does, but no thinner than the arena's walls. Raises `Refusal` for tall
    obstacles.
    """
    if obstacles is None:
        return None
    if obstacles.tall:
        raise Refusal(
            "the twin's drones fly above obstacles, and this scene has dogs on the ground; "
            "change its file to dogs = 'above'"
        )
    least = rover.body.radius + WALL_THICKNESS / 2
    return replace(obstacles, radius=jnp.maximum(obstacles.radius, least))


def outlines(closed: Obstacles | None, rover: Rover) -> list[Outline]:
    """The bodies of obstacles, as high as walls: boxes with round ends, and discs."""
    if closed is None:
        return []
    found: list[Outline] = []
    radii = np.asarray(closed.radius, float) - rover.body.radius
    for (first, last), radius in zip(np.asarray(closed.ends, float), radii, strict=True):
        ends = [first] if np.array_equal(first, last) else [first, last]
        for x, y in ends:
            found.append((mjtGeom.mjGEOM_CYLINDER, (radius, WALL / 2, 0.0), (x, y, WALL / 2), 0.0))
        if len(ends) == 2:
            along, (x, y) = last - first, (first + last) / 2
            size = float(np.hypot(*along)) / 2, radius, WALL / 2
            turn = float(np.arctan2(along[1], along[0]))
            found.append((mjtGeom.mjGEOM_BOX, size, (x, y, WALL / 2), turn))
    return found


def rest(uav: UAV, rover: Rover) -> tuple[float, float]:
    """The altitude in metres of a drone and of a rover that stand on the floor."""
    return uav.body.height / 2, rover.body.wheel_radius


def attitudes(
    quaternion: Float[np.ndarray, "*batch 4"],
) -> Float[np.ndarray, "*batch 3"]:
    """Roll, pitch and yaw in radians of a unit quaternion, real part first."""
    w, x, y, z = (quaternion[..., part] for part in range(4))
    angles = np.empty((*quaternion.shape[:-1], 3))
    np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y), out=angles[..., 0])
    np.arcsin(clipped(2 * (w * y - z * x), -1.0, 1.0), out=angles[..., 1])
    np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z), out=angles[..., 2])
    return angles


def _actuators(
    model: mujoco.MjModel, who: str, count: int, names: list[str]
) -> Int[np.ndarray, "bodies each"]:
    found = [
        [model.actuator(f"{who}{number}_{name}").id for name in names] for number in range(count)
    ]
    return np.array(found, int).reshape(count, len(names))


def _add_walls(spec: MjSpec, sides: tuple[float, float], beyond: float) -> None:
    middle, thick = np.array(sides) / 2, WALL_THICKNESS / 2
    half, away = middle + beyond + WALL_THICKNESS, middle + beyond + thick
    for x, y in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        size = thick if x else half[0], thick if y else half[1], WALL / 2
        at = middle + away * (x, y)
        _add_wall(spec, mjtGeom.mjGEOM_BOX, size, (at[0], at[1], WALL / 2), 0.0)


def _add_wall(
    spec: MjSpec,
    kind: mjtGeom,
    size: tuple[float, float, float],
    pos: tuple[float, float, float],
    turn: float,
) -> None:
    spec.worldbody.add_geom(
        type=kind,
        size=size,
        pos=pos,
        quat=(np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)),
        group=PHYSICAL,
        friction=(0.2, 0.005, 0.0001),
        contype=FLOOR,
        conaffinity=ROVER | DRONE,
    )


def _add_drone(spec: MjSpec, name: str, uav: UAV) -> None:
    body, reach = uav.body, uav.body.arm / np.sqrt(2.0)
    drone = spec.worldbody.add_body(name=name, pos=(0.0, 0.0, body.height / 2))
    drone.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_FREE)
    drone.explicitinertial = True
    # Without `ipos` MuJoCo puts the mass at the place of the body in the world.
    drone.mass, drone.inertia, drone.ipos = body.mass, body.inertia, (0.0, 0.0, 0.0)
    drone.add_geom(  # its bumper
        type=mjtGeom.mjGEOM_CYLINDER,
        size=(body.radius, body.height / 2, 0.0),
        contype=DRONE,
        conaffinity=FLOOR | ROVER | DRONE,
        friction=(0.5, 0.005, 0.0001),
        group=PHYSICAL,
    )
    for number, (roll, pitch, spin) in enumerate(autopilot.ROTORS):
        at = (-pitch * reach, roll * reach, 0.0)
        site = f"{name}_rotor{number}"
        drone.add_site(name=site, pos=at, group=4)
        rotor = spec.add_actuator(
            name=site,
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target=site,
            gear=(0.0, 0.0, 1.0, 0.0, 0.0, spin * body.rotor_torque),
            ctrllimited=True,
            ctrlrange=(0.0, body.rotor_thrust),
        )
        if body.motor_lag:
            rotor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            rotor.dynprm[0] = body.motor_lag
            rotor.actlimited, rotor.actrange = True, (0.0, body.rotor_thrust)


def _add_rover(spec: MjSpec, name: str, rover: Rover, friction: float) -> None:
    body, wheel = rover.body, rover.body.wheel_radius
    base = spec.worldbody.add_body(name=name, pos=(0.0, 0.0, wheel))
    base.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_FREE)
    clear, wheel_mass = 0.4 * wheel, 0.05 * body.mass
    half = (body.height - clear) / 2
    base.add_geom(  # heavy below, as its battery is
        type=mjtGeom.mjGEOM_CYLINDER,
        size=(body.radius, half, 0.0),
        pos=(0.0, 0.0, clear + half - wheel),
        mass=body.mass - 2 * wheel_mass,
        group=PHYSICAL,
        contype=ROVER,
        conaffinity=FLOOR | ROVER | DRONE,
        friction=(0.2, 0.005, 0.0001),
    )
    caster = 0.4 * wheel
    for x in (0.8, -0.8):
        # Contact friction is the larger of the pair's: without priority casters would drag.
        base.add_geom(
            type=mjtGeom.mjGEOM_SPHERE,
            size=(caster, 0.0, 0.0),
            pos=(x * body.radius, 0.0, caster - wheel),
            mass=0.0,
            condim=1,
            priority=1,
            group=PHYSICAL,
            contype=ROVER,
            conaffinity=FLOOR,
        )
    for side, sign in (("left", 1.0), ("right", -1.0)):
        axle = base.add_body(
            name=f"{name}_{side}", pos=(0.0, sign * body.wheel_separation / 2, 0.0)
        )
        # Without its motor's inertia a wheel is so light that its servo chatters in every step.
        axle.add_joint(
            name=f"{name}_{side}", axis=(0.0, 1.0, 0.0), damping=0.0, armature=body.wheel_inertia
        )
        # A sphere touches the floor in one point, as a wheel does, and is faster than a cylinder.
        axle.add_geom(
            type=mjtGeom.mjGEOM_SPHERE,
            size=(wheel, 0.0, 0.0),
            mass=wheel_mass,
            friction=(friction, 0.005, 0.0001),
            contype=ROVER,
            conaffinity=FLOOR,
            group=PHYSICAL,
        )
        servo = spec.add_actuator(
            name=f"{name}_{side}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=f"{name}_{side}",
            forcelimited=True,
            forcerange=(-body.wheel_torque, body.wheel_torque),
        )
        servo.set_to_velocity(kv=body.wheel_gain)

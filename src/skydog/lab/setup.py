"""What a site comes to: its world and shepherd, and the base station with its limits."""

from math import inf
from typing import Any, NamedTuple

import numpy as np

from skydog.errors import Refusal
from skydog.flight import altitude, profiles, station
from skydog.flight.base import Base
from skydog.flight.limits import Limits
from skydog.flight.station import DT, Station
from skydog.lab.site import Site
from skydog.shepherds import rules
from skydog.world import presets, scenes
from skydog.world.mission import Shepherd
from skydog.world.params import World

ROOM = 0.3  # m between the soft fence and the hard one, at least: what a drone takes to stop
HEADROOM = 0.3  # m above the highest drone


class Setup(NamedTuple):
    """Everything that is fixed for a flight."""

    world: World
    shepherd: Shepherd
    card: dict[str, Any]
    base: Base


def setup(site: Site) -> Setup:
    """What a site comes to. Raises `Refusal` for what does not fit together."""
    here, asked = world(site), site.mission.sheepdog
    shepherd, card = rules.read(asked)
    return Setup(here, shepherd, card, base(site, here))


def world(site: Site) -> World:
    """The world of a site's mission. Raises `Refusal` for one that cannot be."""
    asked = site.mission
    here = presets.preset(asked.preset, asked.arena, len(site.ugv), asked.goal, None)
    return presets.at_speed(here, asked.speed)


def base(site: Site, world: World) -> Base:
    """The base station of a site. Raises `Refusal` if the dog's airspace does not fit the cage."""
    uav, rover = profiles.uav(site.uav[0].profile), profiles.rover(site.ugv[0].profile)
    dt = float(scenes.check_open(world, "a laboratory").arena.dt)
    if abs(round(dt / DT) * DT - dt) > 1e-6 or dt < DT:
        raise Refusal(f"decisions are {DT:g} s apart or a multiple of it, got {dt:g} s")
    size, beyond = float(world.arena.size), float(world.dog.airspace)
    airspace = (-beyond, size + beyond)
    height = altitude.HEIGHT + station.LEVEL * np.arange(len(site.uav))[None, :]
    highest = float(height.max())
    _fits(site, airspace, highest)
    loop = Station(
        uav,
        rover,
        site.mission.steering,
        site.mission.wait,
        dt,
        np.asarray(world.sheep.speed, float),
        site.safety.acceleration,
    )
    safety = site.safety
    limits = Limits(
        site.cage.x,
        site.cage.y,
        site.cage.z,
        stale=safety.stale,
        blind=safety.blind,
        alarm=safety.alarm,
        # A decision may come a little late without being missed.
        silence=(safety.missed_decisions + 0.5) * dt,
        battery=safety.battery,
        drone_speed=1.5 * uav.velocity.largest,
        rover_speed=1.5 * rover.motion.largest_speed,
        runaway=inf if site.mission.flock == "own" else Limits.runaway,
    )
    return Base(loop, limits, airspace, (0.0, size), height)


def _fits(site: Site, airspace: tuple[float, float], highest: float) -> None:
    for axis, (least, most) in (("x", site.cage.x), ("y", site.cage.y)):
        if least > airspace[0] - ROOM or most < airspace[1] + ROOM:
            raise Refusal(
                f"the dog's airspace, {airspace[0]:g} to {airspace[1]:g} m, does not fit into "
                f"cage.{axis}, {least:g} to {most:g} m, with {ROOM:g} m to stop; try a smaller "
                "mission.arena, or mission.preset = 'paper-physical', whose dog keeps within 0.2 m"
            )
    if site.cage.z[1] < highest + HEADROOM:
        raise Refusal(
            f"drones fly as high as {highest:g} m, and cage.z ends at {site.cage.z[1]:g} m; "
            f"{highest + HEADROOM:g} m are needed"
        )

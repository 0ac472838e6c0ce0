"""The pre-flight gate: what must be true before anything takes off. Pure."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from skydog.flight.base import Base
from skydog.flight.limits import APART, PAD
from skydog.flight.station import DT
from skydog.lab.adapters import Status
from skydog.lab.eyes import Sighting
from skydog.lab.site import Site, UAVSite, UGVSite

RATE = (0.8, 1.2)  # share of the site's rate that a tracker must keep; Crazyswarm2: 80 to 120 Hz
USED = 0.8  # share of a battery's minutes that is counted on; ours


class Check(NamedTuple):
    """One line of the gate: what it is about, whether it passes, what was found, what to do."""

    name: str
    passes: bool
    found: str
    fix: str = ""

    def __str__(self) -> str:
        return f"{self.name}: {self.found}" + (f"; {self.fix}" if self.fix else "")


def checks(
    site: Site,
    base: Base,
    seconds: float,
    sighting: Sighting,
    rates: Sequence[float],
    status: Sequence[Status],
    others: Mapping[str, Sequence[str]],
    self_test: str,
    now: float,
    stopped: str = "",
) -> list[Check]:
    """All checks, those of bodies first. `seconds` is how long a mission can take.

    `rates` are the poses a second of each body, drones first; `others` who else commands a robot,
    by its name; `self_test` is why the sheepdog fails its own, or ""; `stopped` is what would
    stop a flight at once, a stop file or a dead-man button that is let go, or "".
    """
    robots = [*site.uav, *site.ugv]
    names = [robot.name for robot in robots]
    frame = sighting.frame
    found = [
        Check(
            f"{name} is seen",
            now - came <= base.limits.stale,
            why or "fresh",
            "show it to the tracker, and call it so there",
        )
        for name, came, why in zip(names, sighting.came, sighting.why, strict=True)
    ]
    # A tick takes the latest frame, so that of a faster tracker a hundred a second are counted.
    least, most = (share * min(site.mocap.rate, 1.0 / DT) for share in RATE)
    found += [
        Check(
            f"rate of {name}",
            least <= rate <= most,
            f"{rate:.0f} Hz, {least:.0f} to {most:.0f} wanted",
            "mocap.rate is that of the tracker",
        )
        for name, rate in zip(names, rates, strict=True)
    ]
    found += _places(site, base, frame.dogs, frame.sheep)
    for uav, said in zip(site.uav, status, strict=True):
        found += _drone(uav, said, seconds)
    found += [_alone(robot, others.get(robot.name, ())) for robot in robots]
    found.append(Check("self-test of the sheepdog", not self_test, self_test or "passes"))
    found.append(Check("no stop is pulled", not stopped, stopped or "none"))
    return found


def _drone(uav: UAVSite, said: Status, seconds: float) -> list[Check]:
    lasts = 60.0 * uav.battery_minutes * USED * (said.battery if said.battery is not None else 1.0)
    battery = "unknown" if said.battery is None else f"{said.battery:.0%}"
    return [
        Check(f"{uav.name} answers", said.connected, "yes" if said.connected else "no"),
        Check(f"{uav.name} is on the ground", not said.flying, "flies" if said.flying else "yes"),
        Check(
            f"{uav.name} is no emergency",
            not said.emergency,
            "emergency" if said.emergency else "yes",
            "reset it by hand" if said.emergency else "",
        ),
        Check(
            f"battery of {uav.name}",
            lasts >= seconds,
            f"{battery}, lasts {lasts:.0f} s of the {seconds:.0f} s that a mission can take",
            "" if lasts >= seconds else "charge it, or ask for fewer steps",
        ),
    ]


def _alone(robot: UAVSite | UGVSite, others: Sequence[str]) -> Check:
    return Check(
        f"nobody else commands {robot.name}",
        not others,
        ", ".join(others) or "nobody",
        "end them" if others else "",
    )


def _places(site: Site, base: Base, dogs: np.ndarray, sheep: np.ndarray) -> list[Check]:
    """Whether everybody stands where a flight can begin."""
    sizes = base.station.uav.body.radius + base.station.rover.body.radius
    cage = np.array([site.cage.x, site.cage.y, site.cage.z])
    found = []
    for each, at in zip(site.uav, dogs, strict=True):
        inside = bool(np.all((at >= cage[:, 0]) & (at <= cage[:, 1])))
        found.append(
            Check(
                f"{each.name} is inside the cage",
                inside,
                f"at {at[0]:.2f}, {at[1]:.2f}, {at[2]:.2f} m",
                "" if inside else "place it there, or check mocap.origin and mocap.yaw",
            )
        )
        found.append(_apart(f"pad of {each.name} is clear", at[:2], sheep, PAD + sizes))
    least, most = base.arena
    for number, (each, at) in enumerate(zip(site.ugv, sheep, strict=True)):
        inside = bool(np.all((at >= least - 0.05) & (at <= most + 0.05)))
        found.append(
            Check(
                f"{each.name} is in the arena",
                inside,
                f"at {at[0]:.2f}, {at[1]:.2f} m",
                "" if inside else f"place it within {least:g} to {most:g} m",
            )
        )
        beside = 2 * base.station.rover.body.radius + APART
        found.append(_apart(f"{each.name} does not touch another", at, sheep[:number], beside))
    return found


def _apart(name: str, at: np.ndarray, others: np.ndarray, needed: float) -> Check:
    """Whether the nearest of some others is far enough away, in metres."""
    gap = float(np.min(np.hypot(*(others - at).T), initial=np.inf))
    return Check(
        name,
        gap >= needed,
        f"nearest {gap:.2f} m, {needed:.2f} wanted",
        "" if gap >= needed else "move one of them",
    )

"""A motion-capture system that is not there: it sends Vicon's packets, and fails on demand."""

import contextlib
import heapq
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan

import numpy as np

from skydog.errors import Refusal
from skydog.lab import vicon
from skydog.lab.adapters import Quaternion, Vector
from skydog.lab.eyes import product, to_tracker
from skydog.lab.site import Site

POSITION_NOISE = 0.0002  # m, standard deviation on each axis; ours
ATTITUDE_NOISE = 0.0005  # rad, the same
Shown = tuple[Vector, Quaternion]
NOWHERE: Shown = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)  # what a packet full of zeros says
NOTHING: Shown = (nan, nan, nan), (nan, nan, nan, nan)


@dataclass
class Faults:
    """What is wrong with the tracker. May be changed while it runs."""

    silent: bool = False  # nothing is sent
    stuck: bool = False  # the frame number stays
    hidden: set[str] = field(default_factory=set)  # bodies left out
    zeroed: set[str] = field(default_factory=set)
    nan: set[str] = field(default_factory=set)
    frozen: set[str] = field(default_factory=set)  # bodies shown as they were last
    turned: set[str] = field(default_factory=set)  # bodies whose pattern is taken for its half turn
    swapped: tuple[str, str] | None = None  # two bodies, each mistaken for the other
    jump: dict[str, Vector] = field(default_factory=dict)  # m, added in the world's frame
    delay: int = 0  # frames that each packet waits
    dropout: float = 0.0  # share of packets that are lost
    duplicate: float = 0.0  # share that is sent twice
    reorder: float = 0.0  # share that is sent after the next
    truncate: float = 0.0  # share that is cut
    garbage: float = 0.0  # share that random bytes go ahead of, as a packet


class Tracker:
    """Sends what a site's tracker would see of bodies, to the address where the site listens."""

    def __init__(self, site: Site, seed: int = 0) -> None:
        self.faults = Faults()
        self.number = 0  # of the next frame
        self._mocap = site.mocap
        self._robots = {robot.name: robot for robot in (*site.uav, *site.ugv)}
        vicon.encode(0, dict.fromkeys(self._robots, NOWHERE))  # refuses what no packet can hold
        self._random = np.random.default_rng(seed)
        self._shown: dict[str, Shown] = {}
        self._frames = 0  # shown so far
        self._waiting: list[tuple[int, int, bytes]] = []  # by the frame at which each is due
        try:
            self._address = (socket.gethostbyname(site.mocap.host), site.mocap.port)
        except (OSError, UnicodeError) as error:
            raise Refusal(
                f"mocap.host {site.mocap.host!r} is no address; write that of the base station"
            ) from error
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def show(self, bodies: Mapping[str, tuple[Vector, Quaternion]]) -> None:
        """Send a frame of robots, by name: where they truly are, in metres of the world."""
        self._shown |= {
            name: self._seen(name, *pose)
            for name, pose in bodies.items()
            if name not in self.faults.frozen or name not in self._shown
        }
        first, second = self.faults.swapped or ("", "")
        called = {first: second, second: first}  # whether or not both are there
        shown = {called.get(name, name): self._shown[name] for name in bodies}
        shown |= dict.fromkeys(self.faults.zeroed & shown.keys(), NOWHERE)
        shown |= dict.fromkeys(self.faults.nan & shown.keys(), NOTHING)
        for name in self.faults.hidden:
            shown.pop(name, None)
        self._send(vicon.encode(self.number, shown))
        if not self.faults.stuck:
            self.number += 1

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()

    def _seen(self, name: str, position: Vector, attitude: Quaternion) -> Shown:
        jump = self.faults.jump.get(name, (0.0, 0.0, 0.0))
        x, y, z = (p + j for p, j in zip(position, jump, strict=True))
        markers, attitude = to_tracker(self._mocap, self._robots[name], (x, y, z), attitude)
        if name in self.faults.turned:
            attitude = product(attitude, (0.0, 0.0, 1.0, 0.0))
        x, y, z = (markers + self._random.normal(0.0, POSITION_NOISE, 3)).tolist()
        a, b, c = self._random.normal(0.0, ATTITUDE_NOISE / 2, 3).tolist()
        return (x, y, z), product(attitude, (a, b, c, (1.0 - a * a - b * b - c * c) ** 0.5))

    def _send(self, packet: bytes) -> None:
        faults = self.faults
        lost, twice, late, cut, noisy = self._random.random(5).tolist()
        if cut < faults.truncate:
            packet = packet[: self._random.integers(len(packet))]
        if lost >= faults.dropout:
            due = self._frames + faults.delay + (late < faults.reorder)
            for _ in range(1 + (twice < faults.duplicate)):
                heapq.heappush(self._waiting, (due, -self._frames, packet))
        if faults.silent:
            self._waiting.clear()
        elif noisy < faults.garbage:
            self._emit(self._random.bytes(int(self._random.integers(vicon.LARGEST))))
        while self._waiting and self._waiting[0][0] <= self._frames:
            self._emit(heapq.heappop(self._waiting)[2])
        self._frames += 1

    def _emit(self, packet: bytes) -> None:
        with contextlib.suppress(OSError):  # a closed or a full socket is a lost packet
            self._socket.sendto(packet, self._address)

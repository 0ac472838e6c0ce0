"""A flood of packets that are none: random bytes, and the tracker's own, cut off.

None is a whole frame with a robot in it: who forges those can fly the drone, and no parser helps.
"""

import contextlib
import socket
import threading
import time

import numpy as np

from skydog.lab import vicon
from skydog.lab.emulation.tracker import NOWHERE
from skydog.lab.site import Site

RATE = 20_000  # packets a second
EVERY = 0.002  # s between bursts
KINDS = 500  # packets, of which each is sent many times


class Flood:
    """Sends so many packets to a site's tracker port, in a thread. Use it with `with`."""

    def __init__(self, site: Site, many: int):
        self._address = (site.mocap.host, site.mocap.port)
        self._many = many
        self._over = threading.Event()
        names = [robot.name for robot in (*site.uav, *site.ugv)]
        self._packets = _damaged(names)
        self._thread = threading.Thread(target=self._send, name="flood", daemon=True)

    def __enter__(self) -> "Flood":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _send(self) -> None:
        burst, sent = round(RATE * EVERY), 0
        due = time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            while sent < self._many and not self._over.wait(max(0.0, due - time.monotonic())):
                due += EVERY
                for _ in range(burst):
                    with contextlib.suppress(OSError):  # a full socket: one that is lost
                        wire.sendto(self._packets[sent % KINDS], self._address)
                    sent += 1


def _damaged(names: list[str]) -> list[bytes]:
    random = np.random.default_rng(0)
    whole = vicon.encode(0, dict.fromkeys(names, NOWHERE))
    packets = []
    for number in range(KINDS):
        if number % 2:
            packets.append(random.bytes(int(random.integers(vicon.LARGEST))))
        else:
            packets.append(whole[: int(random.integers(vicon.HEADER.size + vicon.ITEM.size))])
    return packets

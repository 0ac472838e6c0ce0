"""The whole chain on one machine: master, guards and room, each a process; and a site to fly it."""

import contextlib
import multiprocessing
import os
import shlex
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, get_args

from skydog import processes
from skydog.errors import Refusal
from skydog.lab import check, guard
from skydog.lab.emulation.room import Report, Start, run
from skydog.lab.site import (
    DDS,
    ROS1,
    Cage,
    Mission,
    Mocap,
    Safety,
    Site,
    UAVAdapter,
    UAVSite,
    UGVSite,
)

Transport = Literal["ros1", "dds"]
PATIENCE = 60.0  # s that a room may take to start
BEYOND = 0.7  # m around the arena where the cage hangs: the airspace, and room to stop; ours
CEILING = 3.0  # m

GUARD = """
import os, runpy, sys, threading
threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""A robot's guard: that of an emulated robot lives no longer than who emulates it."""

PROFILES: dict[str, str] = {
    "tum-simulator": "tum-simulator",
    "ardrone-autonomy": "ardrone2",
    "twist-dds": "tum-simulator",
    "crazyswarm2": "crazyflie",
    "crazyflie": "crazyflie",
    "mavlink": "tum-simulator",
}
"""The profile that each adapter is emulated with."""

ADAPTERS: dict[Transport, UAVAdapter] = {"ros1": "ardrone-autonomy", "dds": "twist-dds"}


def a_site(
    mission: Mission,
    size: float,
    transport: Transport = "ros1",
    adapter: UAVAdapter | None = None,
    profile: str | None = None,
    sheep: int = 3,
) -> Site:
    """A site whose tracker, master and robots are all on this machine; ports are free ones."""
    if transport not in get_args(Transport):
        raise Refusal(f"there is no transport {transport!r:.40}; choose from ros1, dds")
    adapter = adapter or ADAPTERS[transport]
    guarded = transport == "ros1" and adapter in ("ardrone-autonomy", "tum-simulator")
    uav = UAVSite(
        "uav1",
        adapter,
        profile or PROFILES[adapter],
        topic="/cmd_vel_in" if guarded else "",
        uri="by the room" if adapter in ("crazyflie", "mavlink") else "",
        stops_by_itself=adapter in ("crazyflie", "crazyswarm2", "mavlink"),
        guard=guarded,
    )
    span = (-BEYOND, size + BEYOND)
    return Site(
        mission,
        Cage(span, span, (-0.5, CEILING)),
        Mocap(port=free_port(socket.SOCK_DGRAM)),
        ROS1("http://127.0.0.1:0"),  # any port that is free when the chain starts
        DDS(domain=_free_domain()),
        (uav,),
        tuple(
            UGVSite(f"ugv{number}", transport, "kobuki", stops_by_itself=True)
            for number in range(1, sheep + 1)
        ),
        Safety(),
    )


class Chain:
    """Master, guards and room of a site, started together. Use it with `with`."""

    def __init__(self, site: Site, start: Start):
        self.site, self.start = site, start
        self.master: Any = None
        self._guards: dict[str, subprocess.Popen[bytes]] = {}
        self._room: Any = None
        self._report: Report | None = None

    def __enter__(self) -> "Chain":
        try:
            if self._speaks_ros1():
                from skydog.lab.emulation.master import Master

                self.master = Master(int(self.site.ros1.master.rpartition(":")[2]))
                here = replace(self.site.ros1, master=self.master.uri.rstrip("/"))
                self.site = replace(self.site, ros1=here)
                for robot in (*self.site.uav, *self.site.ugv):
                    if robot.guard:
                        self._guards[robot.name] = self._guard(robot)
            self._start_room()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._room is not None:
            with contextlib.suppress(OSError):
                self._wire.send(None)
            self._room.join(5.0)
            if self._room.is_alive():
                self._room.kill()
                self._room.join()
        for process in self._guards.values():
            process.terminate()
            assert process.stdin is not None
            process.stdin.close()
        for process in self._guards.values():
            try:
                process.wait(3.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if self.master is not None:
            self.master.close()

    def change(self, what: Literal["faults", "wrong"], name: str, value: Any) -> None:
        """Change what is wrong with the tracker, or with the robots. Refused by other trackers."""
        if what == "faults" and self.site.mocap.source != "vicon-udp":
            raise Refusal(f"only Vicon's UDP stream fails on demand, not {self.site.mocap.source}")
        self._wire.send((what, name, value))

    def report(self) -> Report | None:
        """The latest that the room has said; None before the first."""
        return self._report

    def _listen(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._report = self._wire.recv()

    def restart_master(self) -> None:
        """Kill the master as a power cut would, and start it again at its old port."""
        from skydog.lab.emulation.master import Master

        port = self.master.port
        self.master.kill()
        self.master = Master(port)

    def _start_room(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._wire, theirs = context.Pipe()
        self._room = context.Process(
            target=run, args=(self.site, self.start, theirs), name="room", daemon=True
        )
        processes.start(self._room)
        theirs.close()
        try:
            if not self._wire.poll(PATIENCE):
                raise Refusal(f"the emulated room does not start within {PATIENCE:g} s")
            addresses: Mapping[str, str] = self._wire.recv()
        except (EOFError, OSError):
            raise Refusal("the emulated room has died; what it printed says why") from None
        drones = tuple(
            replace(uav, uri=addresses.get(uav.name) or uav.uri) for uav in self.site.uav
        )
        self.site = replace(self.site, uav=drones)
        threading.Thread(target=self._listen, name="room", daemon=True).start()

    def _guard(self, robot: UAVSite | UGVSite) -> "subprocess.Popen[bytes]":
        options = shlex.split(check.guard(robot))[2:]
        env = {**os.environ, "ROS_MASTER_URI": self.site.ros1.master, "ROS_IP": "127.0.0.1"}
        return subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", GUARD, guard.__file__, *options],
            env=env,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for whoever started it
        )

    def _speaks_ros1(self) -> bool:
        adapters = {robot.adapter for robot in (*self.site.uav, *self.site.ugv)}
        ours = {"ros1", "tum-simulator", "ardrone-autonomy"}
        return self.site.mocap.source == "ros1" or bool(adapters & ours)


def free_port(kind: int) -> int:
    """A port of loopback that is free now."""
    with socket.socket(socket.AF_INET, kind) as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def _free_domain() -> int:
    """A DDS domain that hardly anybody else on this machine uses: by chance, of those over 100."""
    return 101 + free_port(socket.SOCK_DGRAM) % 100

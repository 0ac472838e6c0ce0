"""A Crazyflie by Bitcraze's cflib: velocities and motion capture's positions out, status in.

All of the flight is flown by velocity, take-off and landing too: the SNI loop of the base station
commands velocities, and the firmware limits position set-points to 1 m/s (its `posCtlPid.xVelMax`)
and flies them by a loop of its own, which would be a second one around ours. The high-level
commander is left alone: whoever mixes the two has to hand over between them.

cflib is GPL-2.0-or-later: nothing but this module imports it. The firmware's part is told by its
sources, `supervisor.c` and `crtp_commander_generic.c`.
"""

import logging
import threading
import time
from collections.abc import Mapping
from typing import Any

from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab.adapters import DroneCommand, Status

ANSWERS = 10.0  # s within which a Crazyflie that is there has answered
TABLES = 60.0  # s within which it has told its tables, over a bad radio link; 5 to 10 are usual
PERIOD = 100  # ms between two log packets
SILENT = 1.0  # s without a log packet: the link is lost
ARMING = 0.5  # s between two requests to arm
FLOOR = 0.1  # m: a landing drone that is seen below it stops its motors
OVERSHOOT = 0.5  # m below the floor that an unseen drone is told to sink before its motors stop
KALMAN = 2  # of `stabilizer.estimator`: the one that takes external positions
EMPTY, FULL = 3.0, 4.2  # V of its one cell
FLYING, TUMBLED, LOCKED, CRASHED = 1 << 4, 1 << 5, 1 << 6, 1 << 7  # of `supervisor.info`

LOGGED = ("pm.vbat", "pm.batteryLevel", "supervisor.info", "sys.isFlying", "sys.isTumbled")


class CrazyflieDrone:
    """A Crazyflie at an address such as radio://0/80/2M/E7E7E7E7E7 or udp://127.0.0.1:19850.

    It connects when it is made. Refuses where cflib is missing or no Crazyflie answers.
    """

    def __init__(self, name: str, uri: str) -> None:
        self._lost = False
        self._status = Status()
        self._heard = 0.0  # s, when its last log packet came
        self._latest: tuple[DroneCommand, float] | None = None
        self._news = threading.Event()
        self._closed = False
        self._before = 0.0  # s, of the command before
        self._height = 0.0  # m over the floor: seen, and while it lands as it is told to sink
        self._asked = -ARMING  # s, when it was last asked to arm
        self._placed = False  # its estimator has been told where it stands
        self._cf = _crazyflie()
        try:
            self._connect(uri)
            self._set("stabilizer.estimator", KALMAN)
            self._log()
        except Exception as error:  # of cflib, whatever it is, or ours
            self._disconnect()
            raise Refusal(
                f"{name}: no Crazyflie answers at {uri!r} ({error}); switch it on, or write its own"
                ' address, for example uri = "radio://0/80/2M/E7E7E7E7E7"'
            ) from error
        # A thread of its own: cflib waits up to 2 s for the radio, and holds a lock meanwhile.
        self._sender = threading.Thread(target=self._run, name=f"crazyflie {name}", daemon=True)
        self._sender.start()

    def send(self, command: DroneCommand, now: float) -> None:
        """Leave the command for the sender, which takes the latest."""
        self._latest = (command, now)
        self._news.set()

    def status(self) -> Status:
        """The latest that it said; not connected when it has said nothing for 1 s."""
        silent = time.monotonic() - self._heard > SILENT
        return self._status._replace(connected=not (self._lost or silent))

    def others(self) -> tuple[str, ...]:
        """Nobody: a radio link has one end."""
        return ()

    def close(self) -> None:
        """Let go of the link. The firmware levels out after 0.5 s and cuts its motors after 2 s."""
        if self._closed:
            return
        self._closed = True
        self._news.set()
        self._sender.join(5.0)
        self._disconnect()

    def _connect(self, uri: str) -> None:
        cf = self._cf
        answered, ready = threading.Event(), threading.Event()
        trouble: list[str] = []

        def fail(_: str, why: str) -> None:
            self._lost = True
            trouble.append(why.strip().splitlines()[0])
            answered.set()
            ready.set()

        cf.link_established.add_callback(lambda _: answered.set())
        cf.fully_connected.add_callback(lambda _: ready.set())
        cf.connection_failed.add_callback(fail)
        cf.connection_lost.add_callback(fail)
        cf.open_link(uri)
        if not (answered.wait(ANSWERS) and ready.wait(TABLES)) or trouble:
            raise ConnectionError(trouble[0] if trouble else "silence")

    def _disconnect(self) -> None:
        cf = self._cf
        threads = [cf.incoming, cf.param.param_updater]
        # cflib says goodbye by a set-point of no thrust, which drops a drone that flies.
        cf.commander.send_setpoint = _nothing
        cf.incoming.stop()
        cf.close_link()
        for thread in threads:
            if thread is not None and thread.is_alive():
                thread.join(3.0)

    def _log(self) -> None:
        from cflib.crazyflie.log import LogConfig

        block = LogConfig("status", PERIOD)
        for name in LOGGED:
            if self._cf.log.toc.get_element(*name.split(".")):
                block.add_variable(name)
        block.data_received_cb.add_callback(self._hear)
        self._heard = time.monotonic()
        self._cf.log.add_config(block)
        block.start()

    def _hear(self, _: int, data: dict[str, Any], __: object) -> None:
        self._status = said(data)
        self._heard = time.monotonic()

    def _run(self) -> None:
        while True:
            self._news.wait()
            self._news.clear()
            if self._closed:
                return
            if self._latest is not None:
                try:
                    self._tell(*self._latest)
                except Exception:  # of cflib; the next command is told all the same
                    self._lost = True

    def _tell(self, command: DroneCommand, now: float) -> None:
        commander, mode = self._cf.commander, command.mode
        if not command.hover:
            self._cf.extpos.send_extpos(*command.position)
        if mode in (Mode.DISARMED, Mode.READY):
            self._place(command)
            # Set-points that cease within 2 s of a landing lock the firmware until it is restarted.
            commander.send_stop_setpoint()
        elif mode is Mode.EMERGENCY:
            commander.send_stop_setpoint()
            self._cf.supervisor.send_emergency_stop()
        elif self._landed(command, now - self._before):
            commander.send_stop_setpoint()
        else:
            self._placed = False
            if mode is Mode.TAKING_OFF:
                self._arm(now)
            commander.send_velocity_world_setpoint(*flown(command), 0.0)
        self._before = now

    def _arm(self, now: float) -> None:
        if not self._status.flying and now - self._asked >= ARMING:
            self._asked = now
            self._cf.supervisor.send_arming_request(True)

    def _landed(self, command: DroneCommand, elapsed: float) -> bool:
        """Whether it has come down: its motors push on against the floor, so it does not know."""
        if command.mode is Mode.LANDING:
            self._height += command.velocity[2] * min(elapsed, 0.1)
            below = not command.hover and command.position[2] < FLOOR
            return below or self._height < -OVERSHOOT
        if not command.hover:
            self._height = command.position[2]
        return False

    def _place(self, command: DroneCommand) -> None:
        """Start its estimator where it stands: positions alone do not tell it its yaw."""
        if self._placed or command.hover:
            return
        self._placed = True
        for axis, value in zip("XYZ", command.position, strict=True):
            self._set(f"kalman.initial{axis}", value)
        self._set("kalman.initialYaw", command.yaw)
        self._set("kalman.resetEstimation", 1)
        self._set("kalman.resetEstimation", 0)

    def _set(self, name: str, value: float | int) -> None:
        if self._cf.param.toc.get_element(*name.split(".")):
            self._cf.param.set_value(name, value)


def flown(command: DroneCommand) -> tuple[float, float, float]:
    """The velocity in m/s that is flown: nobody sees it, so it stands still or sinks."""
    x, y, z = command.velocity
    if not command.hover:
        return x, y, z
    return 0.0, 0.0, z if command.mode is Mode.LANDING else 0.0


def said(data: Mapping[str, float | int]) -> Status:
    """What a log packet says, of old firmware (`sys`) or new (`supervisor`)."""
    info = int(data.get("supervisor.info", 0))
    info |= FLYING * bool(data.get("sys.isFlying")) | TUMBLED * bool(data.get("sys.isTumbled"))
    battery = None
    if "pm.batteryLevel" in data:
        battery = data["pm.batteryLevel"] / 100.0
    elif "pm.vbat" in data:
        battery = min(1.0, max(0.0, (data["pm.vbat"] - EMPTY) / (FULL - EMPTY)))
    return Status(battery, bool(info & FLYING), bool(info & (TUMBLED | LOCKED | CRASHED)))


def _nothing(*_: object) -> None:
    pass


def _crazyflie() -> Any:
    try:
        from cflib import crtp
        from cflib.crazyflie import Crazyflie
    except ImportError as missing:
        raise Refusal("a Crazyflie needs cflib; run: pip install 'skydog[crazyflie]'") from missing
    logging.getLogger("cflib").addHandler(logging.NullHandler())
    if not crtp.CLASSES:
        crtp.init_drivers()
    cf: Any = Crazyflie()
    # Its pings wait for the lock that a broken link holds while it waits for them: a deadlock.
    cf.link_statistics.start = _nothing
    return cf

"""An emulated Crazyflie: CRTP over UDP as cflib's udp:// link speaks it, one packet a datagram.

It is as strict as the firmware (`supervisor.c`, `commander.c`, `crtp_commander_generic.c` and
`log.c`), of a model that has to be armed: set-points older than 0.5 s level it out, older than 2 s
lock it, and a locked one is restarted by hand.
"""

import errno
import math
import socket
import struct
import threading
import time
import zlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import NamedTuple

from skydog.lab.adapters import Vector
from skydog.lab.emulation.drivers import Flown, Shown

PROTOCOL = 12  # of CRTP: the first with the supervisor's port
LARGEST = 31  # bytes of a packet, its header among them
LEVELS_OUT = 0.5  # s, the age of a set-point; COMMANDER_WDT_TIMEOUT_STABILIZE
STOPS = 2.0  # s; COMMANDER_WDT_TIMEOUT_SHUTDOWN
LANDED = 2.0  # s without thrust; IS_FLYING_HYSTERESIS_THRESHOLD
TUMBLED = 1.0  # s tilted by more than 60 degrees; SUPERVISOR_TUMBLE_CHECK_ACCEPTED_TILT_TIME
GAIN = 2.0  # 1/s, of the position; posCtlPid.xKp
FASTEST = 1.0  # m/s of a position set-point; posCtlPid.xVelMax
EMPTY, FULL = 3.0, 4.2  # V
BLOCKS, VARIABLES, PAYLOAD = 16, 128, 26  # of the log: blocks, variables, bytes of a block
IDLE = 0.1  # s between two looks at whether it is closed

# Ports of CRTP.
CONSOLE, PARAM, RPYT, MEMORY, LOG, LOCALIZATION, GENERIC = 0, 2, 3, 4, 5, 6, 7
HIGH_LEVEL, SUPERVISOR, PLATFORM, LINK = 8, 9, 13, 15

# What it logs and its parameters, with the struct format of each, and the number of that type.
STATE = ("x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "yaw")
LOGGED = {"pm.vbat": "f", "pm.batteryLevel": "B", "supervisor.info": "H"}
LOGGED |= {"sys.isFlying": "B", "sys.isTumbled": "B"}
LOGGED |= {f"stateEstimate.{name}": "f" for name in STATE}
LOG_TYPES = {"B": 1, "H": 2, "f": 7}
PARAMETERS = {"stabilizer.estimator": "B", "stabilizer.stop": "B", "commander.enHighLevel": "B"}
PARAMETERS |= {f"kalman.initial{name}": "f" for name in ("X", "Y", "Z", "Yaw")}
PARAMETERS |= {"kalman.resetEstimation": "B"}
PARAM_TYPES = {"B": 0x08, "f": 0x06}

Setpoint = Callable[[Shown, float], Flown | None]  # at a time; None stops the motors


class Block(NamedTuple):
    """A block of the log: its variables, by their places in the table, and when it is sent."""

    variables: tuple[int, ...]
    period: float = 0.0  # s; 0 is stopped
    due: float = 0.0  # s


class Plan(NamedTuple):
    """A flight of the high-level commander."""

    start: Vector  # m
    goal: Vector
    began: float  # s
    duration: float
    lands: bool


class CrazyflieDriver:
    """An emulated Crazyflie, of the address `uri` on loopback.

    `external` is the latest position in metres that it was told, `parameters` are its parameters.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._shown = Shown((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
        self._now = 0.0  # s, of the latest step
        self._streamed: Setpoint | None = None  # None: the high-level commander has it
        self._plan: Plan | None = None
        self._arrived = False  # a set-point since the last step
        self._stamp = self._thrust = -math.inf  # s: of the set-point, of the latest thrust
        self._upright: float | None = None  # s
        self._armed = self._flying = self._tumbled = self._locked = False
        self._blocks: dict[int, Block] = {}
        self._peer: tuple[str, int] | None = None
        self._began = time.monotonic()
        self.external: Vector | None = None
        self.parameters: dict[str, float | int] = dict.fromkeys(PARAMETERS, 0)
        self._ports: dict[int, Callable[[int, bytes], Iterable[bytes]]] = {
            PARAM: self._param,
            RPYT: self._rpyt,
            MEMORY: lambda channel, data: [data[:1] + b"\0"],
            LOG: self._log,
            LOCALIZATION: self._localization,
            GENERIC: self._generic,
            HIGH_LEVEL: self._high_level,
            SUPERVISOR: self._supervisor,
            PLATFORM: self._platform,
            LINK: _link,
        }
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.uri = f"udp://127.0.0.1:{self._socket.getsockname()[1]}"
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=self.uri, daemon=True)
        self._thread.start()

    def step(self, shown: Shown, now: float) -> Flown | None:
        """What is flown in the next hundredth of a second; None when its motors are off."""
        with self._lock:
            self._shown, self._now = shown, now
            if self._arrived or self._streamed is None:
                self._arrived, self._stamp = False, now
            age = now - self._stamp
            flown = (self._streamed or self._planned)(shown, now)
            self._supervise(now, age, flown is not None)
            if flown is None or not self._armed:
                return None
            if age > LEVELS_OUT:
                return Flown((0.0, 0.0, flown.velocity[2]), (0.0, 0.0))
            return flown

    def close(self) -> None:
        """Let go of the socket and the thread."""
        self._closed.set()
        self._thread.join()
        self._socket.close()

    # The firmware's supervisor.

    def _supervise(self, now: float, age: float, pushes: bool) -> None:
        roll, pitch, _ = self._shown.attitude
        if self._upright is None or math.cos(roll) * math.cos(pitch) > 0.5:
            self._upright = now
        self._tumbled = now - self._upright > TUMBLED
        if self._armed and pushes:
            self._thrust, self._flying = now, True
        if self._flying and (age > STOPS or self._tumbled):
            self._stop()
        elif self._flying and age <= LEVELS_OUT and now - self._thrust > LANDED:
            self._flying = self._armed = False
        elif self._tumbled:
            self._armed = False

    def _stop(self) -> None:
        """Cut the motors until it is restarted."""
        if not self._locked:
            self._send(CONSOLE, 0, b"SUP: Locked, reboot required\n")
        self._armed, self._flying, self._locked = False, False, True

    def _info(self) -> int:
        ready = not (self._armed or self._locked or self._tumbled)
        bits = (ready, self._armed, False, self._armed, self._flying, self._tumbled, self._locked)
        return sum(bit << i for i, bit in enumerate(bits))

    def _planned(self, shown: Shown, now: float) -> Flown | None:
        """What the high-level commander flies: a smooth path, and back onto it."""
        if self._plan is None:
            return None
        start, goal, began, duration, lands = self._plan
        t = min(1.0, (now - began) / duration)
        if lands and t == 1.0:
            self._plan = None
            return None
        share, rate = t**3 * (10 - 15 * t + 6 * t**2), 30 * (t * (1 - t)) ** 2 / duration
        x, y, z = (a + share * (b - a) for a, b in zip(start, goal, strict=True))
        vx, vy, vz = (rate * (b - a) for a, b in zip(start, goal, strict=True))
        return _to(shown, (x, y, z), (vx, vy, vz))

    # What comes, port by port: each answers with the data of packets of the same header.

    def _generic(self, channel: int, data: bytes) -> Iterable[bytes]:
        if channel == 0:
            self._streamed, self._plan, self._arrived = setpoint(data), None, True
        elif channel == 1 and data[0] == 0:
            self._streamed = None
        return ()

    def _rpyt(self, channel: int, data: bytes) -> Iterable[bytes]:
        # Only its thrust of zero is flown: no radio control here.
        if channel == 0 and _unpack("<fffH", data)[3] == 0:
            return self._generic(0, b"\0")
        return ()

    def _high_level(self, channel: int, data: bytes) -> Iterable[bytes]:
        here = self._shown.position
        if data[0] == 3:  # stop
            self._plan = None
        elif data[0] in (7, 8):  # take-off and landing, of a duration
            _, height, _, _, duration = _unpack("<Bff?f", data[1:])
            goal = (here[0], here[1], height)
            self._plan = Plan(here, goal, self._now, max(duration, 0.1), data[0] == 8)
        elif data[0] in (4, 12):  # go to
            form = "<BBfffff" if data[0] == 4 else "<BBBfffff"
            *flags, x, y, z, _, duration = _unpack(form, data[1:])
            if flags[1]:
                x, y, z = x + here[0], y + here[1], z + here[2]
            self._plan = Plan(here, (x, y, z), self._now, max(duration, 0.1), False)
        return [data[:3].ljust(3, b"\0") + b"\0"]

    def _localization(self, channel: int, data: bytes) -> Iterable[bytes]:
        if channel == 0:
            self.external = _unpack("<fff", data)
        elif channel == 1 and data[0] == 8:
            self.external = _unpack("<fffffff", data[1:])[:3]
        elif channel == 1 and data[0] == 3:
            self._stop()
        return ()

    def _supervisor(self, channel: int, data: bytes) -> Iterable[bytes]:
        if channel == 0 and data[0] == 0x0C:
            return [struct.pack("<BH", 0x8C, self._info())]
        if channel == 1 and data[0] == 1:
            return [b"\x81" + self._arm(bool(data[1]))]
        if channel == 1 and data[0] == 3:
            self._stop()
        return ()

    def _arm(self, wanted: bool) -> bytes:
        done = not (wanted and (self._locked or self._tumbled))
        if done:
            self._armed = wanted
        return bytes([done, self._armed])

    def _platform(self, channel: int, data: bytes) -> Iterable[bytes]:
        if channel == 0 and data[0] == 1:  # as it was before protocol 12
            self._arm(bool(data[1]))
        if channel == 1 and data[0] == 0:
            return [struct.pack("<Bi", 0, PROTOCOL)]
        return ()

    def _param(self, channel: int, data: bytes) -> Iterable[bytes]:
        if channel == 0:
            return _table(PARAMETERS, PARAM_TYPES, data, b"")
        index = data[:2]
        name, form = list(PARAMETERS.items())[_unpack("<H", index)[0]]
        if channel == 1:
            return [index + b"\0" + struct.pack("<" + form, self.parameters[name])]
        if channel == 2:
            (self.parameters[name],) = _unpack("<" + form, data[2:])
            if self.parameters["stabilizer.stop"]:
                self._stop()
            return [data]
        return ()

    def _log(self, channel: int, data: bytes) -> Iterable[bytes]:
        if channel == 0:
            return _table(LOGGED, LOG_TYPES, data, bytes([BLOCKS, VARIABLES]))
        return [data[:2].ljust(2, b"\0") + bytes([self._block(data)])] if channel == 1 else ()

    def _block(self, data: bytes) -> int:
        """Obey a command on a block of the log; returns 0, or what was wrong."""
        command, name = data[0], data[1] if len(data) > 1 else 0
        block = self._blocks.get(name)
        if command == 5:  # reset
            self._blocks.clear()
        elif command == 6 and block is not None:
            return errno.EEXIST
        elif command == 6 and len(self._blocks) == BLOCKS:
            return errno.ENOMEM
        elif command == 6:  # create
            return self._fill(name, Block(()), data[2:])
        elif block is None:
            return errno.ENOENT
        elif command == 7:  # append
            return self._fill(name, block, data[2:])
        elif command == 2:  # delete
            del self._blocks[name]
        elif command == 3:  # start
            period = 0.01 * _unpack("<B", data[2:])[0]
            self._blocks[name] = block._replace(period=period, due=time.monotonic() + period)
        elif command == 4:  # stop
            self._blocks[name] = block._replace(period=0.0)
        else:
            return errno.ENOEXEC
        return 0

    def _fill(self, name: int, block: Block, data: bytes) -> int:
        forms = list(LOGGED.values())
        for kind, index in struct.iter_unpack("<BH", data):
            # The firmware converts to the type that is asked for; here it has to be its own.
            if index >= len(forms) or kind & 0x0F != LOG_TYPES[forms[index]]:
                return errno.ENOENT
            block = block._replace(variables=(*block.variables, index))
        if struct.calcsize("<" + "".join(forms[index] for index in block.variables)) > PAYLOAD:
            return errno.E2BIG
        self._blocks[name] = block
        return 0

    def _logged(self) -> list[bytes]:
        position, velocity, attitude, battery = self._shown
        power = (EMPTY + battery * (FULL - EMPTY), round(100.0 * battery))
        state = (*position, *velocity, *(math.degrees(angle) for angle in attitude))
        values = (*power, self._info(), self._flying, self._tumbled, *state)
        return [struct.pack("<" + form, x) for form, x in zip(LOGGED.values(), values, strict=True)]

    # The socket.

    def _serve(self) -> None:
        while not self._closed.is_set():
            with self._lock:
                wait = self._send_log(time.monotonic())
            self._socket.settimeout(wait)
            try:
                packet, self._peer = self._socket.recvfrom(2048)
            except OSError:  # nothing came, or a peer has gone
                continue
            with self._lock:
                self._hear(packet)

    def _hear(self, packet: bytes) -> None:
        if not 0 < len(packet) <= LARGEST or packet[0] >> 4 not in self._ports:
            return
        port, channel = packet[0] >> 4, packet[0] & 3
        with suppress(struct.error, IndexError, ValueError):  # it is not what it says it is
            for answer in self._ports[port](channel, packet[1:]):
                self._send(port, channel, answer)

    def _send(self, port: int, channel: int, data: bytes) -> None:
        if self._peer is not None:
            with suppress(OSError):  # the peer has gone
                self._socket.sendto(bytes([port << 4 | channel]) + data, self._peer)

    def _send_log(self, now: float) -> float:
        """Send the blocks that are due; returns the seconds until the next."""
        for name, block in self._blocks.items():
            if block.period and block.due <= now:
                self._blocks[name] = block._replace(due=now + block.period)
                passed = int(1000 * (now - self._began)) & 0xFFFFFF
                values = self._logged()
                data = b"".join(values[index] for index in block.variables)
                self._send(LOG, 2, bytes([name]) + struct.pack("<I", passed)[:3] + data)
        waits = [block.due - now for block in self._blocks.values() if block.period]
        return max(0.001, min([IDLE, *waits]))


def setpoint(data: bytes) -> Setpoint:
    """A set-point of the generic commander. ValueError or struct.error: it is none."""
    kind, rest = data[0], data[1:]
    if kind == 0:
        return _off
    if kind in (1, 8):  # velocity in the world
        vx, vy, vz, _ = _unpack("<ffff", rest)
        return lambda shown, now: Flown((vx, vy, vz))
    if kind in (5, 10):  # hover: velocity in the body's frame, and height
        ahead, left, _, height = _unpack("<ffff", rest)
        return lambda shown, now: _hover(shown, ahead, left, height)
    if kind == 7:  # position
        x, y, z, _ = _unpack("<ffff", rest)
        return lambda shown, now: _to(shown, (x, y, z))
    if kind == 6:  # full state, in millimetres
        x, y, z, vx, vy, vz, *_ = (0.001 * value for value in _unpack("<hhhhhhhhhIhhh", rest))
        return lambda shown, now: _to(shown, (x, y, z), (vx, vy, vz))
    raise ValueError(f"no set-point of type {kind}")


def _off(shown: Shown, now: float) -> Flown | None:
    return None


def _hover(shown: Shown, ahead: float, left: float, height: float) -> Flown:
    (x, y, _), yaw = shown.position, shown.attitude[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    return _to(shown, (x, y, height), (cos * ahead - sin * left, sin * ahead + cos * left, 0.0))


def _to(shown: Shown, goal: Vector, velocity: Vector = (0.0, 0.0, 0.0)) -> Flown:
    """A velocity towards a goal, on top of one that is given."""
    gaps = (GAIN * (to - at) for to, at in zip(goal, shown.position, strict=True))
    x, y, z = (v + max(-FASTEST, min(FASTEST, gap)) for v, gap in zip(velocity, gaps, strict=True))
    return Flown((x, y, z))


def _unpack(form: str, data: bytes) -> tuple:
    """The numbers that a packet holds, all of them finite."""
    values = struct.unpack(form, data)
    if not all(math.isfinite(value) for value in values):
        raise ValueError("a number is not finite")
    return values


def _table(
    entries: dict[str, str], types: dict[str, int], data: bytes, limits: bytes
) -> Iterable[bytes]:
    """A table of contents, of version 2: how many entries and a checksum, or one entry."""
    if data[0] == 3:
        checksum = zlib.crc32(repr(entries).encode())
        return [struct.pack("<BHI", 3, len(entries), checksum) + limits]
    if data[0] == 2:
        name, form = list(entries.items())[_unpack("<H", data[1:])[0]]
        return [data + bytes([types[form]]) + name.replace(".", "\0").encode() + b"\0"]
    return ()


def _link(channel: int, data: bytes) -> Iterable[bytes]:
    if channel == 0:
        return [data]
    return [b"Bitcraze Crazyflie".ljust(30, b"\0")] if channel == 1 else ()

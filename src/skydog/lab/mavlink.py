"""Drones that run PX4 or ArduPilot, told by MAVLink (pymavlink, LGPL-3).

Frames: the world's y axis is taken as north. The autopilot must therefore take its heading from
motion capture and not from a compass (PX4: EKF2_EV_CTRL 11 and EKF2_HGT_REF 3; ArduPilot:
VISO_TYPE 1, EK3_SRC1_POSXY, POSZ and YAW 6, and an EKF origin that was set once).
MAVLink here is neither signed nor encrypted: let nobody else into its network.
"""

import math
import os
import select
import socket
import struct
import termios
import threading
import time
import tty
from typing import Any, NamedTuple

from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab.adapters import DroneCommand, Status, Vector

try:
    from pymavlink.dialects.v20 import common as mavlink
except ImportError as missing:
    raise Refusal("MAVLink needs pymavlink; run: pip install 'skydog[mavlink]'") from missing

PATIENCE = 10.0  # s until somebody must have sent a HEARTBEAT
SILENCE = 3.0  # s without a HEARTBEAT, which comes at 1 Hz, until a system counts as gone
POSES = 0.02  # s between poses: PX4 asks for 30 to 50 Hz
SETPOINTS = 0.04  # s: both streams then fit into a radio of 57,600 baud
ORDERS = 0.5  # s between repetitions of a command
STATION = (254, mavlink.MAV_COMP_ID_MISSIONPLANNER)  # our system and component: a ground station
FORCE = 21196.0  # MAV_CMD_COMPONENT_ARM_DISARM's second parameter: disarm in flight too
VELOCITY_AND_YAW = 0b1001_1100_0111  # ignored: position, acceleration, yaw rate
STILL = (0.0, 0.0, 0.0)
LOST = (mavlink.MAV_STATE_EMERGENCY, mavlink.MAV_STATE_FLIGHT_TERMINATION)
COPTERS = (2, 3, 4, 13, 14, 15)  # of MAV_TYPE: four, six, eight, three rotors; coaxial; helicopter


class Autopilot(NamedTuple):
    """How an autopilot obeys velocities."""

    guided: tuple[float, float]  # MAV_CMD_DO_SET_MODE's mode and sub-mode
    custom_mode: int  # the same in a HEARTBEAT
    climbs: bool  # takes off by MAV_CMD_NAV_TAKEOFF, not by velocities
    obeys: tuple[Mode, ...]  # when set-points are sent


# OFFBOARD engages only after a second of set-points; of ArduPilot they would end the take-off.
FREE = (Mode.MISSION, Mode.HOLD)
PX4 = Autopilot((6.0, 0.0), 6 << 16, False, (Mode.READY, Mode.TAKING_OFF, *FREE, Mode.LANDING))
ARDUPILOT = Autopilot((4.0, 0.0), 4, True, FREE)
AUTOPILOTS = {mavlink.MAV_AUTOPILOT_PX4: PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: ARDUPILOT}


def ned(vector: Vector, yaw: float) -> tuple[Vector, float]:
    """A vector and a yaw of the world's frame in MAVLink's, north-east-down; or the other way.

    Half a turn about the axis between x and y, and so its own inverse. The heading is in radians
    from north, clockwise, within ±π.
    """
    x, y, z = vector
    return (y, x, -z), math.remainder(math.pi / 2 - yaw, math.tau)


class MavlinkDrone:
    """A drone that speaks MAVLink.

    `uri` is udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/TTY[,BAUD], as pymavlink
    writes them. The constructor waits for the HEARTBEAT of a multicopter of PX4 or ArduPilot.

    Take-off: the mode (OFFBOARD or GUIDED), then arm, then climb; each is repeated until the
    drone shows it. PX4 climbs by the command's velocity, ArduPilot by itself to the height of its
    set-point. Whoever takes the mode from us afterwards, such as a safety pilot, keeps it; only a
    landing is commanded whatever the mode. It holds the heading that it took off with.

    A drone that is to hover is sent zero velocity and no pose: if its own estimate runs out, its
    own fail-safe counts. Refuses what is not a link, or where no such drone answers.
    """

    def __init__(self, name: str, uri: str):
        self.name = name
        self.complaint = ""  # why it refused the latest command, in its own words
        self._link = Link(uri)
        self._packer = mavlink.MAVLink(None, *STATION)
        self._lock = threading.Lock()  # packing counts the messages, in two threads
        self._vehicle: tuple[int, int] | None = None
        self._autopilot: Autopilot | None = None
        self._seen = threading.Event()
        self._closed = threading.Event()
        self._stranger = ""
        self._sender = ""
        self._heartbeat, self._armed, self._custom_mode, self._state = -math.inf, False, 0, 0
        self._landed = mavlink.MAV_LANDED_STATE_UNDEFINED
        self._battery: float | None = None
        self._others: dict[str, float] = {}
        self._mode, self._entered = Mode.DISARMED, -math.inf
        self._engaged = self._climbing = False
        self._heading = 0.0
        self._poses, self._setpoints, self._orders = Rate(POSES), Rate(SETPOINTS), Rate(ORDERS)
        self._thread = threading.Thread(target=self._listen, name=f"mavlink {name}", daemon=True)
        self._thread.start()
        if not self._seen.wait(PATIENCE):
            self.close()
            raise Refusal(
                f"{name}: no HEARTBEAT of a PX4 or ArduPilot multicopter at {uri} in {PATIENCE:g} s"
                f"{self._stranger}; check its power, the port or baud rate, and that it sends to us"
            )

    def send(self, command: DroneCommand, now: float) -> None:
        """Tell it: poses at 50 Hz, set-points at 25 Hz, commands every half second."""
        autopilot = self._autopilot
        if autopilot is None or self._closed.is_set():
            return
        if command.mode != self._mode:
            self._mode, self._entered = command.mode, now
            self._engaged = self._climbing = False
            self._orders = Rate(ORDERS)
        place, heading = ned(command.position, command.yaw)
        if command.mode in (Mode.DISARMED, Mode.READY):
            self._heading = heading
        if not command.hover and self._poses.due(now):
            self._tell_pose(place, heading, now)
        if command.mode in autopilot.obeys and self._setpoints.due(now):
            still = command.hover or command.mode is Mode.READY
            self._tell_velocity(STILL if still else command.velocity, now)
        if self._orders.due(now):
            self._order(autopilot, command)

    def status(self) -> Status:
        """The latest that it said. CRITICAL is no emergency: it still flies, in its fail-safe."""
        return Status(
            battery=self._battery,
            flying=self._armed and self._landed != mavlink.MAV_LANDED_STATE_ON_GROUND,
            emergency=self._state in LOST,
            connected=self._fresh(self._heartbeat),
        )

    def others(self) -> tuple[str, ...]:
        """Other ground stations, or drones of the same number, heard on this link lately."""
        return tuple(sorted(name for name, at in self._others.copy().items() if self._fresh(at)))

    def close(self) -> None:
        """Let go of the link and its thread. The drone is not landed."""
        self._closed.set()
        self._thread.join(timeout=2.0)
        self._link.close()

    def _order(self, autopilot: Autopilot, command: DroneCommand) -> None:
        if command.mode is Mode.EMERGENCY:
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, FORCE)
        elif command.mode is Mode.LANDING:
            # A HEARTBEAT from before may say disarmed of a drone that has just armed.
            if self._armed or self._heartbeat <= self._entered:
                self._command(mavlink.MAV_CMD_NAV_LAND)
        elif command.mode is Mode.TAKING_OFF:
            guided = self._custom_mode == autopilot.custom_mode
            self._engaged |= guided and self._armed
            if not self._engaged and not guided:
                self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, *autopilot.guided)
            elif not self._engaged:
                self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            elif autopilot.climbs and guided and not self._climbing:
                height = command.setpoint[2] - command.position[2]  # above the place it stands on
                self._command(mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height)

    def _command(self, number: int, *parameters: float) -> None:
        if self._vehicle is not None:
            values = (*parameters, *(0.0,) * (7 - len(parameters)))
            self._tell(mavlink.MAVLink_command_long_message(*self._vehicle, number, 0, *values))

    def _tell_pose(self, place: Vector, heading: float, now: float) -> None:
        if not all(map(math.isfinite, (*place, heading))):
            return
        unknown = [math.nan] + [0.0] * 20  # the covariance: the autopilot's own parameters count
        pose = (*place, 0.0, 0.0, heading)
        self._tell(mavlink.MAVLink_vision_position_estimate_message(int(1e6 * now), *pose, unknown))

    def _tell_velocity(self, velocity: Vector, now: float) -> None:
        if self._vehicle is None or not all(map(math.isfinite, velocity)):
            return
        stamp, frame = int(1000 * now) & 0xFFFFFFFF, mavlink.MAV_FRAME_LOCAL_NED
        to = (stamp, *self._vehicle, frame, VELOCITY_AND_YAW)
        target = (*STILL, *ned(velocity, 0.0)[0], *STILL, self._heading, 0.0)
        self._tell(mavlink.MAVLink_set_position_target_local_ned_message(*to, *target))

    def _tell(self, message: Any) -> None:
        try:
            with self._lock:
                self._packer.seq = (self._packer.seq + 1) % 256
                packet = bytes(message.pack(self._packer))
            self._link.write(packet)
        except (struct.error, OverflowError):
            return  # a number beyond a float32: the drone's own time-out counts

    def _listen(self) -> None:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        beats = Rate(1.0)
        while not self._closed.is_set():
            if beats.due(time.monotonic()):
                self._greet()
            data, sender = self._link.read(0.1)
            for message in parsed(parser, data, keep=not self._link.datagrams):
                self._hear(message, sender, time.monotonic())

    def _greet(self) -> None:
        active, none = mavlink.MAV_STATE_ACTIVE, mavlink.MAV_AUTOPILOT_INVALID
        self._tell(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, none, 0, 0, active, 3))
        # ArduPilot sends neither before it is asked.
        interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        if self._landed == mavlink.MAV_LANDED_STATE_UNDEFINED:
            self._command(interval, float(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE), 2e5)
        if self._battery is None:
            self._command(interval, float(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS), 1e6)

    def _hear(self, message: Any, sender: str, now: float) -> None:
        kind, source = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
        if kind == "HEARTBEAT" and source != STATION and message.type == mavlink.MAV_TYPE_GCS:
            self._meet(f"ground station {source[0]}/{source[1]}", now)
        if self._vehicle is None and kind == "HEARTBEAT":
            self._choose(message, source)
        if source != self._vehicle:
            return
        if sender != self._sender and self._fresh(self._heartbeat):
            self._meet(f"drone {source[0]}/{source[1]} at {sender}", now)
            return
        if kind == "HEARTBEAT":
            self._sender = sender
            self._link.answer(sender)
            self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self._custom_mode, self._state = message.custom_mode, message.system_status
            self._heartbeat = now
            self._seen.set()
        elif kind == "EXTENDED_SYS_STATE":
            self._landed = message.landed_state
        elif kind in ("BATTERY_STATUS", "SYS_STATUS") and 0 <= message.battery_remaining <= 100:
            self._battery = message.battery_remaining / 100
        elif kind == "COMMAND_ACK":
            self._acknowledge(message.command, message.result)
        elif kind == "STATUSTEXT" and message.severity <= mavlink.MAV_SEVERITY_ERROR:
            self.complaint = "".join(filter(str.isprintable, message.text))

    def _choose(self, heartbeat: Any, source: tuple[int, int]) -> None:
        autopilot = AUTOPILOTS.get(heartbeat.autopilot)
        if autopilot is not None and heartbeat.type in COPTERS:
            self._autopilot, self._vehicle = autopilot, source
        elif heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            kind = _title("MAV_AUTOPILOT", heartbeat.autopilot), _title("MAV_TYPE", heartbeat.type)
            self._stranger = f" (only of {' '.join(kind)})"

    def _acknowledge(self, command: int, result: int) -> None:
        accepted = result in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS)
        if accepted and command == mavlink.MAV_CMD_NAV_TAKEOFF:
            self._climbing = True
        elif not accepted and command != mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            self.complaint = f"{_title('MAV_CMD', command)}: {_title('MAV_RESULT', result)}"

    def _meet(self, name: str, now: float) -> None:
        self._others.pop(name, None)
        self._others[name] = now
        if len(self._others) > 16:
            del self._others[next(iter(self._others))]

    def _fresh(self, at: float) -> bool:
        return time.monotonic() - at < SILENCE


class Rate:
    """Something that is due every `period` seconds on average, and at once the first time."""

    def __init__(self, period: float):
        self._period, self._next = period, -math.inf

    def due(self, now: float) -> bool:
        """Whether it is due; then it counts as done."""
        if now < self._next:
            return False
        # Half a period late at most is made good: calls at 100 Hz still give 50 and 25 Hz.
        self._next = max(self._next, now - self._period / 2) + self._period
        return True


class Link:
    """Bytes to and from one drone: UDP, TCP or a serial line. Neither waits nor raises in use."""

    def __init__(self, uri: str):
        scheme, _, rest = uri.partition(":")
        self._peer: tuple[str, int] | None = None
        self._socket: socket.socket | None = None
        self._gone, self._listens = False, scheme == "udpin"
        self.datagrams = scheme in ("udpin", "udpout")
        try:
            if scheme in ("udpin", "udpout", "tcp"):
                host, _, port = rest.rpartition(":")
                address = (socket.gethostbyname(host), int(port))
                kind = socket.SOCK_DGRAM if self.datagrams else socket.SOCK_STREAM
                self._socket = socket.socket(socket.AF_INET, kind)
                self._socket.settimeout(5.0)
                if self._listens:
                    self._socket.bind(address)
                else:
                    self._socket.connect(address)
                self._socket.setblocking(False)
                self._file = self._socket.fileno()
            elif uri.startswith("/dev/"):
                self._file = _serial(uri)
            else:
                raise ValueError("it is none of them")
        except (OSError, ValueError, OverflowError, AttributeError, termios.error) as error:
            if self._socket is not None:
                self._socket.close()
            raise Refusal(
                f"cannot open {uri!r} ({error}); write udpin:127.0.0.1:14540, udpout:HOST:PORT,"
                " tcp:HOST:PORT or /dev/ttyACM0,115200"
            ) from error

    def read(self, patience: float) -> tuple[bytes, str]:
        """What came, at most 64 KiB, and from whom; nothing after so many seconds."""
        try:
            if self._gone:
                time.sleep(patience)
            elif select.select([self._file], [], [], patience)[0]:
                if self._socket is None:
                    data, sender = os.read(self._file, 65535), ""
                else:
                    data, address = self._socket.recvfrom(65535)
                    sender = f"{address[0]}:{address[1]}" if address else ""
                self._gone = not data and not self.datagrams
                return data, sender
        except (OSError, ValueError):
            self._gone = not self.datagrams  # of UDP it only says that nobody listens yet
            time.sleep(0.01)  # so that a network that is down does not keep a core busy
        return b"", ""

    def write(self, data: bytes) -> None:
        """Send it, or drop it where there is no room or nobody to send it to."""
        try:
            if self._gone:
                return
            if self._socket is None:
                os.write(self._file, data)
            elif not self._listens:
                self._socket.send(data)
            elif self._peer is not None:
                self._socket.sendto(data, self._peer)
        except OSError:
            return

    def answer(self, sender: str) -> None:
        """Write to whoever that was: a bound socket knows no drone before it has heard one."""
        host, _, port = sender.rpartition(":")
        self._peer = (host, int(port)) if sender else None

    def close(self) -> None:
        """Let go. May be called twice."""
        if self._socket is not None:
            self._socket.close()
        elif self._file >= 0:
            os.close(self._file)
        self._file, self._gone = -1, True


def parsed(parser: Any, data: bytes, keep: bool) -> list[Any]:
    """The whole messages in some bytes, whatever else is in them.

    `keep` what is left of a stream, at most one message. A datagram's rest is dropped: its next
    one starts afresh.
    """
    try:
        messages = parser.parse_buffer(data) or []
    except Exception:  # a parser of bytes from outside: no fault of it ends the flight
        messages, keep = [], False
    parser.buf = parser.buf[parser.buf_index :] if keep else bytearray()
    parser.buf_index = 0
    return [m for m in messages if m.get_msgId() >= 0]  # below: bad data, unknown messages


def _serial(uri: str) -> int:
    path, _, baud = uri.partition(",")
    speed = getattr(termios, f"B{int(baud or 115200)}")
    file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        tty.setraw(file)
        attributes = termios.tcgetattr(file)
        attributes[4] = attributes[5] = speed
        termios.tcsetattr(file, termios.TCSANOW, attributes)
    except termios.error:
        os.close(file)
        raise
    return file


def _title(enum: str, number: int) -> str:
    entry = mavlink.enums[enum].get(number)
    return entry.name if entry else f"{enum} {number}"

"""An emulated PX4 or ArduPilot copter: it speaks MAVLink over UDP on loopback (pymavlink)."""

import contextlib
import math
import select
import socket
import threading
import time
from typing import Any, Literal

import numpy as np

from skydog.lab.adapters import Vector
from skydog.lab.emulation.drivers import Flown, Shown
from skydog.lab.mavlink import mavlink, parsed

PROOF = 1.0  # s of set-points before OFFBOARD engages (PX4)
GAP = 0.5  # s: a longer pause between set-points starts that second afresh (PX4: 2 Hz)
LOSS = {"px4": 1.0, "ardupilot": 3.0}  # s: COM_OF_LOSS_T, then it lands; GUID_TIMEOUT, it stops
STATION_LOSS = 5.0  # s without a ground station's HEARTBEAT (ArduPilot's FS_GCS_TIMEOUT): it lands
BLIND = 5.0  # s without a pose until it lands (PX4's EKF2_NOAID_TOUT)
FRESH = 0.5  # s: it arms only with a pose no older
GATE, HEADING_GATE = 1.0, 0.5  # m, rad: a pose that is further from its own is not believed
CLIMB, DESCENT = 0.5, 0.5  # m/s
AIRBORNE = 0.1  # m above the place where it armed
SETTLED = 1.0  # s without sinking while it lands: it stands on the ground
SYSTEM = (1, 1)
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # rows: north, east, down
MODES = {  # as DO_SET_MODE asks for it, as a HEARTBEAT shows it
    "px4": {"guided": ((6, 0), 6 << 16), "land": ((4, 6), 4 << 16 | 6 << 24),
            "hold": ((4, 3), 4 << 16 | 3 << 24)},
    "ardupilot": {"guided": ((4, 0), 4), "land": ((9, 0), 9), "hold": ((5, 0), 5)},
}  # fmt: skip


class MavlinkDriver:
    """The vehicle's end: `uri` is what a `MavlinkDrone` connects to.

    It has a vehicle's caution: OFFBOARD (PX4) engages only after a second of set-points, it arms
    only while poses arrive that agree with its own, and it lands by itself when set-points
    (PX4) or the ground station (ArduPilot) fall silent. Its clock is that of `step`.
    """

    def __init__(self, autopilot: Literal["px4", "ardupilot"] = "px4"):
        self.autopilot = autopilot
        self.mode: Literal["guided", "land", "hold"] = "hold"
        self.armed = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.uri = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"
        self._packer = mavlink.MAVLink(None, *SYSTEM)
        self._peer: tuple[str, int] | None = None
        self._now = time.monotonic()
        self._shown: Shown | None = None
        self._velocity, self._streams = (0.0, 0.0, 0.0), self._now
        self._setpoint = self._station = self._pose = self._settled = -math.inf
        self._home, self._target = 0.0, -math.inf  # m: where it armed, what it climbs to
        self._airborne = False
        self._news = True
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="emulated mavlink", daemon=True)
        self._thread.start()

    def step(self, shown: Shown, now: float) -> Flown | None:
        """What it flies now; None when its motors are off or idle on the ground."""
        with self._lock:
            self._shown, self._now = shown, now
            self._fail_safe()
            if not self.armed:
                return None
            airborne = self._airborne or shown.position[2] > self._home + AIRBORNE
            self._news |= airborne != self._airborne
            self._airborne = airborne
            velocity = self._flown(shown)
            if velocity is None or (not airborne and velocity[2] <= 0.0):
                return None
            return Flown(velocity)

    def close(self) -> None:
        """Let go of the socket and its thread. May be called twice."""
        self._closed.set()
        self._thread.join(timeout=2.0)
        self._socket.close()

    def _fail_safe(self) -> None:
        quiet = self._now - self._setpoint > LOSS["px4"]
        if self.autopilot == "px4" and self.mode == "guided" and quiet:
            self._enter("land" if self.armed else "hold")
        alone = self.autopilot == "ardupilot" and self._now - self._station > STATION_LOSS
        if self.armed and self.mode != "land" and (alone or self._now - self._pose > BLIND):
            self._enter("land")

    def _flown(self, shown: Shown) -> Vector | None:
        if self.mode == "land":
            if shown.velocity[2] < -0.5 * DESCENT:
                self._settled = self._now
            if not self._airborne or self._now - self._settled > SETTLED:
                self._disarm()
                return None
            return 0.0, 0.0, -DESCENT
        if self.mode == "hold":
            return 0.0, 0.0, 0.0
        if shown.position[2] < self._target:
            return 0.0, 0.0, CLIMB
        self._target = -math.inf
        patience = GAP if self.autopilot == "px4" else LOSS["ardupilot"]
        return self._velocity if self._now - self._setpoint <= patience else (0.0, 0.0, 0.0)

    def _enter(self, mode: Literal["guided", "land", "hold"]) -> None:
        if mode != self.mode:
            self.mode, self._settled, self._target, self._news = mode, self._now, -math.inf, True
            self._velocity = (0.0, 0.0, 0.0)

    def _disarm(self) -> None:
        self.armed = self._airborne = False
        self._news = True
        if self.mode == "land":
            self._enter("hold")

    def _serve(self) -> None:
        slow = fast = -math.inf
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        while not self._closed.is_set():
            ready = select.select([self._socket], [], [], 0.05)[0]
            with self._lock, contextlib.suppress(OSError):
                if ready:
                    data, sender = self._socket.recvfrom(65535)
                    for message in parsed(parser, data, keep=False):
                        self._hear(message, sender)
                now = time.monotonic()
                if self._news or now - slow >= 1.0:
                    self._news, slow = False, now
                    self._tell_state()
                if now - fast >= 0.1:
                    fast = now
                    self._tell_position()

    def _hear(self, message: Any, sender: tuple[str, int]) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.type == mavlink.MAV_TYPE_GCS:
            self._news |= sender != self._peer
            self._peer, self._station = sender, self._now
        elif kind == "VISION_POSITION_ESTIMATE":
            self._see(np.array([message.x, message.y, message.z]), message.yaw)
        elif getattr(message, "target_system", None) not in (0, SYSTEM[0]):
            return
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            self._take(message)
        elif kind == "COMMAND_LONG":
            result = self._obey(message)
            self._tell(mavlink.MAVLink_command_ack_message(message.command, result))

    def _see(self, north_east_down: np.ndarray, heading: float) -> None:
        if self._shown is None:
            return
        away = np.linalg.norm(NED.T @ north_east_down - self._shown.position)
        north, east = math.cos(heading), math.sin(heading)
        yaw = math.atan2(north, east)  # the world's y is north, its x east
        turned = math.remainder(yaw - self._shown.attitude[2], math.tau)
        if away < GATE and abs(turned) < HEADING_GATE:
            self._pose = self._now

    def _take(self, message: Any) -> None:
        velocity = np.array([message.vx, message.vy, message.vz])
        # Bits of what is ignored: position and acceleration must be, velocity and yaw not.
        mask = message.type_mask
        if mask & 0b0101_1111_1111 != 0b0001_1100_0111 or message.coordinate_frame != 1:
            return
        if not np.isfinite([*velocity, message.yaw]).all():
            return
        if self._now - self._setpoint > GAP:
            self._streams = self._now
        x, y, z = (NED.T @ velocity).tolist()
        self._velocity, self._setpoint = (x, y, z), self._now
        if self.mode == "guided":
            self._target = -math.inf  # as ArduPilot: a set-point ends a take-off

    def _obey(self, command: Any) -> int:
        accepted, refused = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        if command.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            done = self._arm() if command.param1 == 1.0 else self._stop(command.param2 == 21196.0)
            return accepted if done else refused
        if command.command == mavlink.MAV_CMD_DO_SET_MODE:
            done = command.param1 == 1.0 and self._switch((command.param2, command.param3))
            return accepted if done else refused
        if command.command == mavlink.MAV_CMD_NAV_LAND:
            self._enter("land")
            return accepted
        if command.command == mavlink.MAV_CMD_NAV_TAKEOFF and self.autopilot == "ardupilot":
            ready = self.armed and self.mode == "guided" and not self._airborne
            if not (ready and 0.0 < command.param7 < 100.0):
                return refused
            self._target = self._home + command.param7
            return accepted
        if command.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return accepted  # all is told anyway
        return mavlink.MAV_RESULT_UNSUPPORTED

    def _arm(self) -> bool:
        if self._shown is None or self._now - self._pose > FRESH:
            error = mavlink.MAV_SEVERITY_CRITICAL
            self._tell(mavlink.MAVLink_statustext_message(error, b"Arming denied: no pose"))
            return False
        if not self.armed:
            self.armed, self._news, self._home = True, True, self._shown.position[2]
        return True

    def _stop(self, force: bool) -> bool:
        if self._airborne and not force:
            return False
        self._disarm()
        return True

    def _switch(self, wanted: tuple[float, float]) -> bool:
        proven = self._setpoint - self._streams >= PROOF and self._now - self._setpoint <= GAP
        if wanted == MODES[self.autopilot]["land"][0]:
            self._enter("land")
            return True
        if wanted != MODES[self.autopilot]["guided"][0]:
            return False
        if self.autopilot == "px4" and not proven:
            return False
        self._enter("guided")
        return True

    def _tell(self, message: Any) -> None:
        if self._peer is not None:
            self._packer.seq = (self._packer.seq + 1) % 256
            self._socket.sendto(message.pack(self._packer), self._peer)

    def _tell_state(self) -> None:
        numbers = {
            "px4": mavlink.MAV_AUTOPILOT_PX4,
            "ardupilot": mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        }
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        state = mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY
        custom = MODES[self.autopilot][self.mode][1]
        number, kind = numbers[self.autopilot], mavlink.MAV_TYPE_QUADROTOR
        self._tell(mavlink.MAVLink_heartbeat_message(kind, number, base, custom, state, 3))
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND
        if self._airborne:
            landed = mavlink.MAV_LANDED_STATE_IN_AIR
        self._tell(mavlink.MAVLink_extended_sys_state_message(0, landed))
        if self._shown is not None:
            battery = round(100 * min(max(self._shown.battery, 0.0), 1.0))
            cells = [65535] * 10  # not measured
            self._tell(
                mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, cells, -1, -1, -1, battery)
            )
            self._tell(
                mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, battery, 0, 0, 0, 0, 0, 0)
            )

    def _tell_position(self) -> None:
        if self._shown is not None:
            place, velocity = NED @ self._shown.position, NED @ self._shown.velocity
            stamp = int(1000 * self._now) & 0xFFFFFFFF
            self._tell(mavlink.MAVLink_local_position_ned_message(stamp, *place, *velocity))

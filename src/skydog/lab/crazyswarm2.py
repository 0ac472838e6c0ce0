"""Crazyswarm2: a Crazyflie behind its ROS 2 server, told by streamed set-points.

Which set-point when (IMRCLab/crazyswarm2 0774c42, crazyflie_server.cpp):

- In flight `cmd_velocity_world`, in m/s. The base station closes the position loop itself, so the
  firmware is to close the velocity loop only. Its yaw rate stays 0: sign and unit differ between
  the server's backends.
- To take off and to land `cmd_full_state`, the height a ramp. Its attitude is a quaternion, where
  the yaw of `cmd_position` is degrees to the firmware and radians to the simulator.
- To stop the motors `cmd_vel_legacy` with thrust 0. The firmware obeys that at once and from any
  mode; a set-point that merely stops coming lets it level out for 2 s and may lock it.

The services for take-off and landing are not used. A ROS 2 service over bare DDS differs between
middlewares: rmw_cyclonedds puts {guid, seq} before the request, rmw_fastrtps does not, and the two
do not talk. A stream of messages is the same for all.
"""

from dataclasses import dataclass
from math import cos, sin
from time import monotonic
from typing import Any
from uuid import uuid4

from skydog.flight.supervisor import Mode
from skydog.lab import messages
from skydog.lab.adapters import DroneCommand, Status, Vector
from skydog.lab.domain import Domain, header
from skydog.lab.site import UAVSite

# After skydog.lab.domain, which refuses in one line where cyclonedds is missing.
from cyclonedds.idl import IdlStruct  # isort: skip
from cyclonedds.idl.annotations import final  # isort: skip
from cyclonedds.idl.types import int64, uint8, uint64  # isort: skip

CLIMB = 0.4  # m/s
SINK = 0.3  # m/s
LEASH = 0.4  # m: the ramp is never further from where the drone is believed to be
PRESS = 0.15  # m below the floor: where the ramp ends, so that the drone stands before it stops
REST = 1.0  # s at the ramp's end before the motors stop
REPEAT = 0.5  # s between two emergency requests
SILENT = 5.0  # s without a status after which the link counts as lost; the server sends 1 Hz
EMPTY, FULL = 3.0, 4.2  # V of one cell; the share between them is linear, ours

FLYING, TUMBLED, LOCKED = 16, 32, 64  # bits of Status.supervisor_info

COMMANDS = {
    "cmd_full_state": "crazyflie_interfaces/msg/FullState",
    "cmd_velocity_world": "crazyflie_interfaces/msg/VelocityWorld",
    "cmd_vel_legacy": "geometry_msgs/msg/Twist",
}


@final
@dataclass
class EmptyRequest(IdlStruct, typename="std_srvs::srv::dds_::Empty_Request_"):
    """A std_srvs/Empty request with the header that rmw_cyclonedds puts before it."""

    guid: uint64
    seq: int64
    structure_needs_at_least_one_member: uint8 = 0


def emergency(namespace: str) -> str:
    """The DDS topic on which a drone's server takes emergency requests."""
    return f"rq/{namespace.strip('/')}/emergencyRequest"


class Crazyswarm2Drone:
    """A Crazyflie behind Crazyswarm2's server; a `skydog.lab.adapters.Drone`.

    The site's topic is its namespace, or /NAME. Arming is the server's: a Crazyflie 2.x arms by
    itself, others need `ros2 service call /NAME/arm`.

    Emergency streams thrust 0, which stops the motors as long as it is streamed, whatever the
    server's middleware. It also calls /NAME/emergency, after which the firmware stays off until it
    is rebooted. That call has rmw_cyclonedds's header: a server on rmw_fastrtps (ROS 2's default)
    does not hear it. Its reply is not awaited.
    """

    def __init__(self, domain: Domain, uav: UAVSite):
        space = uav.topic or f"/{uav.name}"
        self._domain = domain
        self._topics = tuple(f"{space}/{name}" for name in COMMANDS)
        self._place, self._velocity, self._thrust = (
            domain.publish(topic, kind)
            for topic, kind in zip(self._topics, COMMANDS.values(), strict=True)
        )
        self._emergency = domain.write(emergency(space), EmptyRequest)
        self._heard = domain.subscribe(f"{space}/status", "crazyflie_interfaces/msg/Status")
        self._said: Any = None
        self._came = 0.0
        self._guid, self._calls, self._called = uuid4().int % 2**64, 0, float("-inf")
        self._mode, self._begun = Mode.DISARMED, 0.0
        self._origin: Vector = (0.0, 0.0, 0.0)
        self._yaw = self._floor = 0.0
        self._landed = False

    def send(self, command: DroneCommand, now: float) -> None:
        """Stream the set-point of the mode. Disarmed and ready, nothing is sent."""
        if command.mode != self._mode:
            self._mode, self._begun = command.mode, now
            self._origin, self._yaw = command.position, command.yaw
            self._landed = False
            if command.mode == Mode.TAKING_OFF:
                self._floor = command.position[2]
        if command.mode == Mode.TAKING_OFF:
            self._take_off(command, now)
        elif command.mode in (Mode.MISSION, Mode.HOLD):
            self._fly((0.0, 0.0, 0.0) if command.hover else command.velocity)
        elif command.mode == Mode.LANDING:
            self._land(command, now)
        elif command.mode == Mode.EMERGENCY:
            self._stop(now)

    def status(self) -> Status:
        """The latest status of the server, and whether there is one that listens to us."""
        said = self._heard.latest()
        if said is not None:
            self._said, self._came = said, monotonic()
        if self._said is None:
            return Status(connected=self._velocity.heard())
        bits = self._said.supervisor_info
        share = (self._said.battery_voltage - EMPTY) / (FULL - EMPTY)
        return Status(
            battery=min(max(share, 0.0), 1.0),
            flying=bool(bits & FLYING),
            emergency=bool(bits & (TUMBLED | LOCKED)),
            connected=self._velocity.heard() and monotonic() - self._came < SILENT,
        )

    def others(self) -> tuple[str, ...]:
        """Who else publishes on a topic of its set-points."""
        return self._domain.others(*self._topics)

    def close(self) -> None:
        """Stop publishing."""
        for one in (self._place, self._velocity, self._thrust, self._emergency, self._heard):
            one.close()

    def _take_off(self, command: DroneCommand, now: float) -> None:
        ramp = self._floor + CLIMB * (now - self._begun)
        self._stand(min(ramp, command.setpoint[2], command.position[2] + LEASH))

    def _fly(self, velocity: Vector) -> None:
        vector = messages.idl("geometry_msgs/msg/Vector3")
        self._velocity.send(header=header(), vel=vector(*velocity))

    def _land(self, command: DroneCommand, now: float) -> None:
        """Sink; when the ramp has ended, and the drone is seen on the floor or not at all, stop."""
        end = self._floor - PRESS
        ramp = self._origin[2] - SINK * (now - self._begun)
        down = command.hover or command.position[2] < self._floor + PRESS
        self._landed |= down and ramp < end - SINK * REST
        if self._landed:
            self._thrust.send()
        elif command.hover:
            self._fly((0.0, 0.0, -SINK))
        else:
            self._stand(max(ramp, end, command.position[2] - LEASH))

    def _stand(self, height: float) -> None:
        """Where the mode began, but so high."""
        point = messages.idl("geometry_msgs/msg/Point")(*self._origin[:2], height)
        turned = messages.idl("geometry_msgs/msg/Quaternion")(
            0.0, 0.0, sin(self._yaw / 2), cos(self._yaw / 2)
        )
        pose = messages.idl("geometry_msgs/msg/Pose")(point, turned)
        self._place.send(header=header(), pose=pose)

    def _stop(self, now: float) -> None:
        self._thrust.send()
        if now >= self._called + REPEAT:
            self._called, self._calls = now, self._calls + 1
            self._emergency.send(guid=self._guid, seq=self._calls)

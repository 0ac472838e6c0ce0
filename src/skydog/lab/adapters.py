"""What stands between the base station and a robot or a tracker: the three faces of an adapter.

The base station knows no transport. Whatever has these methods can be named in a site file.
All times are of the monotonic clock, in seconds; frames are the world's, metres, x right, y up as
seen from above, z up, yaw from the x axis counterclockwise.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

from skydog.flight.supervisor import Mode

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w


class Body(NamedTuple):
    """A body as a tracker shows it, in the tracker's own frame."""

    position: Vector  # m
    attitude: Quaternion
    came: float  # s: when it was received
    number: int  # of the frame, as the tracker counts; grows by one or more


@runtime_checkable
class Source(Protocol):
    """Where poses come from: a tracker's stream, a topic, a flight log. Bodies go by name."""

    def wait(self, until: float) -> bool:
        """Wait for bodies that came since the last `bodies`; False if none did by then."""
        ...

    def bodies(self) -> Mapping[str, Body]:
        """The latest of every body that was ever seen. What waited behind it is dropped."""
        ...

    def close(self) -> None:
        """Let go of sockets and threads. May be called twice."""
        ...


class DroneCommand(NamedTuple):
    """What a drone is to do now, in every form that a drone may ask for it."""

    mode: Mode  # of the supervisor: take off, land and stop are read off it
    hover: bool  # hold still by your own sensors: nobody sees you
    velocity: Vector  # m/s
    tilt: tuple[float, float]  # rad, roll and pitch
    setpoint: Vector  # m
    position: Vector  # m, where it is believed to be
    yaw: float  # rad


class Status(NamedTuple):
    """What a drone says of itself. None is what it does not say."""

    battery: float | None = None  # share, 0 to 1
    flying: bool | None = None
    emergency: bool = False
    connected: bool = True


@runtime_checkable
class Drone(Protocol):
    """A drone, whatever it speaks. It is told a hundred times a second, and never waits."""

    def send(self, command: DroneCommand, now: float) -> None:
        """Tell it. Take-off and landing are told until its status says that they are done."""
        ...

    def status(self) -> Status:
        """The latest that it said."""
        ...

    def others(self) -> tuple[str, ...]:
        """Who else commands it: the names of nodes that publish where only we should."""
        ...

    def close(self) -> None:
        """Let go. It is not landed: that is the supervisor's."""
        ...


@runtime_checkable
class Rover(Protocol):
    """A rover that obeys a forward speed and a turn rate."""

    def send(self, speed: float, turn_rate: float, now: float) -> None:
        """Tell it, in m/s and rad/s."""
        ...

    def others(self) -> tuple[str, ...]:
        """Who else commands it."""
        ...

    def close(self) -> None:
        """Let go."""
        ...

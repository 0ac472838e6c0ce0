"""What an emulated robot shows to its driver and hears from it."""

from typing import NamedTuple, Protocol, runtime_checkable

from skydog.lab.adapters import Vector


class Shown(NamedTuple):
    """What a drone's own sensors say, for its driver. World frame, metres, m/s, radians."""

    position: Vector
    velocity: Vector
    attitude: Vector  # roll, pitch, yaw
    battery: float  # share, 0 to 1


class Flown(NamedTuple):
    """What a driver makes of what it was told: the command of the autopilot on board."""

    velocity: Vector  # m/s
    tilt: tuple[float, float] | None = None  # rad: flown instead of the velocity's x and y


@runtime_checkable
class DroneDriver(Protocol):
    """The driver of an emulated drone: real topics or packets on one side, the twin on another."""

    def step(self, shown: Shown, now: float) -> Flown | None:
        """What is flown in the next hundredth of a second; None when its motors are off."""
        ...

    def close(self) -> None:
        """Let go of sockets and threads."""
        ...


@runtime_checkable
class RoverDriver(Protocol):
    """The driver of an emulated rover."""

    def step(self, now: float) -> tuple[float, float]:
        """The forward speed in m/s and the turn rate in rad/s that its wheels turn for."""
        ...

    def close(self) -> None:
        """Let go of sockets and threads."""
        ...

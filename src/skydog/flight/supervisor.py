"""The safety supervisor: a table that a safety officer can read, and one function that applies it."""

from enum import IntEnum


class Mode(IntEnum):
    """What the base station does with its drones."""

    DISARMED = 0
    READY = 1
    TAKING_OFF = 2
    MISSION = 3
    HOLD = 4
    LANDING = 5
    EMERGENCY = 6

"""The safety supervisor: a table that a safety officer can read, and one function that applies it.

What is not in the table is refused. All arrays may have missions first, and each has its own mode.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


class Mode(IntEnum):
    """What the base station does with its robots."""

    DISARMED = 0
    READY = 1  # the pre-flight checks pass, and nothing moves
    TAKING_OFF = 2
    MISSION = 3
    HOLD = 4  # rovers stop, drones hold their places
    LANDING = 5
    EMERGENCY = 6  # motors are cut: by a human alone, and until one resets it


class Order(IntEnum):
    """What an operator asks for."""

    NONE = 0
    ARM = 1
    DISARM = 2
    TAKE_OFF = 3
    HOLD = 4
    RESUME = 5
    LAND = 6
    STOP = 7  # one step more each time: hold, land, emergency
    EMERGENCY = 8
    RESET = 9


# Of several events at once the first counts that the table knows for the mode: the graver first.
EVENTS = (
    "operator: emergency",
    "operator: reset",
    "operator: land",
    "hard fence",
    "eyes stale long",  # `Limits.blind`
    "battery low",
    "drone lost",  # it says itself that it has no link, or an emergency
    "drone stands",  # it says itself that it does not fly: somebody has put it down
    "drone too low",
    "second publisher",
    "a rover runs away",
    "hold too long",
    "take-off too long",
    "mission over",
    "landed",
    "operator: stop",
    "operator: hold",
    "eyes stale",  # `Limits.stale`
    "policy silent",
    "operator: disarm",
    "not ready",
    "operator: arm",
    "operator: take off",
    "at height",
    "well again",
    "well again, low",
)

_IN_FLIGHT = (Mode.TAKING_OFF, Mode.MISSION, Mode.HOLD)
_LAND = (
    "operator: land",
    "hard fence",
    "eyes stale long",
    "battery low",
    "drone lost",
    "second publisher",
    "a rover runs away",
    "mission over",
)
_M = Mode

TRANSITIONS: dict[tuple[Mode, str], Mode] = {
    (_M.DISARMED, "operator: arm"): _M.READY,  # if the pre-flight checks pass
    (_M.READY, "operator: disarm"): _M.DISARMED,
    (_M.READY, "operator: stop"): _M.DISARMED,
    (_M.READY, "not ready"): _M.DISARMED,
    (_M.READY, "operator: take off"): _M.TAKING_OFF,  # if they still pass
    (_M.TAKING_OFF, "at height"): _M.MISSION,
    (_M.TAKING_OFF, "operator: stop"): _M.HOLD,
    (_M.TAKING_OFF, "operator: hold"): _M.HOLD,
    (_M.TAKING_OFF, "eyes stale"): _M.HOLD,
    (_M.TAKING_OFF, "take-off too long"): _M.LANDING,
    (_M.MISSION, "operator: stop"): _M.HOLD,
    (_M.MISSION, "operator: hold"): _M.HOLD,
    (_M.MISSION, "eyes stale"): _M.HOLD,
    (_M.MISSION, "policy silent"): _M.HOLD,
    (_M.MISSION, "drone stands"): _M.LANDING,
    (_M.MISSION, "drone too low"): _M.LANDING,
    (_M.HOLD, "drone stands"): _M.LANDING,
    (_M.HOLD, "drone too low"): _M.LANDING,  # unless it holds in a take-off
    (_M.HOLD, "well again"): _M.MISSION,  # never from an operator's hold: that wants "resume"
    (_M.HOLD, "well again, low"): _M.TAKING_OFF,
    (_M.HOLD, "operator: stop"): _M.LANDING,
    (_M.HOLD, "hold too long"): _M.LANDING,
    **{(mode, event): _M.LANDING for mode in _IN_FLIGHT for event in _LAND},
    (_M.LANDING, "landed"): _M.DISARMED,
    (_M.LANDING, "operator: stop"): _M.EMERGENCY,
    **{(mode, "operator: emergency"): _M.EMERGENCY for mode in Mode if mode != _M.EMERGENCY},
    (_M.EMERGENCY, "operator: reset"): _M.DISARMED,
}
"""Which mode follows which, and why."""

_NEXT = np.full((len(Mode), len(EVENTS)), -1)
for (_mode, _event), _then in TRANSITIONS.items():
    _NEXT[_mode, EVENTS.index(_event)] = _then


class Memory(NamedTuple):
    """Where the supervisor is."""

    mode: Int[np.ndarray, "*batch"]  # of `Mode`
    since: Float[np.ndarray, "*batch"]  # s: when it was entered
    held: Bool[np.ndarray, "*batch"]  # by the operator, until "resume"


class Change(NamedTuple):
    """What a step changed."""

    before: Int[np.ndarray, "*batch"]
    event: Int[np.ndarray, "*batch"]  # of `EVENTS`; -1 is none
    refused: Int[np.ndarray, "*batch"]  # of `Order`; 0 is none


def start(mode: Mode, shape: tuple[int, ...] = (), now: float = 0.0) -> Memory:
    """The supervisor's memory of missions that are all in one mode."""
    return Memory(np.full(shape, int(mode)), np.full(shape, now), np.zeros(shape, bool))


def step(
    memory: Memory,
    order: Int[np.ndarray, "*batch"],
    happens: dict[str, Bool[np.ndarray, "*batch"]],
    now: float,
) -> tuple[Memory, Change]:
    """The supervisor's next memory, and what changed.

    `happens` tells which of `EVENTS` are the case, an operator's apart; "ready" is the pre-flight
    gate, without which nothing arms or takes off, "well" tells that nothing asks to hold, and
    "climbing" that a hold has interrupted a take-off.
    """
    mode = memory.mode
    resumed = order == Order.RESUME
    held = memory.held & ~resumed & (mode == Mode.HOLD)
    ready, well, high = happens["ready"], happens["well"] & ~held, happens["at height"]
    said = {
        "operator: emergency": order == Order.EMERGENCY,
        "operator: reset": order == Order.RESET,
        "operator: stop": order == Order.STOP,
        "operator: land": order == Order.LAND,
        "operator: hold": order == Order.HOLD,
        "operator: disarm": order == Order.DISARM,
        "not ready": ~ready,
        "operator: arm": (order == Order.ARM) & ready,
        "operator: take off": (order == Order.TAKE_OFF) & ready,
        "well again": well & high,
        "well again, low": well & happens["climbing"] & ~high,
    }
    happening = np.stack(
        [np.broadcast_to(said.get(name, happens.get(name, False)), mode.shape) for name in EVENTS],
        axis=-1,
    )
    possible = happening & (_NEXT[mode] >= 0)
    event = np.where(possible.any(axis=-1), np.argmax(possible, axis=-1), -1)
    then = np.where(event >= 0, _NEXT[mode, event], mode)
    by_operator = (event >= 0) & _IS_ORDER[event]
    stopped = by_operator & (then == Mode.HOLD)
    also_held = (mode == Mode.HOLD) & (order == Order.HOLD)
    refused = (order != Order.NONE) & ~by_operator & ~also_held & ~(resumed & (mode == Mode.HOLD))
    after = Memory(then, np.where(then != mode, now, memory.since), held | stopped | also_held)
    return after, Change(mode, event, np.where(refused, order, Order.NONE))


_IS_ORDER = np.array([name.startswith("operator: ") for name in EVENTS])

"""What an instant of a batch of missions leaves to record."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Record(NamedTuple):
    """What an instant of a batch of missions leaves to record; as `Trace` and `Poses` name it."""

    sheep: Float[np.ndarray, "batch sheep 2"]
    dogs: Float[np.ndarray, "batch dogs 2"]
    subgoal: Float[np.ndarray, "batch dogs 2"]
    drives: Bool[np.ndarray, "batch dogs"]
    command: Float[np.ndarray, "batch dogs 2"]
    accomplished: Bool[np.ndarray, " batch"]
    altitude: Float[np.ndarray, "batch dogs"]
    attitude: Float[np.ndarray, "batch dogs 3"]
    setpoint: Float[np.ndarray, "batch dogs 3"]
    yaw: Float[np.ndarray, "batch sheep"]
    speed: Float[np.ndarray, "batch sheep"]
    turn_rate: Float[np.ndarray, "batch sheep"]


def hold(before: Record, now: Record, stood: Bool[np.ndarray, " batch"]) -> Record:
    """The record, in which missions that have `stood` are as before."""
    if not stood.any():
        return now
    parts = zip(before, now, strict=True)
    return Record(
        *(np.where(stood.reshape(-1, *[1] * (new.ndim - 1)), old, new) for old, new in parts)
    )

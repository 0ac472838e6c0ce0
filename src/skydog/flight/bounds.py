"""Bounds on numbers, for loops that run hundreds of times a second."""

from typing import Any

import numpy as np


def clipped(value: Any, least: Any, most: Any) -> Any:
    """`numpy.clip`, which takes five times as long on a few numbers."""
    return np.minimum(np.maximum(value, least), most)

"""The loops of a profile as python-control has them, each written from the law it stands for."""

import runpy
from pathlib import Path
from typing import Any

import control
import numpy as np

from skydog.flight.profiles import UAV

MARGINS = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "margins.py"))

S: Any = control.tf("s")


def tilting(uav: UAV) -> Any:
    """Commanded tilt c to tilt: tilt'' = gain (c - tilt) + damping (lead c' - tilt'), by motors."""
    loop = uav.attitude
    motors = 1 / (uav.body.motor_lag * S + 1)
    ahead = motors * (loop.gain + loop.damping * loop.lead * S)
    return ahead / (S**2 + motors * (loop.gain + loop.damping * S))


def velocity(uav: UAV, delay: Any = 1) -> Any:
    """Commanded velocity to velocity: acceleration = gain e + damping e' + drag, by tilting.

    `delay` is a transfer function: of the command, or of the tilt where the base station commands
    it.
    """
    loop, drag = uav.velocity, uav.body.drag / uav.body.mass
    tilt = tilting(uav) * (1 if loop.on_board else delay)
    measured = loop.gain + (loop.damping * S if loop.on_board else 0)
    closed = tilt * (loop.gain + loop.damping * S + drag) / (S + drag + tilt * measured)
    return control.minreal(closed * (delay if loop.on_board else 1), verbose=False)


def positive_feedback(plant: Any, n: Any) -> Any:
    return control.feedback(plant, n, sign=+1)


def late(delay: float, order: int = 6) -> Any:
    """A delay in seconds, by Padé."""
    return control.tf(*control.pade(delay, order)) if delay else control.tf(1, 1)


def real_part(system: Any) -> np.ndarray:
    """The numerator of Re G(jω) as a polynomial in ω², highest power first."""
    numerator, denominator = (np.atleast_1d(part[0][0]) for part in (system.num, system.den))
    mirrored = denominator * (-1.0) ** np.arange(len(denominator))[::-1]  # D(-s)
    product = np.polymul(numerator, mirrored)
    even = product[::-1][::2]  # of s², lowest power first; s² = -ω²
    return (even * (-1.0) ** np.arange(len(even)))[::-1]


def is_stable(closed: Any) -> bool:
    return bool(np.max(np.real(closed.poles())) < 0.0)

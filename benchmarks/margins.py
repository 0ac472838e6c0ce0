"""How much each drone's loops bear before they fail, as a table: `margins.py --help`.

A loop is negative imaginary (NI) up to some frequency, because its motors lag and its link is
late; above it the theory behind the SNI controller promises nothing, and margins must do.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import control
import numpy as np
import tyro
from jaxtyping import Complex, Float
from scipy.optimize import brentq
from tyro.conf import arg

from skydog import files
from skydog.flight import altitude, profiles, sni
from skydog.flight.estimate import ALPHA, BETA
from skydog.flight.profiles import UAV
from skydog.flight.station import DT

GRID = np.geomspace(0.01, 300.0, 4001)  # rad/s; 300 is where a loop of 100 Hz ends

Frequencies = Float[np.ndarray, " frequencies"]  # rad/s
Response = Complex[np.ndarray, " frequencies"]


@dataclass(frozen=True)
class Margins:
    """What the loops of a drone bear."""

    profile: str
    ni_up_to: float  # rad/s; infinite if it is NI at all frequencies
    dc_gain: float  # N(0), 1/s; below 0, or the loop diverges
    delay: float  # s that the link may be later, for the position in the plane
    gain: float  # dB by which that loop's gain may be larger
    altitude_delay: float  # s that the link may be later, for the altitude


def margins(name: str) -> Margins:
    """The margins of a drone's position loop and of its altitude's, broken at its radio link."""
    uav = profiles.uav(name)
    delay, gain = _margins(position_loop(uav, GRID))
    return Margins(
        profile=uav.name,
        ni_up_to=ni_up_to(lambda omega: velocity_loop(uav, omega)),
        dc_gain=float(np.real(sni_controller(uav)(0.0))),
        delay=delay,
        gain=gain,
        altitude_delay=_margins(altitude_loop(uav, GRID))[0],
    )


def ni_up_to(velocity: Callable[[Frequencies], Response]) -> float:
    """Up to which frequency in rad/s V(s)/s is NI, for the response of a velocity loop V(s).

    Im V(jω)/(jω) = -Re V(jω)/ω, so that it is NI as long as Re V(jω) ≥ 0. V must be stable.
    """

    def real(omega: float) -> float:
        return float(np.real(velocity(np.array([omega]))[0]))

    below = np.flatnonzero(np.real(velocity(GRID)) < 0.0)
    if len(below) == 0:
        return np.inf
    root: Any = brentq(real, GRID[below[0] - 1], GRID[below[0]])
    return root


def velocity_loop(uav: UAV, omega: Frequencies, delay: float | None = None) -> Response:
    """V(jω), from the commanded velocity to the velocity, in the plane.

    It has the motors' lag and the air's drag. `delay` is the link's, in seconds; None is the
    profile's own. Where the velocity loop is the base station's, the delay is inside of it.
    """
    s, late = 1j * omega, np.exp(-1j * omega * (uav.link.delay if delay is None else delay))
    drag, loop = uav.body.drag / uav.body.mass, uav.velocity
    tilted = tilt_loop(uav)(s)
    wanted = loop.gain + loop.damping * s + drag
    if loop.on_board:
        return late * wanted * tilted / (s + drag + (loop.gain + loop.damping * s) * tilted)
    # The base station does not measure the acceleration.
    return wanted * tilted * late / (s + drag + loop.gain * tilted * late)


def position_loop(uav: UAV, omega: Frequencies) -> Response:
    """The whole loop, broken at the radio link: -L(jω), for negative feedback.

    It has all that `velocity_loop` has, and what the base station adds: it sees through its
    estimator, holds a command for 10 ms, and integrates the trim.
    """
    s = 1j * omega
    drag, loop = uav.body.drag / uav.body.mass, uav.velocity
    controller = uav.position.trim / s - sni_controller(uav)(s)
    position, velocity = _estimated(omega)
    held = np.exp(-s * (uav.link.delay + DT / 2))
    if loop.on_board:
        return velocity_loop(uav, omega, 0.0) / s * held * position * controller
    # A tilt is commanded: by the velocity that the controller wants, less the one that is seen.
    wanted = (loop.gain + loop.damping * s + drag) * position * controller
    return tilt_loop(uav)(s) * held / (s * (s + drag)) * (wanted + loop.gain * velocity)


def altitude_loop(uav: UAV, omega: Frequencies) -> Response:
    """The loop of the altitude, broken at the radio link: -L(jω), for negative feedback."""
    s, loop = 1j * omega, uav.velocity
    drag, motors = uav.body.drag / uav.body.mass, 1.0 / (uav.body.motor_lag * s + 1.0)
    thrust = (loop.climb_gain + loop.climb_damping * s) * motors
    climbs = (thrust + drag * motors) / (s + drag + thrust)
    position, _ = _estimated(omega)
    return altitude.GAIN * position * np.exp(-s * (uav.link.delay + DT / 2)) * climbs / s


def tilt_loop(uav: UAV) -> Any:
    """From the commanded tilt to the tilt: the attitude loop on board, behind the motors' lag."""
    loop = uav.attitude
    numerator = [loop.damping * loop.lead, loop.gain]
    return control.tf(numerator, [uav.body.motor_lag, 1.0, loop.damping, loop.gain])


def sni_controller(uav: UAV) -> Any:
    """N(s) of the position loop: `skydog.flight.sni`."""
    return control.tf(*sni.coefficients(uav.position))


def table() -> list[str]:
    """The margins of every drone that ships, as lines of Markdown."""
    lines = [
        "| profile | NI up to (rad/s) | SNI DC gain N(0) (1/s) | delay margin (s) "
        "| gain margin (dB) | delay margin of the altitude (s) |",
        "|---|---|---|---|---|---|",
    ]
    for found in map(margins, profiles.ship("uav")):
        ni = "all" if np.isinf(found.ni_up_to) else f"{found.ni_up_to:.1f}"
        lines.append(
            f"| {found.profile} | {ni} | {found.dc_gain:.2f} | {found.delay:.2f} "
            f"| {found.gain:.1f} | {found.altitude_delay:.2f} |"
        )
    return lines


def main(out: Annotated[Path | None, arg(metavar="FILE.md")] = None) -> None:
    """Print the margins of every drone that ships, as a Markdown table.

    NI: the plant, from the commanded velocity to the position, with its motor lag, drag and link
    delay. Margins: of the whole position loop, broken at the radio link, with the base station's
    estimator, its 10 ms of hold and its trim estimator. Delay margins are beyond the link's delay.

    Example: .venv/bin/python benchmarks/margins.py

    Args:
        out: Where to write the table too, if given.
    """
    lines = table()
    print("\n".join(lines))
    if out is not None:
        files.write_text(out, "\n".join([*lines, ""]))


def _margins(loop: Response) -> tuple[float, float]:
    """The delay margin in seconds and the gain margin in dB of -L(jω) on `GRID`."""
    broken = control.frd(loop, GRID, smooth=True)
    gain, phase, _, _, crossover, _ = control.stability_margins(broken)
    return float(np.radians(phase) / crossover), float(20.0 * np.log10(gain))


def _estimated(omega: Frequencies) -> tuple[Response, Response]:
    """Estimated position and velocity, for a position: `skydog.flight.estimate` at z = exp(jωT)."""
    z = np.exp(1j * omega * DT)
    denominator = z**2 - (2.0 - ALPHA - BETA) * z + 1.0 - ALPHA
    position = z * (ALPHA * z + BETA - ALPHA) / denominator
    return position, BETA / DT * z * (z - 1.0) / denominator


if __name__ == "__main__":
    tyro.cli(main)

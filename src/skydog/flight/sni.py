"""Position to velocity by a strictly negative imaginary controller, and the trim it cannot see.

The plant, from the commanded velocity to the position, is negative imaginary: an integrator behind
a velocity loop. In positive feedback with an SNI controller whose N(0) < 0 it is stable (Lanzon and
Petersen 2008; with the integrator, Mabrok et al. 2014). The paper stabilises its UAV so ("UAV
control stabilization"); its transfer functions are in a supplement that we do not have.
"""

import numpy as np
from jaxtyping import Float

from skydog.flight.bounds import clipped
from skydog.flight.profiles import Position, Yaw

FAR = 0.5  # m: the trim estimator waits while the error is larger, which no trim explains


def step(
    loop: Position | Yaw,
    memory: Float[np.ndarray, "*batch"],
    error: Float[np.ndarray, "*batch"],
    dt: float,
    gain: Float[np.ndarray, "*batch"] | float = 1.0,
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """The memory `dt` seconds later, and the velocity -N(s) e for an error e.

    N(s) = Γ / (s + ΓΦ) - Δ, exact for an error that stands for `dt`. Errors in metres give m/s,
    errors in radians rad/s. `gain` scales Γ; whatever it is, N(0) = 1/Φ - Δ stays as it is.
    """
    rate = loop.gamma * gain
    decay = np.exp(-rate * loop.phi * dt)
    output = loop.delta * error - memory
    return decay * memory + (1.0 - decay) / loop.phi * error, output


def trim(
    loop: Position,
    estimate: Float[np.ndarray, "*batch 2"],
    error: Float[np.ndarray, "*batch 2"],
    dt: float,
) -> Float[np.ndarray, "*batch 2"]:
    """The estimate, in m/s, of the velocity by which a drone drifts, `dt` seconds later.

    The controller's DC gain is finite, so that a constant drift leaves an offset. This integrates
    the offset, slowly, within bounds, and only while the drone is near its set-point.
    """
    near = np.hypot(error[..., :1], error[..., 1:]) <= FAR
    after = estimate + np.where(near, loop.trim * dt * error, 0.0)
    return clipped(after, -loop.largest_trim, loop.largest_trim)


def coefficients(loop: Position | Yaw) -> tuple[list[float], list[float]]:
    """N(s) as numerator and denominator, highest power first, for a library of control theory."""
    pole = loop.gamma * loop.phi
    return [-loop.delta, loop.gamma - loop.delta * pole], [1.0, pole]

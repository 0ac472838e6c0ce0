"""Ornstein-Uhlenbeck noise: exploration that persists from one step to the next."""

from jaxtyping import Array, Float


def ornstein_uhlenbeck(
    noise: Float[Array, " action"], theta: float, sigma: float, kick: Float[Array, " action"]
) -> Float[Array, " action"]:
    """The next value of a random walk that returns to zero (Uhlenbeck and Ornstein 1930).

    `theta` is the share by which it returns in a step, `sigma` the SD of its kicks and `kick` a
    draw from the standard normal. Its SD in the long run is sigma / sqrt(2 theta - theta²).
    Dimensionless.
    """
    return noise - theta * noise + sigma * kick

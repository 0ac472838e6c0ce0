"""f(N): how wide a gathered flock of N sheep may be. The gate, success and presets use it."""

import math
from typing import Protocol, runtime_checkable

import equinox as eqx

from skydog.world.vectors import Scalar


@runtime_checkable
class Spread(Protocol):
    """A law of f(N). Any `equinox.Module` with this method is one."""

    def radius(self, sheep: int) -> Scalar:
        """f(N) in metres: the radius of the circle that a gathered flock of N sheep fits in."""
        ...


class TwoThirdsSpread(eqx.Module):
    """f(N) = `length` · N^(2/3) (Strömbom et al. 2014; paper, Eq. 7).

    It outgrows a real flock, whose radius grows as √N: from some hundred sheep on, a scattered
    flock counts as gathered.
    """

    length: Scalar  # metres; R_ππ in the equation

    def radius(self, sheep: int) -> Scalar:
        """f(N) in metres."""
        return self.length * sheep ** (2 / 3)


class SquareRootSpread(eqx.Module):
    """f(N) = `length` · √(2N) (El-Fiqi et al. 2020), which grows as a flock does."""

    length: Scalar  # metres; R_ππ in the equation

    def radius(self, sheep: int) -> Scalar:
        """f(N) in metres."""
        return self.length * math.sqrt(2 * sheep)


class FixedSpread(eqx.Module):
    """The same f(N) for every N, such as the 1.3 m that the paper's table gives."""

    length: Scalar  # metres

    def radius(self, sheep: int) -> Scalar:
        """f(N) in metres."""
        return self.length

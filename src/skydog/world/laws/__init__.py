"""How sheep move: one law per file. A law is a module with one method, `force`."""

from typing import Protocol, runtime_checkable

from jaxtyping import Array, Float, PRNGKeyArray

from skydog.world.state import State


@runtime_checkable
class Flock(Protocol):
    """The sheep's law and its parameters. Any `equinox.Module` with this method is one.

    A law that needs no randomness may say so with an attribute `noisy = False`; missions are
    then flown without a random key.
    """

    def force(self, state: State, key: PRNGKeyArray | None) -> Float[Array, "sheep 2"]:
        """The total force on each sheep: dimensionless, 1 moves a sheep at its full speed.

        `state.force` is the force of the step before. `key` draws what is random in the law;
        None asks for the law without randomness.
        """
        ...

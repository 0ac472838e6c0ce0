"""The frame that a learnt dog sees and flies in: folded by the symmetries of the square.

If the whole world is turned or mirrored, the right action is turned or mirrored too. Under a speed
limit per axis that holds for the eight symmetries of the square, which swap the axes
or change their signs. `fold` applies the one that brings the offset from the flock's centre to the
subgoal into the octant x ≥ y ≥ 0, and `unfold` undoes it for the action. So a skill learns in
one octant, and can fly in all of them. In the paper's frame the axes are the world's.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Symmetry(eqx.Module):
    """A symmetry of the square: axes change their signs first, and then places."""

    sign: Float[Array, "*batch 2"]  # 1 or -1, for x and y
    swap: Bool[Array, "*batch 1"]  # whether x and y change places


def fold(seen: Float[Array, "*batch 4"]) -> tuple[Float[Array, "*batch 4"], Symmetry]:
    """What a dog sees (`sheepdog.OBSERVES`) in the folded frame, and how it was folded."""
    from_centre, from_subgoal = seen[..., :2], seen[..., 2:]
    offset = from_centre - from_subgoal
    x, y = offset[..., :1], offset[..., 1:]
    symmetry = Symmetry(jnp.where(offset < 0.0, -1.0, 1.0), jnp.abs(y) > jnp.abs(x))
    folded = [_applied(symmetry, from_centre), _applied(symmetry, from_subgoal)]
    return jnp.concatenate(folded, axis=-1), symmetry


def unfold(action: Float[Array, "*batch 2"], symmetry: Symmetry) -> Float[Array, "*batch 2"]:
    """An action of the folded frame in the frame of the world."""
    return jnp.where(symmetry.swap, action[..., ::-1], action) * symmetry.sign


def _applied(symmetry: Symmetry, vector: Float[Array, "*batch 2"]) -> Float[Array, "*batch 2"]:
    signed = vector * symmetry.sign
    return jnp.where(symmetry.swap, signed[..., ::-1], signed)

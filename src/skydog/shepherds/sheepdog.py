"""The sheepdog: two skills and the gate, combined (paper, "A Hierarchical Framework of DDPGs")."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.shepherds import frame as frames
from skydog.shepherds import navigate
from skydog.shepherds.networks import Actor, GreedyQ
from skydog.shepherds.options import Frame
from skydog.world import herding
from skydog.world.mission import limited
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar

# The four numbers that a dog sees (paper, "Action and state space"), in their order.
OBSERVES = (
    "x from GCM to dog (m)",
    "y from GCM to dog (m)",
    "x from subgoal to dog (m)",
    "y from subgoal to dog (m)",
)
# The two numbers that it commands, in their order.
COMMANDS = ("x velocity (share of the speed limit)", "y velocity (share of the speed limit)")


def observe(
    sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"], subgoal: Float[Array, "dogs 2"]
) -> Float[Array, "dogs 4"]:
    """What each dog sees, in metres: the vectors to it from the GCM and from its subgoal."""
    return jnp.concatenate([dogs - herding.gcm(sheep), dogs - subgoal], axis=-1)


def stretched(action: Float[Array, "*batch 2"], xi: Scalar) -> Float[Array, "*batch 2"]:
    """An action through ξ: multiplied by 1/ξ and squashed by tanh (paper, Eq. 22).

    If ξ is 1, the action is not changed.
    """
    return jnp.where(xi == 1.0, action, jnp.tanh(action / xi))


class Sheepdog(eqx.Module):
    """A trained shepherd: it flies the skill that the gate chooses.

    With skills that are `Actor`s it is the paper's H-DDPG, with `GreedyQ`s the earlier DHRL.
    In an arena of another size than the one it was trained in, its inputs are multiplied by ξ,
    and H-DDPG's commands by 1/ξ; DHRL's moves keep their length (paper, "Testing").

    With a third skill, `navigate`, it needs no map: among obstacles it finds the way home by
    what is in sight (`skydog.shepherds.navigate`), whatever the world's own `home` says.
    """

    collect: Actor | GreedyQ
    drive: Actor | GreedyQ
    arena: Scalar  # metres: the side of the arena that the skills were learnt in
    frame: Frame = eqx.field(static=True, default="folded")  # see `skydog.shepherds.frame`
    navigate: Actor | None = None

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        if self.navigate is not None and world.obstacles is not None:
            world = replace(world, home=navigate.home(self.navigate, world, state))
        subgoal, drives = herding.gate(world, state.sheep, state.dogs)
        return self.steer(world, state, subgoal, drives)

    def steer(
        self,
        world: World,
        state: State,
        subgoal: Float[Array, "dogs 2"],
        drives: Bool[Array, " dogs"],
    ) -> Float[Array, "dogs 2"]:
        """Velocities in m/s of dogs that fly to subgoals, by the skill that each is to use."""
        xi = self.arena / world.arena.scale  # the diagonals' ratio
        seen = xi * observe(state.sheep, state.dogs, subgoal)
        # A dog whose eyes fail hovers. An `Actor` carries what is no number through to its limits;
        # of such values a `GreedyQ` would pick the first.
        sees = jnp.all(jnp.isfinite(seen), axis=-1, keepdims=True)
        seen, symmetry = frames.fold(seen) if self.frame == "folded" else (seen, None)
        action = jnp.where(drives[:, None], self.drive(seen), self.collect(seen))
        if symmetry is not None:
            action = frames.unfold(action, symmetry)
        if self.drive.stretches:
            action = stretched(action, xi)
        action = jnp.where(sees, action, jnp.nan)
        return limited(world.dog, world.dog.speed * action)

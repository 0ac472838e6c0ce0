"""Your own law of sheep: the nearer the dog, the faster they flee.

Fly it:   skydog test h-ddpg-4x4 --world examples/own_law.py:world
Train:    skydog train --world examples/own_law.py:world --out runs/own
Play:     skydog watch h-ddpg-4x4 --world examples/own_law.py:world
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp

import skydog
from skydog.study import evaluate
from skydog.study.cases import cases
from skydog.world.vectors import limit, norm, unit


class Calm(eqx.Module):
    """The push of a dog and of other sheep fades with distance; who sees a dog keeps together."""

    sensing: float = 2.0  # metres: how far a sheep sees a dog
    room: float = 1.0  # metres that a sheep likes to have around it

    def force(self, state, key):
        """The force on each sheep (N, 2): 1 moves it at its full speed. See `skydog.Flock`."""
        fear, alarm = fading(state.sheep[:, None] - state.dogs, self.sensing)
        crowd, _ = fading(state.sheep[:, None] - state.sheep, self.room)
        together = unit(jnp.mean(state.sheep, axis=0) - state.sheep)
        return limit(2.0 * fear + 2.0 * crowd + alarm * together, 1.0)


def fading(away, reach):
    """Pushes that fall from 1 to 0 at `reach` metres, summed; and the strongest of them."""
    strength = jnp.clip(1.0 - norm(away) / reach, 0.0, 1.0)
    return jnp.sum(strength[..., None] * unit(away), axis=1), jnp.max(strength, 1, keepdims=True)


def world(arena: float = 4.0, sheep: int = 3) -> skydog.World:
    """The paper's world with calm sheep in it: what `--world` asks for, as a preset does."""
    return replace(skydog.preset("paper", arena, sheep), flock=Calm())


def main(count: int = 100) -> dict[str, dict]:
    """Fly two shepherds through the same starts; return their rows of figures."""
    here, rows = world(), {}
    starts = cases(here, count, starts="random", seed=1)
    for name, dog in {"strombom": skydog.Strombom(), "h-ddpg": skydog.load("h-ddpg-4x4")}.items():
        rows[name] = evaluate.row(evaluate.fly(here, dog, starts))
        print(f"{name:9} {rows[name]['success']:.0%} in {rows[name]['steps']['mean']:.0f} steps")
    return rows


if __name__ == "__main__":
    main()

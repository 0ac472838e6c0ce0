"""Your own end of a mission: most of the sheep are home.

Fly it:   skydog test strombom --world examples/own_end.py:world --sheep 10 --starts random
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp

import skydog
from skydog.study import evaluate
from skydog.study.cases import cases
from skydog.world import herding
from skydog.world.vectors import norm


class MostHome(eqx.Module):
    """The mission is accomplished when a share of the sheep is within 𝔻 of the goal."""

    share: float = 0.6

    def accomplished(self, world, state):
        """Whether the mission is accomplished in this state."""
        away = norm(state.sheep - herding.goal(world.arena))
        return jnp.mean(away <= world.arena.goal_radius) >= self.share


def world(arena: float = 8.0, sheep: int = 10) -> skydog.World:
    """The paper's world with that end."""
    return replace(skydog.preset("paper", arena, sheep), end=MostHome())


def main(count: int = 100) -> dict[str, dict]:
    """Fly the rule dog until all are home and until most are; return the rows of figures."""
    rows, starts = {}, cases(world(), count, starts="random", seed=1, sheep=10)
    for name, here in {"all": skydog.preset("paper", 8.0, 10), "most": world()}.items():
        flown = evaluate.fly(here, skydog.Strombom(), starts)
        rows[name] = row = evaluate.row(flown)
        print(f"{name:4} home: {row['success']:.0%} in {row['steps']['mean']:.0f} steps")
    return rows


if __name__ == "__main__":
    main()

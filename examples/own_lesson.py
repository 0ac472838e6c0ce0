"""Your own lesson: to patrol round the flock and leave it in peace, taught by our DDPG."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

import skydog
from skydog.learning import ddpg, train
from skydog.learning.lessons import Outcome
from skydog.study import cases, evaluate
from skydog.world import herding
from skydog.world.vectors import norm, unit

CIRCLE = 2.5  # metres from the flock's centre: further than its sheep see


class Patrol(eqx.Module):
    """What has these sizes and functions can be learnt: see `skydog.learning.train.Task`."""

    world: skydog.World
    observation: ClassVar[int] = 2  # the vector from the flock's centre to the dog, metres
    action: ClassVar[int] = 2  # its velocity, in shares of the speed limit

    def start(self, key):
        return skydog.reset(self.world, key), jnp.asarray(0)

    def observe(self, episode):
        return (episode[0].dogs - herding.gcm(episode[0].sheep))[0]

    def step(self, episode, action):
        before, number = episode
        after = skydog.step(self.world, before, self.world.dog.speed * action[None])
        out = self.observe((after, number))
        reward = jnp.cross(unit(out), action) - jnp.abs(norm(out) - CIRCLE)  # round, not off it
        never, over = jnp.asarray(False), number >= 99  # out of time; the task has no end
        return (after, number + 1), Outcome(reward, never, truncated=over, success=never)


def main(steps: int = 20_000) -> list[float]:
    """Fly 30 cases of half a minute untaught and taught; return the laps a minute of each."""
    lesson, laps = Patrol(skydog.preset("paper", arena=6.0)), []
    for taught in (0, steps):
        training, _ = train.train(lesson, ddpg.Config(), seed=0, steps=taught)

        def shepherd(world, state, skill=training.agent.skill):
            return world.dog.speed * skill(state.dogs - herding.gcm(state.sheep))

        flown = evaluate.fly(lesson.world, shepherd, cases.cases(lesson.world), steps=300)
        out = flown.dogs[:, :, 0] - flown.sheep.mean(axis=2)
        angle = jnp.unwrap(jnp.arctan2(out[..., 1], out[..., 0]), axis=1)
        laps.append(float(jnp.mean(angle[:, -1] - angle[:, 0])) / jnp.pi)
        off = jnp.mean(jnp.abs(norm(out) - CIRCLE))
        print(f"taught {taught} steps: {laps[-1]:.1f} laps a minute, {off:.2f} m off its circle")
    return laps


if __name__ == "__main__":
    main()

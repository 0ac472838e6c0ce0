"""Our side: worlds of three sheep and a dog, stepped in one compiled loop. Started by the
benchmark."""

import sys

import slices

slices.pin(int(sys.argv[1]))

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402

from skydog.world import mission  # noqa: E402
from skydog.world.presets import preset  # noqa: E402

CHUNK = 200  # steps of every world in a call

asked = slices.requests()
count = next(asked)["worlds"]
world = preset("paper")
states = jax.vmap(lambda key: mission.reset(world, key))(jax.random.split(jax.random.key(0), count))
velocity = jnp.array([[0.3, 0.1]])


@jax.jit
def on(states):
    def step(states, _):
        after = jax.vmap(mission.step, in_axes=(None, 0, None))(world, states, velocity)
        return after, None

    return jax.lax.scan(step, states, length=CHUNK)[0]


states = jax.block_until_ready(on(states))
slices.answer(jax=jax.__version__)
for request in asked:
    watch = slices.Watch()
    calls = max(1, round(request["steps"] / (CHUNK * count)))
    for _ in range(calls):
        states = on(states)
    jax.block_until_ready(states)
    watch.answer(calls * CHUNK * count)

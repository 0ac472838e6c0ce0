"""Our side: missions of the rule dog in one world, recorded. Started by the benchmark."""

import os
import sys

import slices

slices.pin(int(sys.argv[1]))
asked = slices.requests()
os.environ["XLA_FLAGS"] = next(asked)["flags"]

import jax  # noqa: E402

import skydog  # noqa: E402

STEPS = 1_000  # of a mission

world = skydog.preset("paper")
state = skydog.reset(world, jax.random.key(0))
fly = jax.jit(lambda state: skydog.rollout(world, skydog.Strombom(), state, STEPS))
trace = jax.block_until_ready(fly(state))
slices.answer(jax=jax.__version__)
for request in asked:
    watch = slices.Watch()
    calls = max(1, round(request["steps"] / STEPS))
    for _ in range(calls):
        trace = fly(state)
    jax.block_until_ready(trace)
    watch.answer(calls * STEPS)

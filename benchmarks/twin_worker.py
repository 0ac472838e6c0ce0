"""Our side: whole herding missions in the twin, from take-off to home. Started by the benchmark."""

import sys

import slices

slices.pin(int(sys.argv[1]))

from importlib.metadata import version  # noqa: E402

import jax  # noqa: E402
import numpy as np  # noqa: E402

import skydog  # noqa: E402
from skydog.flight import altitude, profiles  # noqa: E402
from skydog.twin import Twin, missions, starts  # noqa: E402
from skydog.world.mission import MAX_STEPS  # noqa: E402

STARTS = 20

asked = slices.requests()
task = next(asked)
together = task["missions"]  # in one call of the twin
twin = Twin(profile=task["profile"], threads=1)
world, shepherd = skydog.preset("paper", arena=6.0), skydog.load("h-ddpg-6x6")
uav, rover = profiles.uav(twin.profile), profiles.rover(twin.rovers)
begins = starts.draw(world, STARTS, "spaced", uav, rover)
take_off = altitude.HEIGHT / uav.velocity.largest_climb + missions.SETTLES  # s, simulated too


def fly(number: int) -> tuple[float, int]:
    """The missions of a call: seconds simulated in all of them, and how many came home."""
    which = np.arange(number * together, (number + 1) * together) % STARTS
    trace = twin(
        world,
        shepherd,
        jax.tree.map(lambda leaf: leaf[which], begins),
        MAX_STEPS,
        jax.random.key(number),
    )
    moved = np.any(np.diff(np.asarray(trace.dogs), axis=1) != 0.0, axis=(2, 3))
    flown = moved.sum(axis=1) * float(world.arena.dt)  # a mission that is over stands still
    return float(np.sum(take_off + flown)), int(np.sum(trace.accomplished[:, -1]))


fly(0)
slices.answer(**{name: version(name) for name in ("skydog", "mujoco", "jax", "numpy")})
for request in asked:
    watch = slices.Watch()
    found = [fly(number) for number in range(request["repeats"])]  # the same in every round
    simulated = sum(seconds for seconds, _ in found)
    watch.answer(
        round(simulated / twin.timestep),
        simulated=simulated,
        missions=together * len(found),
        home=sum(home for _, home in found),
    )

"""A mission as it is logged: by a rule dog in the kinematic world, with poses drawn at random."""

import time
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from skydog.flight.supervisor import Mode
from skydog.lab import bag
from skydog.lab.flightlog import Decision, Flight, FlightLog, Timing
from skydog.lab.messages import store2
from skydog.shepherds.strombom import Strombom
from skydog.world import mission
from skydog.world import trace as traces
from skydog.world.presets import preset
from skydog.world.trace import Poses

PATIENCE = 30.0  # s
DOGS, SHEEP = ("uav1", "uav2"), ("ugv1", "ugv2", "ugv3")
FLIGHT = Flight("a rule dog", preset("paper-w05", 4.0), DOGS, SHEEP, 40)
CARD = {"kind": "sheepdog", "seed": 1}
ROWS = ("sheep", "dogs", "subgoal", "drives", "command", "accomplished")
TURN = (0.0, 0.0, 0.6, 0.8)


@cache
def flown():
    """A mission that is accomplished."""
    nearly = jnp.array([[1.6, 1.6], [1.9, 1.6], [1.6, 1.9]])
    start = mission.start(nearly, jnp.array([[3.0, 3.0], [3.5, 3.0]]))
    rollout = jax.jit(mission.rollout, static_argnums=3)
    whole = rollout(FLIGHT.world, Strombom(), start, FLIGHT.steps)
    until = traces.last_instant(whole) + 1
    assert until < FLIGHT.steps
    draw = np.random.default_rng(1)
    shapes = {f.name: (until, 3) for f in fields(Poses)}
    shapes |= {"altitude": (until, 2), "attitude": (until, 2, 3), "setpoint": (until, 2, 3)}
    poses = Poses(**{n: jnp.asarray(draw.normal(size=s), jnp.float32) for n, s in shapes.items()})
    kept = {name: getattr(whole, name)[:until] for name in (*ROWS, "time")}
    ending = traces.Ending(jnp.asarray(traces.ACCOMPLISHED), jnp.asarray(FLIGHT.steps))
    return traces.Trace(world=FLIGHT.world, **kept, poses=poses, ending=ending)


def decisions(case=0):
    trace, force = flown(), np.zeros((3, 2))
    for step in range(len(trace.time)):
        rows: dict[str, Any] = {name: np.asarray(getattr(trace, name)[step]) for name in ROWS}
        rows |= {f.name: np.asarray(getattr(trace.poses, f.name)[step]) for f in fields(Poses)}
        yield Decision(case=case, step=step, force=force, **rows)


def fly(log, case=0):
    """Log a mission as the base station does."""
    now = time.monotonic()
    for step, decision in enumerate(decisions(case)):
        t = now + step * 0.1
        log.decision(decision, t)
        for name in (*DOGS, *SHEEP):
            log.seen(name, (1.0, 2.0, 0.01 * step), TURN, t)
            log.pose(name, (1.1, 2.0, 0.01 * step), TURN, t)
            log.command(name, (0.1, 0.0, 0.0), (0.0, 0.0, 0.5), t)
        log.timing(Timing(np.full(4, 0.01), 0.001, 0.002, 0.003, 0), t)
    log.transition(Mode.LANDING, "accomplished", "all are home", now)
    log.event("landed")


def written(folder: Path) -> Path:
    """The folder of a log that was closed."""
    log = FlightLog(folder, "[mission]\n", CARD, FLIGHT)
    fly(log)
    log.ended(0, "accomplished", FLIGHT.steps, time.monotonic())
    log.close()
    assert log.problem is None
    assert log.dropped == 0
    return folder


def read(path: Path, topic: str) -> list[Any]:
    """The messages of a topic."""
    found = bag.messages(bag.find(path), topic.__eq__)
    return [store2().deserialize_cdr(data, topic.kind) for topic, _, data in found]

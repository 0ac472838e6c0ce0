"""Missions through the whole chain, in real time: `Emulated` is a `Fly`, as the twin is."""

import multiprocessing
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from skydog import processes
from skydog.errors import Refusal
from skydog.flight.options import Steering
from skydog.lab import flightlog, running, setup
from skydog.lab.emulation.chain import Chain, Transport, a_site
from skydog.lab.emulation.room import Report, Start
from skydog.lab.orders import Orders
from skydog.lab.outcome import Outcome
from skydog.lab.setup import Setup
from skydog.lab.site import Mission, Site, UAVAdapter
from skydog.study import evaluate
from skydog.world import params
from skydog.world.mission import MAX_STEPS, Shepherd, count
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.trace import Trace

Say = Callable[[str], None]


class Flown(NamedTuple):
    """What came of a mission: how the base station saw it end, and what the room says."""

    outcome: Outcome
    room: Report
    log: Path


@dataclass(frozen=True)
class Emulated:
    """The whole chain on this machine: twin, tracker, UDP, base station, ROS 1 or DDS. A `Fly`.

    A mission takes as long as it would take in a laboratory. `logs` is the folder that keeps each
    mission's flight log; `said` is given every line that a base station says.
    """

    transport: Transport = "ros1"
    adapter: UAVAdapter | None = None
    profile: str | None = None
    disturb: str = "none"
    wait: float | None = None
    steering: Steering = "reference"
    logs: Path | None = None
    said: Say | None = None
    ended: Callable[[Flown], None] | None = None  # told of each mission

    def __call__(
        self,
        world: World,
        shepherd: Shepherd,
        starts: State,
        steps: int = MAX_STEPS,
        key: PRNGKeyArray | None = None,
        /,
    ) -> Trace:
        """One mission per start, one after another: a trace, cases along its first axis.

        `key` draws what goes wrong, as in the twin. Raises `Refusal` for a mission that could not
        begin: what the pre-flight checks say.
        """
        missions = len(starts.sheep)
        keys = jax.random.split(jax.random.key(0) if key is None else key, missions)
        flown = [
            self.one(world, shepherd, jax.tree.map(lambda leaf, i=i: leaf[i], starts), steps, one)
            for i, one in enumerate(np.asarray(jax.random.key_data(keys)).tolist())
        ]
        return evaluate.stack(flown)

    def one(
        self, world: World, shepherd: Shepherd, begin: State, steps: int, key: list[int]
    ) -> Trace:
        """One mission, whose disturbances the words of a key draw; otherwise as `__call__`."""
        arena = world.arena
        size = float(arena.size)
        mission = Mission(
            sheepdog=type(shepherd).__name__,
            steps=count(steps),
            wait=self.wait,
            steering=self.steering,
        )
        sheep = len(begin.sheep)
        if len(begin.dogs) != 1:
            raise Refusal(f"a laboratory flies one dog, got {len(begin.dogs)}")
        if params.noisy(world):
            raise Refusal("a laboratory has a noise of its own; fly a world without any")
        site = a_site(mission, size, self.transport, self.adapter, self.profile, sheep)
        start = Start(
            dogs=pairs(begin.dogs),
            sheep=pairs(begin.sheep),
            size=size,
            goal=(float(arena.goal_x), float(arena.goal_y), float(arena.goal_radius)),
            disturb=self.disturb,
            key=tuple(key),
        )
        made = Setup(world, shepherd, {}, setup.base(site, world))
        with TemporaryDirectory() as folder:
            home = self.logs or Path(folder)
            log = home / f"case-{sum(1 for _ in home.glob('case-*'))}"
            flown = fly(site, made, start, log, self.said)
            if self.ended is not None:
                self.ended(flown)
            if flown.outcome.steps == 0 and flown.outcome.how != "accomplished":
                raise Refusal("; ".join(flown.outcome.lines[-3:]) or "the flight did not begin")
            return _whole(flightlog.load(log)[0], steps)


def fly(site: Site, made: Setup, start: Start, log: Path, said: Say | None = None) -> Flown:
    """Fly one mission through a chain, the base station in a process of its own.

    Raises `Refusal` as the base station does.
    """
    with Chain(site, start) as chain:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(
            target=base_station, args=(chain.site, made, log, theirs), name="base station"
        )
        processes.start(process)
        theirs.close()
        try:
            while True:
                what, told = ours.recv()
                if what == "refused":
                    raise Refusal(told)
                if what == "over":
                    report = chain.report()
                    assert report is not None
                    return Flown(told, report, log)
                if said is not None:
                    said(told)
        except EOFError:
            raise Refusal("the base station has died; what it printed says why") from None
        finally:
            process.join(5.0)
            if process.is_alive():
                process.kill()
                process.join()


def base_station(site: Site, made: Setup, log: Path, wire: Connection) -> None:
    """The base station's process: it says lines over the wire, and at last its outcome."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders = Orders()
    try:
        outcome = running.fly(
            site,
            orders,
            running.Automatic(orders),
            log,
            running.as_json(site),
            said=lambda line: wire.send(("said", line)),
            made=made,
            here=log.parent,
        )
        wire.send(("over", outcome))
    except Refusal as refusal:
        wire.send(("refused", str(refusal)))


def pairs(places: Any) -> tuple[tuple[float, float], ...]:
    """Places in metres as plain numbers."""
    return tuple((float(x), float(y)) for x, y in np.asarray(places))


def _whole(trace: Trace, steps: int) -> Trace:
    """The trace, whose last instant stands until the steps that were given are over."""
    more = steps + 1 - len(trace.time)
    if more <= 0:
        return trace
    ending, world, time = trace.ending, trace.world, trace.time
    rest = replace(trace, ending=None, world=None, time=None)
    stood = jax.tree.map(
        lambda part: jnp.concatenate([part, jnp.repeat(part[-1:], more, axis=0)]), rest
    )
    dt = float(world.arena.dt)
    after = time[-1] + dt * jnp.arange(1, more + 1, dtype=time.dtype)
    return replace(stood, ending=ending, world=world, time=jnp.concatenate([time, after]))

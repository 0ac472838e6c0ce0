"""Long herdings of sheep that do not hold together, without a trace: when how many were home."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from skydog import numerics, quantities
from skydog.study.options import Progress
from skydog.world import herding, mission, params
from skydog.world.mission import Shepherd
from skydog.world.params import World
from skydog.world.state import State, start
from skydog.world.vectors import norm

CHUNK = 500  # steps between looks at which runs are over
A_FEW = 12  # runs that are herded on together, whichever of them are over
NEVER = -1


class Herds(NamedTuple):
    """What came of runs: one number for each."""

    share: Float[np.ndarray, " runs"]  # χ: the largest share of the sheep that was home at once
    settled: Int[np.ndarray, " runs"]  # the first step with a share of 0.99 home, or NEVER
    captured: Int[np.ndarray, " runs"]  # the first step with every sheep home, or NEVER


@numerics.ours()
def starts(world: World, runs: int, seed: int, sheep: int, dogs: int) -> State:
    """`runs` starts as `draw` has them, stacked: the same for the same arguments."""
    keys = jax.random.split(jax.random.key(quantities.SEED.checked(seed)), runs)
    return jax.jit(jax.vmap(lambda key: draw(world, key, sheep, dogs)))(keys)


def draw(world: World, key: PRNGKeyArray, sheep: int, dogs: int) -> State:
    """A start of Covone et al. 2025.

    Sheep and dogs are on a ring around the goal: the angle uniform, and so is the distance, from
    a metre beyond the goal to 0.9 of half the arena's side.
    """
    arena, count = world.arena, (sheep + dogs,)
    for_distance, for_angle = jax.random.split(key)
    distance = jax.random.uniform(
        for_distance, count, minval=arena.goal_radius + 1.0, maxval=0.45 * arena.size
    )
    angle = jax.random.uniform(for_angle, count, maxval=2.0 * jnp.pi)
    around = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    places = herding.goal(arena) + distance[:, None] * around
    return start(places[dogs:], places[:dogs])


class _Running(eqx.Module):
    """Runs that are herded together: as far as they have come, and what came of them so far."""

    state: State
    key: Key[Array, "*runs"]
    share: Float[Array, "*runs"]
    settled: Int[Array, "*runs"]
    captured: Int[Array, "*runs"]


@numerics.ours()
def herd(
    world: World,
    shepherd: Shepherd,
    begun: State,
    steps: int,
    key: PRNGKeyArray,
    progress: Progress = lambda step, over: None,
) -> Herds:
    """Herd from every start until every sheep is home at once, or for `steps` steps.

    Home is within 𝔻 of the goal. Noise is drawn as `evaluate.fly` draws it, so that run i is the
    mission that is flown from start i with the same key. `progress` is told the step, and how
    many runs are over by then.
    """
    count = len(begun.sheep)
    world, shepherd = params.traced(world), params.traced(shepherd)
    never = jnp.full(count, NEVER)
    running = _Running(begun, jax.random.split(key, count), jnp.zeros(count), never, never)
    at, who = 0, np.arange(count)  # which of all the runs are still in the batch
    share, settled, captured = np.zeros(count), np.full(count, NEVER), np.full(count, NEVER)
    while True:
        until = min(at + CHUNK, steps + 1)
        running = _chunk(world, shepherd, running, jnp.asarray(at), jnp.asarray(until))
        at = until
        share[who], settled[who] = np.asarray(running.share), np.asarray(running.settled)
        captured[who] = np.asarray(running.captured)
        on = captured[who] == NEVER
        progress(at - 1, count - int(on.sum()))
        if at > steps or not on.any():
            return Herds(share, settled, captured)
        if on.sum() <= len(on) // 2 and len(on) > A_FEW:
            # Half of them, the others among them: each size is compiled.
            keep = np.argsort(~on, kind="stable")[: len(on) // 2]
            who = who[keep]
            running = jax.tree.map(lambda leaf, keep=keep: leaf[keep], running)


@eqx.filter_jit
def _chunk(
    world: World,
    shepherd: Shepherd,
    running: _Running,
    at: Int[Array, ""],
    until: Int[Array, ""],
) -> _Running:
    def instant(now: Int[Array, ""], run: _Running) -> _Running:
        for_sheep = jax.random.split(jax.random.split(jax.random.fold_in(run.key, now))[0])[0]
        home = _home(world, run.state)
        share = jnp.mean(home, dtype=jnp.float32)
        all_home, many_home = jnp.all(home), world.end.accomplished(world, run.state)
        over = (run.captured != NEVER) | all_home
        decided = mission.decide(world, shepherd, run.state, key=for_sheep)
        after = mission.move(world, run.state, decided.velocity, decided.force)
        return _Running(
            jax.tree.map(lambda old, new: jnp.where(over, old, new), run.state, after),
            run.key,
            jnp.maximum(run.share, share),
            _first(now, many_home, run.settled),
            _first(now, all_home, run.captured),
        )

    def step(number: Int[Array, ""], running: _Running) -> _Running:
        return jax.vmap(partial(instant, number))(running)

    return jax.lax.fori_loop(at, until, step, running)


def _first(now: Int[Array, ""], happens: Bool[Array, ""], step: Int[Array, ""]) -> Int[Array, ""]:
    """The step at which something happened first: now, if it had not before."""
    return jnp.where((step == NEVER) & happens, now, step)


def _home(world: World, state: State) -> Bool[Array, " sheep"]:
    return norm(state.sheep - herding.goal(world.arena)) <= world.arena.goal_radius

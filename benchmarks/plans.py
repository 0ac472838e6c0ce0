"""Search for the best-known plans of the fixed cases; `make plans` runs it.

It writes a file after every case and, called again, continues behind the last. Every plan starts
from the flights of the sheepdogs that ship and of the rule dog, and from what the file of plans
that ships has, so that each call can only improve on it. A plan is kept if it does in float32 and
in float64: rounding must not decide it.
"""

import argparse
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import skydog
from skydog import files
from skydog.shepherds import planner
from skydog.study import best, cases, evaluate
from skydog.world import mission
from skydog.world.params import World
from skydog.world.state import State

DOGS = ("h-ddpg-4x4", "h-ddpg-6x6", "dhrl-4x4", "dhrl-6x6")
COUNTS = {"paper": 30, "random": 200}
LONGEST = 512  # steps of a plan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/plans"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=planner.Config.rounds)
    parser.add_argument("--anew", action="store_true", help="forget the plans that ship")
    options = parser.parse_args()
    for (starts, arena), name in best.SHIPPED.items():
        world = skydog.preset("paper", arena)
        drawn = first(cases.shipped(world, starts), COUNTS[starts])
        flights = flown(world, drawn)
        known = None if options.anew else best.plans(starts, arena)
        path = options.out / name
        found = best.read(path.read_text(), str(path)) if path.exists() else []
        for case in range(len(found), COUNTS[starts]):
            began = time.perf_counter()
            own = [flight[case] for flight in flights]
            if known is not None and case < len(known.steps):
                own.append(known.velocity[case, : known.steps[case]])
            state = jax.tree.map(lambda leaf, case=case: leaf[case], drawn)
            key = jax.random.fold_in(jax.random.key(options.seed), case)
            plan = search(world, state, own, key, planner.Config(rounds=options.rounds))
            found.append(np.asarray(plan.velocity[:, 0], np.float64))
            files.write_text(path, best.as_table(found))
            took = time.perf_counter() - began
            shortest = min(map(len, own))
            print(f"{name} {case + 1}: {plan.steps} of {shortest} in {took:.1f} s", flush=True)
        report(name, np.array([len(plan) for plan in found]), flights)


def first(drawn: State, count: int) -> State:
    return jax.tree.map(lambda leaf: leaf[:count], drawn)


def flown(world: World, drawn: State) -> list[list[np.ndarray]]:
    """The velocities of each dog's flight of each case, as far as it was flown."""
    flights = []
    for dog in (*map(skydog.load, DOGS), skydog.Strombom()):
        traces = evaluate.fly(world, dog, drawn)
        steps = evaluate.measure(traces)["steps"].astype(int)
        command = np.asarray(traces.command)
        flights.append([each[:count] for each, count in zip(command, steps, strict=True)])
    return flights


def search(
    world: World, state: State, flights: list[np.ndarray], key: jax.Array, config: planner.Config
) -> planner.Plan:
    """The best plan that rounding does not decide."""

    def same_in_float64(plan: planner.Plan) -> bool:
        return steps_in_float64(world, state, plan.velocity) == plan.steps

    plan = planner.plan(world, state, flights, key, config, same_in_float64)
    if not same_in_float64(plan):
        print(f"    rounding decides the best flight, of {plan.steps} steps: give another --seed")
    return plan


def steps_in_float64(world: World, state: State, velocity: jax.Array) -> int | None:
    """The step in which a plan is accomplished, if numbers have 16 digits; None if never."""
    digits = np.zeros((LONGEST, *velocity.shape[1:]))
    digits[: len(velocity)] = np.round(np.asarray(velocity, np.float64), planner.DECIMALS)
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), jnp.float64), state)
        done = np.asarray(accomplished(world, exact, jnp.asarray(digits)))[: len(velocity)]
    return int(np.argmax(done)) + 1 if done.any() else None


@eqx.filter_jit
def accomplished(world: World, state: State, velocity: jax.Array) -> jax.Array:
    def step(state, velocity):
        after = mission.step(world, state, velocity)
        return after, mission.accomplished(world, after)

    return jax.lax.scan(step, state, velocity)[1]


def report(name: str, steps: np.ndarray, flights: list[list[np.ndarray]]) -> None:
    print(f"{name}: mean of best-known steps {steps.mean():.1f}")
    for dog, own in zip((*DOGS, "strombom"), flights, strict=True):
        lengths = np.array([len(flight) for flight in own])
        times = best.times_best(lengths, steps)
        low, high = times["ci95"]
        print(f"    {dog}: {lengths.mean():.1f}, {times['mean']:.3f} [{low:.3f}, {high:.3f}] times")


if __name__ == "__main__":
    main()

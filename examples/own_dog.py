"""Your own dog: a shepherd that goes round the flock instead of through it."""

import jax.numpy as jnp

import skydog
from skydog.study import evaluate, statistics
from skydog.study.cases import cases
from skydog.world import herding
from skydog.world.mission import fastest
from skydog.world.vectors import norm, unit

BEHIND = 0.7  # cosine of the angle, seen from the flock, above which it flies to its subgoal


def circler(world: skydog.World, state: skydog.State):
    """Velocities of the dogs, in m/s: any function like this one is a shepherd."""
    subgoal, _ = herding.gate(world, state.sheep, state.dogs)
    centre = herding.gcm(state.sheep)
    out = unit(state.dogs - centre)  # from the flock to each dog
    there = unit(subgoal - centre)
    cosine = jnp.sum(out * there, axis=-1, keepdims=True)

    # Round on the shorter side, and meanwhile out to the circle or in to it.
    left = jnp.stack([-out[:, 1], out[:, 0]], axis=-1)
    side = jnp.where(jnp.sum(left * there, axis=-1, keepdims=True) >= 0.0, 1.0, -1.0)
    room = herding.gathered_radius(world, len(state.sheep))  # f(N), metres
    too_near = room - norm(state.dogs - centre)[:, None]
    around = side * left + jnp.clip(too_near, -1.0, 1.0) * out
    return fastest(world.dog, jnp.where(cosine >= BEHIND, subgoal - state.dogs, around))


def main(count: int = 200) -> dict[str, dict]:
    """Fly it and the rule dog through the same starts at the same speed limit; return rows."""
    world = skydog.preset("paper", arena=6.0)
    starts = cases(world, count, starts="random", seed=1)
    measured = {
        name: evaluate.measure(evaluate.fly(world, shepherd, starts))
        for name, shepherd in {"strombom": skydog.Strombom(), "circler": circler}.items()
    }
    rows = {name: evaluate.figures(of) for name, of in measured.items()}
    for name, row in rows.items():
        print(f"{name:9} success {row['success']:.1%}, steps {row['steps']['mean']:.0f}")
    for what in ("steps", "distance"):
        gain = statistics.paired(measured["circler"][what], measured["strombom"][what])
        low, high = gain["ci95"]
        print(f"{what}, circler less strombom: {gain['mean']:+.1f} [{low:+.1f}, {high:+.1f}]")
        rows["circler"][f"{what} less strombom's"] = gain
    return rows


if __name__ == "__main__":
    main()

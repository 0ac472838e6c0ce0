"""The parameters of a world, and presets: named sets of them, every value with its source."""

import math
from collections.abc import Callable
from dataclasses import fields
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from skydog.errors import Refusal
from skydog.world.vectors import Scalar

LARGEST = 1e9  # of a world's parameters in a file: far from where float32 overflows
Tree = TypeVar("Tree")


class Flock(eqx.Module):
    """How sheep feel and move. Lengths in metres, speeds in m/s, weights dimensionless."""

    avoidance: Scalar  # R_ππ: sheep nearer than this push each other away
    sensing: Scalar  # R_πβ: a sheep sees a dog that is nearer than this
    inertia: Scalar  # W_πυ: weight of the previous step's force
    grouping: Scalar  # W_πΛ: weight of the pull to the local centre of mass
    escape: Scalar  # W_πβ: weight of the push away from dogs
    repulsion: Scalar  # W_ππ: weight of the push away from other sheep
    speed: Scalar  # V_UGV: how fast a sheep moves, when it moves
    spread: Scalar  # f(N) / N^(2/3), Eq. 7: how wide a gathered flock may be
    noise: Scalar = 0.0  # weight of a random unit vector in the force (Strömbom's e)
    graze: Scalar = 0.0  # chance a step that a sheep which nothing pushes moves at random
    # The local centre of mass is that of the n nearest flockmates; None is all of them.
    neighbours: int | None = eqx.field(static=True, default=None)
    # The equations as printed: forces summed, not normalised, and grouping without a dog.
    literal_forces: bool = eqx.field(static=True, default=False)


class Dog(eqx.Module):
    """How dogs fly and where they aim. Lengths in metres, speeds in m/s."""

    speed: Scalar  # the fastest that a dog flies
    driving: Scalar  # driving point: this times √N behind the flock
    collecting: Scalar  # collecting point: this far behind the stray
    airspace: Scalar  # how far beyond the arena's walls a dog may fly
    stall: Scalar = 0.0  # the rule dog stands while a sheep is nearer than this; 0 is off
    actuation_noise: Scalar = 0.0  # SD of the error of each component of a flown velocity
    perception_noise: Scalar = 0.0  # SD of the error of each coordinate that a dog sees
    # Whether `speed` bounds each component of the velocity, or the velocity's length.
    per_axis: bool = eqx.field(static=True, default=False)


class Arena(eqx.Module):
    """The square that the sheep cannot leave, and the goal. Metres and seconds."""

    size: Scalar  # L: the length of a side
    goal_x: Scalar = 0.0
    goal_y: Scalar = 0.0
    goal_radius: Scalar = 2.0  # 𝔻: every sheep must come as near as this to the goal
    dt: Scalar = 0.1


class World(eqx.Module):
    """Everything that a mission takes for granted: a tree of numbers, fit for jit and vmap."""

    flock: Flock
    dog: Dog
    arena: Arena


def paper(arena: float = 4.0, sheep: int = 3) -> World:
    """Nguyen et al. 2020 (arXiv 2004.11543), Table "Parameters in setups".

    What the paper leaves open is filled from its authors' group (El-Fiqi et al. 2020) and
    from Strömbom et al. 2014, and marked so.
    """
    growth = max(1.0, math.sqrt(sheep / 3))
    return World(
        Flock(
            avoidance=1.0,  # paper, Table "setups": R_ππ
            # paper, Table "setups": R_πβ, for its N = 3. From five sheep on the driving point is
            # further from the flock's centre than that: sight grows as the flock does (ours).
            sensing=2.0 * growth,
            inertia=0.5,  # not in the paper; Strömbom 2014 (h), El-Fiqi 2020
            grouping=1.05,  # not in the paper; Strömbom 2014 (c), El-Fiqi 2020
            escape=1.0,  # not in the paper; Strömbom 2014 (ρ_s), El-Fiqi 2020
            # El-Fiqi 2020. The paper's table prints "W_ππ 0.5 (m)", in metres: see `paper-w05`.
            repulsion=2.0,
            speed=0.5,  # paper, Table "setups": V_UGVs
            # paper, Table "setups": f(N) = 1.3 m, for its N = 3 (Eq. 7 would give 2.08 m).
            spread=1.3 / 3 ** (2 / 3),
        ),
        Dog(
            speed=1.0,  # paper, "Action and state space": [-1, 1] m/s on each axis
            driving=1.0,  # paper, "Problem Formulation": R_ππ √N behind the flock
            collecting=1.0,  # paper, "Problem Formulation": R_ππ behind the stray
            airspace=1.4,  # not in the paper; its authors' laboratory code, 2019
            stall=0.0,  # Strömbom's 3 R_ππ is 3 m here and would stall the dog for good
            per_axis=True,  # paper, "Action and state space"
        ),
        Arena(
            size=arena,  # paper, "Experimental setups": 4 and 6 m
            # paper, Table "setups": 𝔻, for its N = 3. Ten sheep, a metre apart, do not fit in
            # the quarter disc that lies in the arena: the goal grows as the flock does (ours).
            goal_radius=2.0 * growth,
            dt=0.1,  # paper, Table "setups"; the goal (0, 0) is from the laboratory code
        ),
    )


def paper_w05(arena: float = 4.0, sheep: int = 3) -> World:
    """The `paper` preset with the paper's printed W_ππ = 0.5 (Table "Parameters in setups")."""
    return eqx.tree_at(lambda w: w.flock.repulsion, paper(arena, sheep), 0.5)


def strombom2014(arena: float = 150.0, sheep: int = 3) -> World:
    """Strömbom et al. 2014 (J. R. Soc. Interface 11), for a flock of any size.

    Its units are a step and "about a metre"; one step is one second here.
    """
    return World(
        Flock(
            avoidance=2.0,  # r_a
            sensing=65.0,  # r_s
            inertia=0.5,  # h
            grouping=1.05,  # c
            escape=1.0,  # ρ_s
            repulsion=2.0,  # ρ_a
            speed=1.0,  # δ
            spread=2.0,  # f(N) = r_a N^(2/3)
            noise=0.3,  # e
            graze=0.05,  # p
            neighbours=None,  # n = N - 1, the largest that the paper studies
        ),
        Dog(
            speed=1.5,  # δ_s
            driving=2.0,  # r_a √N behind the flock
            collecting=2.0,  # r_a behind the stray
            airspace=arena,  # the original dog knows no walls; ours keeps numbers finite
            stall=6.0,  # 3 r_a
            per_axis=False,
        ),
        # Arrival within 10 of the target, there for the centre of mass; a flock that fills
        # a wider circle, of radius f(N), needs a wider goal (ours).
        Arena(size=arena, goal_radius=max(10.0, 2.0 * sheep ** (2 / 3)), dt=1.0),
    )


PRESETS: dict[str, Callable[..., World]] = {
    "paper": paper,
    "paper-w05": paper_w05,
    "strombom2014": strombom2014,
}


def preset(name: str = "paper", arena: float | None = None, sheep: int = 3) -> World:
    """A world by the name of its preset, for `sheep` sheep in an arena of `arena` metres.

    An arena of None is the preset's own. Raises `Refusal` for an unknown name, an
    arena that is not wider than the goal, or a flock of fewer than one sheep.
    """
    if name not in PRESETS:
        raise Refusal(f"no preset is called {name!r}; choose from {', '.join(PRESETS)}")
    if sheep < 1:
        raise Refusal(f"a flock has at least 1 sheep, got {sheep}; try --sheep 3")
    make = PRESETS[name]
    world = make(sheep=sheep) if arena is None else make(arena=arena, sheep=sheep)
    radius = world.arena.goal_radius
    if not radius < world.arena.size < math.inf:
        raise Refusal(
            f"arena must be longer than {radius:g} m (the goal disc), got {world.arena.size}; "
            f"try --arena {2 * radius:g}"
        )
    return world


def noisy(world: World) -> bool:
    """Whether the world's parameters ask for chance: a mission in it then needs a key."""
    flock, dog = world.flock, world.dog
    return any(
        float(chance) != 0.0
        for chance in (flock.noise, flock.graze, dog.actuation_noise, dog.perception_noise)
    )


def traced(tree: Tree) -> Tree:
    """A world, or a shepherd, with its plain numbers as arrays.

    As arrays they are arguments of what is compiled, which then serves every number.
    """
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf, jnp.float32) if isinstance(leaf, float) else leaf, tree
    )


def flatten(world: World) -> dict[str, float | int | bool | None]:
    """The parameters by dotted name, `flock.speed` and so on, as plain numbers for a file."""
    return {
        f"{part}.{field.name}": _plain(getattr(getattr(world, part), field.name))
        for part in ("flock", "dog", "arena")
        for field in fields(getattr(world, part))
    }


def unflatten(values: dict[str, float | int | bool | None]) -> World:
    """The inverse of `flatten`. Raises `Refusal` if a name is missing, unknown or no number."""
    parts = {"flock": Flock, "dog": Dog, "arena": Arena}
    known = {f"{part}.{field.name}" for part, kind in parts.items() for field in fields(kind)}
    if set(values) != known:
        odd = ", ".join(sorted(known ^ set(values)))
        raise Refusal(f"world parameters missing, or unknown to this version of skydog: {odd}")
    for name, value in values.items():
        if not _fits(name, value):
            raise Refusal(f"{value!r} is no value for the world parameter {name}")
    return World(
        *(
            kind(**{f.name: values[f"{part}.{f.name}"] for f in fields(kind)})
            for part, kind in parts.items()
        )
    )


def _fits(name: str, value: object) -> bool:
    if name in ("flock.literal_forces", "dog.per_axis"):
        return isinstance(value, bool)
    if isinstance(value, bool):
        return False
    if name == "flock.neighbours":
        return value is None or (isinstance(value, int) and value >= 1)
    return isinstance(value, int | float) and abs(value) <= LARGEST


def _plain(value: object) -> float | int | bool | None:
    return value if value is None or isinstance(value, bool | int) else float(value)  # pyright: ignore[reportArgumentType]

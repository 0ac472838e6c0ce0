"""Worlds and states for hypothesis to draw, degenerate ones among them.

Positions lie on a lattice of 1/8 m, exact in float32, so that a distance of exactly R is the
same tie in float32 and in float64.
"""

from dataclasses import fields, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

from skydog.world.laws.paper import PaperFlock
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.state import State

CELL = 8  # lattice points in a metre
SHAPES = [(1, 1), (3, 1), (3, 2), (5, 3)]  # sheep, dogs: each compiles once


def points(low: float, high: float):
    coordinate = st.integers(round(low * CELL), round(high * CELL)).map(lambda i: i / CELL)
    return st.tuples(coordinate, coordinate)


@st.composite
def states(draw, low: float, high: float, beyond: float = 1.0, shapes=SHAPES) -> State:
    """Sheep in [low, high]², now and then on one another; dogs `beyond` it, or on a sheep."""
    sheep_count, dog_count = draw(st.sampled_from(shapes))
    sheep = [draw(points(low, high))]
    while len(sheep) < sheep_count:
        sheep.append(draw(points(low, high) | points(low, high) | st.sampled_from(sheep)))
    anywhere = points(low - beyond, high + beyond)
    dogs = [draw(anywhere | anywhere | st.sampled_from(sheep)) for _ in range(dog_count)]
    before = st.sampled_from([(0.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.6, 0.8), (-0.8, 0.6)])
    force = [draw(before) for _ in range(sheep_count)]
    return State(*(jnp.asarray(np.array(part, np.float32)) for part in (sheep, dogs, force)))


def _with(world: World, part: str, **changes) -> World:
    return replace(world, **{part: replace(getattr(world, part), **changes)})


@st.composite
def scenes(draw, law: Any = PaperFlock, shapes=SHAPES, **parameters):
    """A world of the paper or of another law, its goal anywhere or on a sheep, and a state."""
    size = draw(st.sampled_from([4.0, 6.0]))
    state = draw(states(0.0, size, shapes=shapes))
    world = preset(draw(st.sampled_from(["paper", "paper-w05"])), size, len(state.sheep))
    on_a_sheep = tuple(float(x) for x in state.sheep[0])
    goal_x, goal_y = draw(st.just((0.0, 0.0)) | points(0.0, size) | st.just(on_a_sheep))
    world = _with(world, "arena", goal_x=goal_x, goal_y=goal_y)
    world = _with(world, "dog", nearness=draw(st.sampled_from([0.0, 0.5, 1.0])))
    # Sight that does not grow with the flock: lattice ties at R_πβ = 2 are then exact.
    weights = {**vars(world.flock), "sensing": 2.0, **parameters}
    return replace(world, flock=law(**weights)), state


@st.composite
def mixed_scenes(draw, law: Any = PaperFlock, shapes=SHAPES):
    """A scene in which each sheep has its own of every parameter, its speed included."""
    world, state = draw(scenes(law, shapes))
    count = len(state.sheep)

    def each(low, high):
        number = st.integers(round(low * CELL), round(high * CELL)).map(lambda i: i / CELL)
        values = draw(st.lists(number, min_size=count, max_size=count))
        return jnp.asarray(np.array(values, np.float32))

    ranges = {"avoidance": (0.0, 2.0), "sensing": (0.5, 4.0)}
    weights = {
        field.name: each(*ranges.get(field.name, (0.0, 2.0)))
        for field in fields(PaperFlock)
        if field.name != "noise"
    }
    sheep = replace(world.sheep, speed=each(0.0, 1.0))
    return replace(world, flock=law(**weights), sheep=sheep), state


@st.composite
def open_scenes(draw, shapes=SHAPES):
    """A scene in the middle of an arena so wide that no wall is in reach, the goal at hand."""
    state = draw(states(48.0, 52.0, shapes=shapes))
    world = preset("paper", 100.0, len(state.sheep))
    goal_x, goal_y = draw(points(46.0, 54.0))
    return _with(world, "arena", goal_x=goal_x, goal_y=goal_y), state


def commands(dogs: int, most: float = 2.0):
    component = st.integers(round(-most * CELL), round(most * CELL)).map(lambda i: i / CELL)
    velocity = st.lists(component, min_size=2 * dogs, max_size=2 * dogs)
    return velocity.map(lambda v: jnp.asarray(np.array(v, np.float32).reshape(dogs, 2)))


def numbers(state: State):
    """Sheep, dogs and force as float64, for the reference."""
    return tuple(np.asarray(part, float) for part in (state.sheep, state.dogs, state.force))

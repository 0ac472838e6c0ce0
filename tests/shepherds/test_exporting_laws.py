"""Which worlds an ONNX file can hold."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import pytest

from skydog.errors import Refusal
from skydog.shepherds import exporting, store
from skydog.world.presets import preset


class Own(eqx.Module):
    """A law of one's own, of any kind."""

    def radius(self, sheep):
        return 1.0

    def way(self, world, sheep):
        return world.home.way(world, sheep)

    def limit(self, velocity, speed):
        return velocity

    def fastest(self, direction, speed):
        return direction

    def force(self, state, key):
        return jnp.zeros_like(state.sheep)

    def accomplished(self, world, state):
        return jnp.asarray(False)


@pytest.mark.parametrize("part", ["spread", "home", "limits"])
def test_a_law_that_the_file_cannot_hold_is_refused_by_its_name(part):
    sheepdog, card = store.read("h-ddpg-4x4")
    world = preset("paper")
    if part == "limits":
        world = replace(world, dog=replace(world.dog, limits=Own()))
    else:
        world = replace(world, **{part: Own()})
    with pytest.raises(Refusal, match=r"not own: .*Own"):
        exporting.model(sheepdog, world, card)


def test_sheep_of_another_law_and_another_end_change_nothing_in_the_file():
    sheepdog, card = store.read("h-ddpg-4x4")
    world = preset("paper")
    other = replace(world, flock=Own(), end=Own())
    usual, changed = (exporting.model(sheepdog, each, card).graph for each in (world, other))
    assert usual == changed


def test_a_world_with_a_scene_is_refused():
    sheepdog, card = store.read("h-ddpg-4x4")
    with pytest.raises(Refusal, match="an ONNX file has no obstacles; take a world without"):
        exporting.model(sheepdog, preset("paper", scene="gate"), card)
    wide = replace(preset("paper"), arena=replace(preset("paper").arena, height=3.0))
    with pytest.raises(Refusal, match="an ONNX file has no arenas that are not square"):
        exporting.model(sheepdog, wide, card)

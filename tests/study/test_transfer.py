import jax
import numpy as np

from skydog.shepherds.networks import Actor
from skydog.shepherds.sheepdog import Sheepdog
from skydog.study import evaluate, transfer
from skydog.study.cases import shipped
from skydog.world.presets import preset


def a_sheepdog(seed=0):
    collect, drive = (Actor(4, 2, (6,), jax.random.key(seed + i)) for i in range(2))
    return Sheepdog(collect, drive, 4.0)


def test_a_dog_without_xi_flies_in_any_arena_what_its_skills_say():
    dog, world = a_sheepdog(), preset("paper", 6.0)
    state = jax.tree.map(lambda leaf: leaf[0], shipped(world, "paper"))
    at_home = Sheepdog(dog.collect, dog.drive, 6.0)
    np.testing.assert_array_equal(transfer.unscaled(dog, 6.0)(world, state), at_home(world, state))
    assert not np.array_equal(transfer.scaled(dog, 6.0)(world, state), at_home(world, state))


def test_several_dogs_count_together_in_each_arena():
    dogs = [a_sheepdog(0), a_sheepdog(5)]
    rows = transfer.sweep(evaluate.fly, dogs, transfer.scaled, [3.0])
    assert list(rows) == ["3"]
    assert rows["3"]["cases"] == 60
    world = preset("paper", 3.0)
    alone = [evaluate.row(evaluate.fly(world, dog, shipped(world, "paper"))) for dog in dogs]
    for metric in ("steps", "distance"):
        mean = np.mean([row[metric]["mean"] for row in alone])
        np.testing.assert_allclose(rows["3"][metric]["mean"], mean, rtol=1e-6)

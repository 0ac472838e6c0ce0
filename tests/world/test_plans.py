"""The shipped plans as whole missions in plain NumPy: what they claim, and our physics with it."""

import numpy as np
import pytest
import reference

from skydog.study import best, cases
from skydog.world.presets import preset


def steps(world, sheep, dogs, velocity):
    """When a mission is accomplished by velocities; None if it is not."""
    previous = np.zeros_like(sheep)
    for step, told in enumerate(velocity, 1):
        sheep, dogs, previous = reference.step(world, sheep, dogs, previous, told)
        if reference.accomplished(world, sheep):
            return step
    return None


@pytest.mark.parametrize(("starts", "arena"), list(best.SHIPPED))
def test_every_plan_is_accomplished_in_its_steps_in_plain_numpy(starts, arena):
    world, known = preset("paper", arena), best.plans(starts, arena)
    assert known is not None
    drawn = cases.shipped(world, starts)
    sheep, dogs = np.asarray(drawn.sheep, float), np.asarray(drawn.dogs, float)
    velocity = np.asarray(known.velocity, float).round(3)  # as the file has them
    found = [
        steps(world, *case)
        for case in zip(sheep[: len(velocity)], dogs[: len(velocity)], velocity, strict=True)
    ]
    assert found == known.steps.tolist()

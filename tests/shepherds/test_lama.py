import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.shepherds.lama import Lama
from skydog.world import mission
from skydog.world.presets import preset

WORLD = preset("lama2024")
GOAL = np.array([25.0, 25.0])


def expected(sheep, dogs):
    """Lama & di Bernardo 2024 in its limit γ → ∞, a dog at a time."""
    chosen = [int(np.argmin([math.hypot(*(at - dog)) for dog in dogs])) for at in sheep]
    found = []
    for number, dog in enumerate(dogs):
        own = [at - GOAL for at, whose in zip(sheep, chosen, strict=True) if whose == number]
        if own:
            furthest = max(own, key=lambda at: math.hypot(*at))
            velocity = 5.0 * (GOAL + furthest * (1 + 1.25 / math.hypot(*furthest)) - dog)
        else:
            home = GOAL - dog
            velocity = 8.0 * home / math.hypot(*home) if math.hypot(*home) >= 5.0 else 0.0 * home
        found.append(np.clip(velocity, -8.0, 8.0))
    return found


@given(st.integers(0, 2**31), st.sampled_from([(1, 1), (1, 3), (8, 3)]))
def test_dogs_chase_the_furthest_of_their_own_as_in_the_paper(seed, count):
    draw = np.random.default_rng(seed)
    sheep, dogs = (draw.uniform(0.0, 50.0, (many, 2)) for many in count)
    flown = Lama()(WORLD, mission.start(jnp.asarray(sheep), jnp.asarray(dogs)))
    np.testing.assert_allclose(flown, expected(sheep, dogs), atol=1e-3)


@pytest.mark.parametrize(
    ("dog", "velocity"), [((25.0, 35.0), (0.0, -8.0)), ((25.0, 29.0), (0.0, 0.0))]
)
def test_a_dog_without_sheep_waits_in_the_goal(dog, velocity):
    sheep, other = jnp.array([[10.0, 25.0]]), (9.0, 25.0)
    flown = Lama()(WORLD, mission.start(sheep, jnp.array([other, dog])))
    np.testing.assert_allclose(flown[1], velocity, atol=1e-5)


def test_a_sheep_in_the_middle_of_the_goal_is_no_error():
    state = mission.start(jnp.array([GOAL]), jnp.array([GOAL, GOAL]))
    assert np.isfinite(Lama()(WORLD, state)).all()

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toys import QUICK, Count

from skydog.learning import train
from skydog.learning.noise import ornstein_uhlenbeck


@pytest.mark.parametrize(("theta", "sigma"), [(0.15, 0.2), (0.5, 1.0), (1.0, 0.3)])
def test_in_the_long_run_the_noise_has_mean_zero_and_the_sd_of_its_formula(theta, sigma):
    def walk(noise, kick):
        noise = ornstein_uhlenbeck(noise, theta, sigma, kick)
        return noise, noise

    kicks = jax.random.normal(jax.random.key(0), (2_000, 500))
    _, walked = jax.lax.scan(walk, jnp.zeros(500), kicks)
    settled = np.asarray(walked[200:])
    sd = sigma / np.sqrt(2 * theta - theta**2)
    assert abs(settled.mean()) < 0.01 * sd
    assert abs(settled.std() / sd - 1) < 0.01
    # It persists: neighbours in time are alike by 1 - theta.
    alike = np.mean(settled[1:] * settled[:-1]) / np.mean(settled**2)
    assert abs(alike - (1 - theta)) < 0.01


def test_the_noise_is_at_rest_when_an_episode_begins_and_only_then():
    task = Count(cut=3)
    for steps, rests in ((1, False), (2, False), (3, True), (4, False)):
        training = train.init(task, QUICK, jax.random.key(0))
        training, _ = train.advance(task, QUICK, training, jax.random.key(1), steps)
        assert (training.agent.noise == 0.0).all() == rests

import numpy as np
import pytest

from skydog.flight import estimate

DT = 0.01


def follow(places, fresh=None):
    """The estimates of a body that is seen at these places, one after the other."""
    found = estimate.start(places[0][None])
    fresh = np.ones(len(places), bool) if fresh is None else fresh
    every = []
    for place, seen in zip(places[1:], fresh[1:], strict=True):
        found = estimate.update(found, place[None], np.array([seen]), DT)
        every.append(found)
    return every


def line(count, velocity=(0.7, -0.4)):
    return 1.0 + DT * np.arange(count)[:, None] * np.array(velocity)


def test_a_body_in_uniform_motion_is_found_exactly_in_the_limit():
    places = line(200)
    found = follow(places)[-1]
    np.testing.assert_allclose(found.position[0], places[-1], atol=1e-12)
    np.testing.assert_allclose(found.velocity[0], [0.7, -0.4], atol=1e-10)


def test_a_change_of_velocity_is_found_within_a_tenth_of_a_second():
    places = np.concatenate([np.ones((5, 2)), line(12)])
    error = follow(places)[-1].velocity[0] - [0.7, -0.4]
    assert np.linalg.norm(error) < 0.1 * np.hypot(0.7, 0.4)


def test_a_body_that_is_not_seen_moves_on_as_it_did():
    places, fresh = line(120), np.ones(120, bool)
    places[100:] = 99.0  # what a frame says that shows nothing
    fresh[100:] = False
    found = follow(places, fresh)[-1]
    np.testing.assert_allclose(found.position[0], line(120)[-1], atol=1e-9)
    np.testing.assert_allclose(found.velocity[0], [0.7, -0.4], atol=1e-9)


def test_one_body_is_missed_while_another_is_seen():
    before = estimate.start(np.zeros((2, 3)))
    after = estimate.update(before, np.ones((2, 3)), np.array([True, False]), DT)
    assert np.all(after.position[0] > 0.0)
    np.testing.assert_array_equal(after.position[1], 0.0)


def test_noise_is_reduced_and_leaves_no_bias():
    rng = np.random.default_rng(0)
    noise = 0.002 * rng.standard_normal((4000, 2))
    found = follow(noise)[50:]
    position = np.array([each.position[0] for each in found])
    velocity = np.array([each.velocity[0] for each in found])
    assert position.std() < 0.85 * 0.002
    # A difference of two frames would be off by √2 · 0.2 m/s.
    assert velocity.std() < 0.35 * np.sqrt(2.0) * 0.002 / DT
    assert abs(position.mean()) < 1e-4


def test_the_filter_is_critically_damped():
    # Its poles are both at `FORGETS`: it comes back from a jump without ringing twice.
    polynomial = [1.0, estimate.ALPHA + estimate.BETA - 2.0, 1.0 - estimate.ALPHA]
    np.testing.assert_allclose(np.roots(polynomial), estimate.FORGETS, atol=1e-6)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_a_body_that_stands_is_estimated_to_stand(axes):
    places = np.full((10, axes), 3.0)
    found = follow(places)[-1]
    np.testing.assert_array_equal(found.position, 3.0)
    np.testing.assert_array_equal(found.velocity, 0.0)

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.world.vectors import limit, norm, unit

coordinate = st.just(0.0) | st.builds(
    lambda sign, exponent: sign * 10.0**exponent, st.sampled_from([-1, 1]), st.floats(-15, 15)
)
vectors = st.tuples(coordinate, coordinate).map(jnp.array)
jit_norm, jit_unit, jit_limit = jax.jit(norm), jax.jit(unit), jax.jit(limit)
gradient_of_norm = jax.jit(jax.grad(norm))
jacobian_of_unit = jax.jit(jax.jacobian(unit))
jacobian_of_limit = jax.jit(jax.jacobian(limit, argnums=(0, 1)))


@given(vectors)
def test_norm_is_the_euclidean_length_over_thirty_magnitudes(v):
    np.testing.assert_allclose(jit_norm(v), np.hypot(*np.asarray(v, float)), rtol=1e-6)


@given(vectors)
def test_unit_keeps_the_direction_and_has_length_one_or_zero(v):
    x, y = np.asarray(v, float)
    expected = np.array([x, y]) / np.hypot(x, y) if np.hypot(x, y) > 0 else np.zeros(2)
    np.testing.assert_allclose(jit_unit(v), expected, atol=1e-6)


@given(vectors, st.floats(0.125, 8.0, width=32))
def test_limit_shortens_only_what_is_too_long_and_keeps_its_direction(v, most):
    exact = np.asarray(v, float)
    length = np.hypot(*exact)
    expected = exact * min(1.0, most / length) if length > 0 else exact
    np.testing.assert_allclose(jit_limit(v, most), expected, rtol=1e-5, atol=1e-12)


@given(vectors)
def test_gradients_of_norm_and_unit_are_finite_everywhere(v):
    assert np.all(np.isfinite(gradient_of_norm(v)))
    assert np.all(np.isfinite(jacobian_of_unit(v)))


def test_the_gradient_of_norm_at_zero_is_zero():
    assert np.all(np.asarray(gradient_of_norm(jnp.zeros(2))) == 0.0)


@pytest.mark.parametrize("v", [(0.0, 0.0), (0.3, 0.4), (30.0, 40.0)])
@pytest.mark.parametrize("most", [0.0, 1.0, 50.0, jnp.inf])
def test_gradients_of_limit_are_finite_also_without_a_limit(v, most):
    by_vector, by_most = jacobian_of_limit(jnp.array(v), most)
    assert np.all(np.isfinite(by_vector))
    assert np.all(np.isfinite(by_most))


def test_limit_by_infinity_changes_nothing():
    v = jnp.array([[3.0, -4.0], [0.0, 0.0]])
    assert np.array_equal(limit(v, jnp.inf), v)

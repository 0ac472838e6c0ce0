import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skydog.flight import setpoints

DT = 0.1
metres = st.floats(-8.0, 8.0).map(lambda x: round(x, 3))
places = st.tuples(metres, metres).map(lambda place: np.array([place]))


def test_set_points_are_the_sum_of_the_decided_velocities_times_dt():
    velocities = np.random.default_rng(0).uniform(-1.0, 1.0, (30, 4, 2))
    start = np.zeros((4, 2))
    setpoint = setpoints.stand(start)
    for count, velocity in enumerate(velocities):
        # A body that is where it should be: the paper's p(k+1) = p(k) + v dt, Eq. 23.
        here = setpoints.at(setpoint, DT)
        setpoint = setpoints.integrate(setpoint, velocity, here, DT, leash=0.6)
        expected = start + DT * velocities[:count].sum(axis=0)
        np.testing.assert_allclose(setpoint.origin, expected, atol=1e-12)
        np.testing.assert_allclose(setpoints.at(setpoint, DT), expected + DT * velocity, atol=1e-12)


def test_a_set_point_runs_to_its_end_without_a_jump():
    first = setpoints.integrate(
        setpoints.stand(np.zeros((1, 2))), np.array([[1.0, 0.0]]), np.zeros((1, 2)), DT, 0.6
    )
    second = setpoints.integrate(first, np.array([[0.0, -1.0]]), np.zeros((1, 2)), DT, 0.6)
    np.testing.assert_allclose(setpoints.at(first, DT), setpoints.at(second, 0.0))
    np.testing.assert_allclose(setpoints.at(first, DT / 2), [[0.05, 0.0]])


@given(places, places, places)
def test_a_set_point_starts_within_its_leash_and_on_the_line_to_where_it_was(
    origin, velocity, position
):
    before = setpoints.Setpoint(origin, velocity)
    after = setpoints.integrate(before, velocity, position, DT, leash=0.6)
    was, now = setpoints.at(before, DT) - position, after.origin - position
    assert np.linalg.norm(now) <= 0.6 + 1e-9
    cross = was[..., 0] * now[..., 1] - was[..., 1] * now[..., 0]
    np.testing.assert_allclose(cross, 0.0, atol=1e-9)
    if np.linalg.norm(was) <= 0.6:
        np.testing.assert_allclose(now, was, atol=1e-12)  # and is not pulled
    else:
        assert np.sum(was * now) > 0.0


def test_a_body_that_is_held_up_does_not_have_to_make_up_for_it():
    setpoint, held = setpoints.stand(np.zeros((1, 2))), np.zeros((1, 2))
    for _ in range(50):
        setpoint = setpoints.integrate(setpoint, np.array([[1.0, 0.0]]), held, DT, leash=0.6)
    np.testing.assert_allclose(setpoint.origin, [[0.6, 0.0]])
    setpoint = setpoints.integrate(setpoint, np.array([[-1.0, 0.0]]), held, DT, leash=0.6)
    np.testing.assert_allclose(setpoints.at(setpoint, DT), [[0.5, 0.0]])


def test_a_waypoint_is_reached_within_the_tolerance_and_not_beyond():
    setpoint = setpoints.Setpoint(np.zeros((3, 2)), np.full((3, 2), [1.0, 0.0]))
    here = np.array([[0.06, 0.0], [0.1, 0.049], [0.1, 0.051]])
    assert setpoints.reached(setpoint, here, DT, 0.05).tolist() == [True, True, False]

"""Who is seen and who is lost, by a source that a test fills."""

from dataclasses import replace
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skydog.lab.adapters import Body
from skydog.lab.eyes import Eyes, to_tracker, to_world
from skydog.lab.site import DDS, ROS1, Cage, Mission, Mocap, Site, UAVSite, UGVSite

LEVEL = (0.0, 0.0, 0.0, 1.0)
DOG = UAVSite("dog", "twist-dds")
SITE = Site(
    Mission(),
    Cage((-1.0, 7.0), (-1.0, 7.0), (0.0, 3.0)),
    Mocap(),
    ROS1(),
    DDS(),
    (DOG,),
    (UGVSite("sheep1"), UGVSite("sheep2")),
)
HALF = 0.5**0.5
LEFT = (0.0, 0.0, HALF, HALF)  # turned by 90 degrees
POSES = {
    "dog": ((1.0, 2.0, 2.0), LEVEL),
    "sheep1": ((3.0, 4.0, 0.1), LEVEL),
    "sheep2": ((5.0, 4.0, 0.1), LEFT),
}
DT = 0.01


class Shown:
    """A source of bodies, and the eyes that look at it."""

    def __init__(self, site=SITE):
        self.latest = {}
        self.now = 100.0
        self.number = 0
        self.eyes = Eyes(site, self)

    def wait(self, until):
        return True

    def bodies(self):
        return dict(self.latest)

    def close(self):
        pass

    def frame(self, noise=1e-4, number=None, age=0.0, without=(), **changed):
        """What is seen a hundredth of a second later, of the poses changed as given."""
        self.now += DT
        self.number = self.number + 1 if number is None else number
        for name, (position, attitude) in {**POSES, **changed}.items():
            if name not in without:
                moved = (position[0] + noise * (self.number % 1000), *position[1:])
                at = moved if noise else position
                self.latest[name] = Body(at, attitude, self.now - age, self.number)
        return self.eyes.look(self.now)

    def nothing(self):
        self.now += DT
        return self.eyes.look(self.now)


def test_everybody_who_comes_in_a_believable_pose_is_seen():
    shown = Shown()
    sighting = shown.frame(noise=0.0)
    assert sighting.why == (None, None, None)
    assert sighting.came == (shown.now,) * 3
    frame = sighting.frame
    np.testing.assert_allclose(frame.dogs, [[1.0, 2.0, 2.0]])
    np.testing.assert_allclose(frame.sheep, [[3.0, 4.0], [5.0, 4.0]])
    np.testing.assert_allclose(frame.yaw, [0.0, pi / 2])
    np.testing.assert_allclose(sighting.dog_yaw, [0.0])
    assert frame.dogs_seen.tolist() == [True]
    assert frame.sheep_seen.tolist() == [True, True]


def test_nobody_is_seen_before_the_first_frame():
    sighting = Shown().nothing()
    assert sighting.why == ("stale",) * 3
    assert sighting.came == (-inf,) * 3
    assert np.isfinite(sighting.frame.dogs).all()
    assert not sighting.frame.dogs_seen.any()


def test_a_frame_is_seen_once():
    shown = Shown()
    first = shown.frame()
    again = shown.nothing()
    assert again.why == ("stale",) * 3
    assert again.came == first.came
    assert shown.frame().why == (None,) * 3


def test_a_body_that_frames_come_without_is_missing_and_stays_where_it_was():
    shown = Shown()
    shown.frame()
    left = shown.now
    assert shown.frame(without=("sheep1",)).why == (None, "missing", None)
    sighting = shown.frame(without=("sheep1",))
    assert sighting.why == (None, "missing", None)
    assert sighting.came[1] == left
    assert sighting.frame.sheep_seen.tolist() == [False, True]
    np.testing.assert_allclose(sighting.frame.sheep[0], [3.0001, 4.0])
    assert shown.frame().why == (None,) * 3


def test_a_pose_that_came_too_long_ago_is_stale():
    assert Shown().frame(age=0.09).why == (None,) * 3
    assert Shown().frame(age=0.11).why == ("stale",) * 3


def test_the_same_frame_number_again_is_not_advancing():
    shown = Shown()
    shown.frame(number=7)
    assert shown.frame(number=7).why == ("not advancing",) * 3
    assert shown.frame(number=8).why == (None,) * 3


def test_a_frame_number_that_wraps_is_no_loss():
    shown = Shown()
    for number in (2**32 - 2, 2**32 - 1, 0, 1):
        assert shown.frame(number=number).why == (None,) * 3


def test_a_pose_that_repeats_exactly_is_frozen_until_it_changes():
    shown = Shown()
    seen = [shown.frame(noise=0.0, sheep1=((3.0, 4.0 + i, 0.1), LEVEL)).why[0] for i in range(7)]
    assert seen == [None] + ["frozen"] * 6
    assert shown.frame(dog=((1.0, 2.0, 2.0), (0.0, 0.0, 1e-4, 1.0))).why[0] is None
    assert shown.frame().why[0] is None


def test_a_pose_is_not_frozen_while_its_attitude_changes():
    shown = Shown()
    for turn in range(10):
        attitude = (0.0, 0.0, 1e-6 * turn, 1.0)
        assert shown.frame(noise=0.0, dog=(POSES["dog"][0], attitude)).why[0] is None


@pytest.mark.parametrize(
    ("pose", "why"),
    [
        (((0.0, 0.0, 0.0), LEVEL), "zero"),
        (((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), "zero"),
        (((1e-9, 0.0, 0.0), LEVEL), None),
        (((nan, 2.0, 1.0), LEVEL), "not finite"),
        (((1.0, 2.0, -inf), LEVEL), "not finite"),
        (((1.0, 2.0, 1.0), (0.0, 0.0, nan, 1.0)), "not finite"),
        (((1.0, -1000.1, 1.0), LEVEL), "too far"),
        (((1e300, 2.0, 1.0), LEVEL), "too far"),
        (((1.0, 2.0, 1.0), (0.0, 0.0, 0.0, 0.0)), "not a rotation"),
        (((1.0, 2.0, 1.0), (0.0, 0.0, 0.0, 1.02)), "not a rotation"),
        (((1.0, 2.0, 1.0), (0.0, 0.0, 0.0, 1e300)), "not a rotation"),
        (((1.0, 2.0, 1.0), (0.0, 0.0, 0.0, 1.005)), None),
    ],
)
def test_a_pose_that_no_body_can_have_is_a_loss(pose, why):
    shown = Shown()
    believed = shown.frame()
    sighting = shown.frame(noise=0.0, dog=pose)
    assert sighting.why == (why, None, None)
    assert sighting.frame.dogs_seen.tolist() == [why is None]
    if why is not None:
        np.testing.assert_array_equal(sighting.frame.dogs, believed.frame.dogs)
        assert sighting.came[0] == believed.came[0]
    assert shown.frame().why == (None,) * 3


def test_a_rover_that_is_swapped_with_a_drone_is_too_high():
    shown = Shown()
    swapped = {"dog": POSES["sheep1"], "sheep1": POSES["dog"]}
    assert shown.frame(**swapped).why == (None, "too high", None)
    assert shown.frame(sheep1=((3.0, 4.0, -0.7), LEVEL)).why[1] == "too high"
    assert shown.frame(sheep1=((3.0, 4.0, 0.5), LEVEL)).why[1] is None


def test_a_rover_on_its_side_is_still_seen():
    lying = tuple(map(float, Rotation.from_euler("x", 80, degrees=True).as_quat()))
    assert Shown().frame(sheep1=((3.0, 4.0, 0.1), lying)).why[1] is None


def test_the_height_of_a_rover_is_measured_in_the_world():
    raised = replace(SITE, mocap=Mocap(origin=(0.0, 0.0, 2.0)))
    assert Shown(raised).frame().why == (None, "too high", "too high")


def test_the_trackers_frame_is_turned_and_then_moved_into_the_world():
    shown = Shown(replace(SITE, mocap=Mocap(origin=(10.0, 20.0, 0.5), yaw=pi / 2)))
    sighting = shown.frame(noise=0.0)
    np.testing.assert_allclose(sighting.frame.dogs, [[10.0 - 2.0, 20.0 + 1.0, 2.5]])
    np.testing.assert_allclose(sighting.frame.sheep[1], [10.0 - 4.0, 20.0 + 5.0])
    np.testing.assert_allclose(sighting.frame.yaw, [pi / 2, pi])


def test_markers_that_stand_off_and_are_turned_on_a_robot_show_the_robot():
    # Markers 0.3 m ahead of the centre, their x axis to the robot's left.
    robot = UGVSite("sheep2", offset=(0.3, 0.0, 0.1), yaw=pi / 2)
    shown = Shown(replace(SITE, ugv=(SITE.ugv[0], robot)))
    sighting = shown.frame(noise=0.0)  # the markers point to +y, so the robot to +x
    np.testing.assert_allclose(sighting.frame.sheep[1], [5.0 - 0.3, 4.0], atol=1e-12)
    np.testing.assert_allclose(sighting.frame.yaw[1], 0.0, atol=1e-12)


finite = st.floats(-50.0, 50.0)
vector = st.tuples(finite, finite, finite)
attitude = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(vector, finite, vector, finite, vector, attitude)
def test_the_transform_is_the_product_of_three_rigid_motions(
    origin, yaw, offset, turn, position, shown
):
    shown = tuple((np.array(shown) / np.linalg.norm(shown)).tolist())
    robot = replace(DOG, offset=offset, yaw=turn)
    at, attitude = to_world(Mocap(origin=origin, yaw=yaw), robot, position, shown)
    frame, on_robot = Rotation.from_euler("z", yaw), Rotation.from_euler("z", turn)
    rotation = frame * Rotation.from_quat(shown) * on_robot.inv()
    expected = frame.apply(position) + origin - rotation.apply(offset)
    np.testing.assert_allclose(at, expected, atol=1e-9)
    assert abs(np.dot(attitude, rotation.as_quat())) > 1 - 1e-9
    back, turned = to_tracker(Mocap(origin=origin, yaw=yaw), robot, at, attitude)
    np.testing.assert_allclose(back, position, atol=1e-9)
    assert abs(np.dot(turned, shown)) > 1 - 1e-9


def test_a_site_without_rovers_has_empty_arrays_of_the_right_shape():
    frame = Shown(replace(SITE, ugv=())).frame().frame
    assert (frame.dogs.shape, frame.sheep.shape, frame.yaw.shape) == ((1, 3), (0, 2), (0,))
    assert frame.sheep_seen.shape == (0,)

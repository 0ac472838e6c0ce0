"""The emulated tracker through a real socket: Vicon's packets, a receiver, and eyes."""

import time
from contextlib import closing
from dataclasses import replace
from math import atan2, cos, sin
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.lab.emulation import tracker as emulation
from skydog.lab.emulation.tracker import Tracker
from skydog.lab.eyes import Eyes
from skydog.lab.site import DDS, ROS1, Cage, Mission, Mocap, Site, UAVSite, UGVSite
from skydog.lab.vicon import Receiver

SITE = Site(
    Mission(),
    Cage((-1.0, 7.0), (-1.0, 7.0), (0.0, 3.0)),
    Mocap(),
    ROS1(),
    DDS(),
    (UAVSite("dog", "twist-dds"),),
    (UGVSite("sheep1"), UGVSite("sheep2")),
)
NAMES = ("dog", "sheep1", "sheep2")
PATIENCE = 30.0  # s


def turned(yaw):
    return 0.0, 0.0, sin(yaw / 2), cos(yaw / 2)


TRUTH = {
    "dog": ((1.0, 2.0, 2.0), turned(0.5)),
    "sheep1": ((3.0, 4.0, 0.1), turned(1.0)),
    "sheep2": ((5.0, 4.0, 0.1), turned(-2.0)),
}


class Lab:
    """A tracker, the wire, a receiver, and eyes."""

    def __init__(self, receiver, site=SITE, seed=0):
        site = replace(site, mocap=replace(site.mocap, port=receiver.port))
        self.receiver, self.tracker = receiver, Tracker(site, seed)
        self.eyes = Eyes(site, receiver)

    def show(self, truth=TRUTH):
        """Show a frame, wait until all that was sent of it came, and look."""
        sent, emit, before = [], self.tracker._emit, self.receiver.packets

        def recorded(packet):
            sent.append(packet)
            emit(packet)

        with mock.patch.object(self.tracker, "_emit", recorded):
            self.tracker.show(truth)
        emit(b"?")  # is counted after all of them were taken
        end = time.monotonic() + PATIENCE
        while self.receiver.packets < before + len(sent) + 1:
            assert time.monotonic() < end
            time.sleep(0.0002)
        came = [body.came for body in self.receiver.bodies().values()]
        return self.eyes.look(max(came, default=0.0)), sent  # at once, however slow the machine


@pytest.fixture(scope="module")
def port():
    """One receiver for hypothesis's examples."""
    with closing(Receiver("127.0.0.1", 0, NAMES)) as receiver:
        yield receiver


@pytest.fixture
def lab():
    with closing(Receiver("127.0.0.1", 0, NAMES)) as receiver:
        lab = Lab(receiver)
        with closing(lab.tracker):
            yield lab


distance = st.floats(-9.0, 9.0)
vector = st.tuples(distance, distance, distance)
angle = st.floats(-3.0, 3.0)
robot = st.tuples(vector, angle)
number = iter(range(0, 2**31, 1000))


@given(vector, angle, robot, robot, vector, vector, angle)
def test_eyes_get_back_the_truth_however_the_tracker_and_the_markers_lie(
    port, origin, yaw, on_dog, on_sheep, dog, sheep, heading
):
    mocap = Mocap(origin=origin, yaw=yaw)
    site = replace(
        SITE,
        mocap=mocap,
        uav=(replace(SITE.uav[0], offset=on_dog[0], yaw=on_dog[1]),),
        ugv=(replace(SITE.ugv[0], offset=on_sheep[0], yaw=on_sheep[1]),),
    )
    lab = Lab(port, site)
    lab.tracker.number = next(number)
    with closing(lab.tracker):
        sighting, _ = lab.show(
            {"dog": (dog, turned(heading)), "sheep1": ((*sheep[:2], 0.1), turned(heading + 1.0))}
        )
    assert sighting.why == (None, None)
    # Nine metres of offset turn the attitude's noise into millimetres.
    np.testing.assert_allclose(sighting.frame.dogs, [dog], atol=0.05)
    np.testing.assert_allclose(sighting.frame.sheep, [sheep[:2]], atol=0.05)
    for found, true in ((sighting.dog_yaw[0], heading), (sighting.frame.yaw[0], heading + 1.0)):
        assert abs(atan2(sin(found - true), cos(found - true))) < 0.01


def test_without_noise_eyes_get_back_the_truth_exactly(lab, monkeypatch):
    monkeypatch.setattr(emulation, "POSITION_NOISE", 0.0)
    monkeypatch.setattr(emulation, "ATTITUDE_NOISE", 0.0)
    sighting, _ = lab.show()
    np.testing.assert_allclose(sighting.frame.dogs, [[1.0, 2.0, 2.0]], atol=1e-12)
    np.testing.assert_allclose(sighting.frame.yaw, [1.0, -2.0], atol=1e-12)


def test_a_body_that_stands_is_seen_in_every_frame_with_noise_of_the_size_declared(lab):
    found = []
    for _ in range(200):
        sighting, _ = lab.show()
        assert sighting.why == (None,) * 3
        found.append([*sighting.frame.dogs[0], sighting.dog_yaw[0]])
    *position, yaw = np.std(found, axis=0)
    np.testing.assert_allclose(position, emulation.POSITION_NOISE, rtol=0.3)
    np.testing.assert_allclose(yaw, emulation.ATTITUDE_NOISE, rtol=0.3)


def test_the_same_seed_sends_the_same_packets(lab):
    _, first = lab.show()
    again = Lab(lab.receiver)
    other = Lab(lab.receiver, seed=1)
    with closing(again.tracker), closing(other.tracker):
        assert again.show()[1] == first
        assert other.show()[1] != first


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ({"silent": True}, ("stale",) * 3),
        ({"stuck": True}, ("stale",) * 3),
        ({"hidden": {"sheep1"}}, (None, "missing", None)),
        ({"hidden": set(NAMES)}, ("stale",) * 3),
        ({"zeroed": {"dog"}}, ("zero", None, None)),
        ({"nan": {"sheep2"}}, (None, None, "missing")),
        ({"frozen": {"dog", "sheep2"}}, ("frozen", None, "frozen")),
        ({"swapped": ("dog", "sheep1")}, (None, "too high", None)),
        ({"jump": {"sheep1": (0.0, 0.0, 1.0)}}, (None, "too high", None)),
        ({"dropout": 1.0}, ("stale",) * 3),
    ],
)
def test_a_fault_is_a_loss_while_it_lasts(lab, fault, why):
    lab.show()
    for name, value in fault.items():
        setattr(lab.tracker.faults, name, value)
    whys = [lab.show()[0].why for _ in range(5)]  # so many show that a body is frozen
    assert whys[-1] == why
    lab.tracker.faults = emulation.Faults()
    lab.tracker.number += 1
    assert lab.show()[0].why == (None,) * 3


def test_a_jump_is_in_the_worlds_frame(lab):
    lab.tracker.faults.jump = {"dog": (1.0, 0.0, -0.5)}
    sighting, _ = lab.show()
    np.testing.assert_allclose(sighting.frame.dogs, [[2.0, 2.0, 1.5]], atol=0.01)


def test_packets_sent_twice_or_with_rubbish_lose_nobody(lab):
    lab.tracker.faults.duplicate = lab.tracker.faults.garbage = 1.0
    for _ in range(20):
        sighting, sent = lab.show()
        assert len(sent) == 3
        assert sighting.why == (None,) * 3
    assert lab.receiver.late == 20


def test_packets_out_of_order_never_take_a_body_back(lab):
    lab.tracker.faults.reorder = 0.5
    came, shown = [], []
    for _ in range(100):
        _, sent = lab.show()
        came += [int.from_bytes(packet[:4], "little") for packet in sent]
        shown += [body.number for body in list(lab.receiver.bodies().values())[:1]]
    assert came != sorted(came)
    assert sorted(came) in (list(range(100)), list(range(99)))
    assert shown == sorted(shown)
    assert lab.receiver.late > 0


def test_packets_that_are_cut_lose_bodies_and_nothing_else(lab):
    lab.tracker.faults.truncate = 1.0
    whys = set()
    for _ in range(60):
        sighting, _ = lab.show()
        whys |= set(sighting.why)
    assert whys == {None, "missing", "stale"}


def test_delayed_packets_come_so_many_frames_later(lab):
    lab.tracker.faults.delay = 3
    numbers = [[int.from_bytes(packet[:4], "little") for packet in lab.show()[1]] for _ in range(5)]
    assert numbers == [[], [], [], [0], [1]]
    lab.tracker.faults.silent = True
    assert lab.show()[1] == []


def test_a_tracker_that_is_restarted_is_seen_again_after_ten_frames(lab):
    lab.tracker.number = 50_000
    assert lab.show()[0].why == (None,) * 3
    lab.tracker.number = 0
    whys = [lab.show()[0].why for _ in range(11)]
    assert whys == [("stale",) * 3] * 9 + [(None,) * 3] * 2


def test_a_site_with_more_robots_than_a_packet_holds_is_refused():
    crowd = tuple(UGVSite(f"sheep{i}") for i in range(13))
    with pytest.raises(Refusal, match="holds 13 objects, not 14"):
        Tracker(replace(SITE, ugv=crowd))


def test_an_address_that_is_none_is_refused():
    with pytest.raises(Refusal, match=r"mocap\.host"):
        Tracker(replace(SITE, mocap=Mocap(host="a" * 70)))


def test_a_tracker_may_be_closed_twice_and_shows_nothing_then(lab):
    lab.tracker.close()
    lab.tracker.close()
    lab.tracker.show(TRUTH)
    assert lab.receiver.bodies() == {}

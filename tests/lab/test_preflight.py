"""The pre-flight gate: it passes when all is well, and each thing that is wrong fails its check."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from skydog.flight.station import Frame
from skydog.lab.adapters import Status
from skydog.lab.emulation.chain import a_site
from skydog.lab.eyes import Sighting
from skydog.lab.preflight import checks
from skydog.lab.setup import setup
from skydog.lab.site import Mission

SITE = a_site(Mission(sheepdog="strombom"), 6.0, "dds")
BASE = setup(SITE).base
NOW = 1000.0
DOGS = [[1.0, 5.0, 0.05]]
SHEEP = [[3.3, 4.5], [3.6, 4.0], [4.5, 2.1]]
FULL = Status(1.0, False)
NAMES = ("uav1", "ugv1", "ugv2", "ugv3")


def found(
    site=SITE,
    dogs=DOGS,
    sheep=SHEEP,
    came=(NOW,) * 4,
    why=(None,) * 4,
    rates=(100.0,) * 4,
    status=(FULL,),
    others=None,
    self_test="",
    stopped="",
    seconds=230.0,
):
    """The checks of a laboratory in which all is well, but for what is given."""
    frame = Frame(np.array(dogs), np.array(sheep), np.zeros(3), np.ones(1, bool), np.ones(3, bool))
    sighting = Sighting(frame, np.zeros(1), why, came)
    return checks(
        site, BASE, seconds, sighting, rates, status, others or {}, self_test, NOW, stopped
    )


def failing(**wrong):
    """The names of the checks that fail, and all that they say."""
    failed = [check for check in found(**wrong) if not check.passes]
    return {check.name for check in failed}, " | ".join(map(str, failed))


def test_all_pass_when_all_is_well():
    assert failing() == (set(), "")
    for name in NAMES:
        assert any(check.name == f"{name} is seen" for check in found())


@pytest.mark.parametrize(
    ("wrong", "name", "said"),
    [
        (
            {"came": (NOW, NOW, -inf, NOW), "why": (None, None, "missing", None)},
            "ugv2 is seen",
            "missing; show it to the tracker",
        ),
        ({"came": (NOW - 0.2, *[NOW] * 3), "why": ("stale", *[None] * 3)}, "uav1 is seen", "stale"),
        ({"rates": (70.0, *[100.0] * 3)}, "rate of uav1", "70 Hz, 80 to 120 wanted; mocap.rate"),
        ({"rates": (*[100.0] * 3, 130.0)}, "rate of ugv3", "130 Hz"),
        ({"dogs": [[-0.8, 5.0, 0.05]]}, "uav1 is inside the cage", "-0.80, 5.00, 0.05 m; place it"),
        ({"dogs": [[1.0, 5.0, 3.5]]}, "uav1 is inside the cage", "3.50"),
        ({"dogs": [[3.3, 4.9, 0.05]]}, "pad of uav1 is clear", "nearest 0.40 m"),
        ({"sheep": [[6.2, 4.5], *SHEEP[1:]]}, "ugv1 is in the arena", "within 0 to 6 m"),
        ({"sheep": [SHEEP[0], [3.3, 4.6], SHEEP[2]]}, "ugv2 does not touch another", "0.10 m"),
        ({"status": (Status(1.0, False, connected=False),)}, "uav1 answers", "no"),
        ({"status": (Status(1.0, True),)}, "uav1 is on the ground", "flies"),
        ({"status": (Status(1.0, False, emergency=True),)}, "uav1 is no emergency", "by hand"),
        ({"status": (Status(0.4, False),)}, "battery of uav1", "40%, lasts 192 s of the 230 s"),
        ({"others": {"ugv1": ("teleop",)}}, "nobody else commands ugv1", "teleop; end them"),
        ({"self_test": "no way home"}, "self-test of the sheepdog", "no way home"),
        ({"stopped": "file STOP is there"}, "no stop is pulled", "file STOP is there"),
    ],
)
def test_what_is_wrong_fails_its_check_alone_and_says_so(wrong, name, said):
    names, lines = failing(**wrong)
    assert names == {name}
    assert said in lines


def test_a_drone_that_does_not_tell_its_battery_passes_if_a_full_one_lasts():
    silent = (Status(None, None),)
    assert failing(status=silent)[0] == set()
    assert failing(status=silent, seconds=500.0)[0] == {"battery of uav1"}


@pytest.mark.parametrize(("rate", "seen"), [(50.0, 50.0), (240.0, 100.0)])
def test_a_tracker_of_any_rate_can_pass(rate, seen):
    """The base station looks a hundred times a second, and so counts no more."""
    site = replace(SITE, mocap=replace(SITE.mocap, rate=rate))
    assert failing(site=site, rates=(seen,) * 4)[0] == set()
    assert failing(site=site, rates=(0.7 * seen,) * 4)[0] == {f"rate of {name}" for name in NAMES}

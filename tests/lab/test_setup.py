"""What a site comes to, and which sites do not fit together."""

from dataclasses import replace

import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.flight.limits import Limits
from skydog.lab.emulation.chain import a_site
from skydog.lab.setup import base, setup
from skydog.lab.site import Cage, Mission, Safety
from skydog.world.presets import preset

SITE = a_site(Mission(sheepdog="strombom"), 6.0, "dds")


def flying(**mission):
    return replace(SITE, mission=Mission(**{"sheepdog": "strombom", **mission}))


def test_a_dog_that_keeps_near_the_arena_fits_its_cage():
    made = setup(SITE)
    assert made.base.airspace == pytest.approx((-0.2, 6.2))
    assert made.base.arena == (0.0, 6.0)
    assert made.base.height.tolist() == [[2.0]]


def test_a_dog_that_may_fly_1_4_m_beyond_does_not_fit_the_cage():
    with pytest.raises(Refusal, match=r"-1\.4 to 7\.4 m, does not fit into cage\.x, -0\.7 to 6\.7"):
        setup(flying(preset="paper", arena=6.0))


def test_the_same_dog_fits_a_larger_cage():
    cage = Cage((-2.0, 8.0), (-2.0, 8.0), (-0.5, 3.0))
    made = setup(replace(flying(preset="paper", arena=6.0), cage=cage))
    assert made.base.airspace == pytest.approx((-1.4, 7.4))


def test_a_cage_that_is_too_low_for_its_drones_is_refused():
    two = (SITE.uav[0], replace(SITE.uav[0], name="uav2"))
    with pytest.raises(Refusal, match=r"as high as 2\.6 m, and cage\.z ends at 2\.7 m; 2\.9 m"):
        setup(replace(SITE, uav=two, cage=replace(SITE.cage, z=(-0.5, 2.7))))
    setup(replace(SITE, uav=two))


def test_the_limits_are_those_of_the_site():
    safety = Safety(stale=0.05, blind=0.4, alarm=1.0, missed_decisions=2, battery=0.3)
    made = setup(replace(SITE, safety=safety))
    limits = made.base.limits
    assert (limits.x, limits.y, limits.z) == (SITE.cage.x, SITE.cage.y, SITE.cage.z)
    assert (limits.stale, limits.blind, limits.alarm, limits.battery) == (0.05, 0.4, 1.0, 0.3)
    assert limits.silence == pytest.approx(2.5 * float(made.world.arena.dt))


def test_rovers_that_steer_themselves_are_not_said_to_run_away():
    assert setup(SITE).base.limits.runaway == Limits.runaway
    assert setup(flying(flock="own")).base.limits.runaway == np.inf


def test_half_the_speed_is_half_the_speed_of_sheep_and_dog():
    whole, half = setup(SITE).world, setup(flying(speed=0.5)).world
    assert float(half.sheep.speed) == pytest.approx(0.5 * float(whole.sheep.speed))
    assert float(half.dog.speed) == pytest.approx(0.5 * float(whole.dog.speed))


def test_the_goal_is_where_the_site_has_it():
    arena = setup(flying(goal=(6.0, 0.0))).world.arena
    assert (float(arena.goal_x), float(arena.goal_y)) == (6.0, 0.0)


@pytest.mark.parametrize(
    ("mission", "why"),
    [
        ({"preset": "nobody"}, "nobody"),
        ({"sheepdog": "no-such-dog"}, "no-such-dog"),
    ],
)
def test_what_is_no_mission_is_refused(mission, why):
    with pytest.raises(Refusal, match=why):
        setup(flying(**mission))


def test_a_world_with_a_scene_is_refused():
    with pytest.raises(Refusal, match="a laboratory has no obstacles; take a world"):
        base(SITE, preset("paper", 12.0, scene="gate"))

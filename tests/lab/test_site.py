"""A site file is parsed with bounds, and whoever mistypes is told what to write."""

import re
from pathlib import Path

import pytest

pytest.importorskip("msgspec", reason="skydog[lab] is not installed")

from skydog.errors import Refusal
from skydog.lab import site
from skydog.lab.site import Cage, Safety, UAVSite, UGVSite

LAB = """
[cage]
x = [-0.7, 6.7]
y = [-0.7, 6.7]
z = [-0.5, 3.0]

[[uav]]
name = "uav1"
adapter = "tum-simulator"

[[ugv]]
name = "ugv1"
"""


def without(part):
    """The site file that lacks one part, up to the next empty line."""
    return re.sub(rf"{re.escape(part)}\n(.+\n)*", "", LAB)


def refused(text):
    """What a text is refused with: one line."""
    with pytest.raises(Refusal) as refusal:
        site.parse(text)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


def test_what_a_site_file_does_not_say_has_its_default():
    parsed = site.parse(LAB)
    assert parsed.cage == Cage((-0.7, 6.7), (-0.7, 6.7), (-0.5, 3.0))
    assert parsed.uav == (UAVSite("uav1", "tum-simulator"),)
    assert parsed.ugv == (UGVSite("ugv1"),)
    assert parsed.safety == Safety()
    assert parsed.mocap.host == parsed.ros1.address == parsed.dds.peers[0] == "127.0.0.1"


@pytest.mark.parametrize("part", ["[cage]", "[[uav]]", "[[ugv]]"])
def test_a_site_without_a_cage_a_drone_or_a_rover_is_told_what_to_write(part):
    said = refused(without(part))
    assert f"lacks {part.strip('[]')}" in said
    assert "write" in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[misson]\n" + LAB, "unknown 'misson'; did you mean mission?"),
        ("[mission]\nsped = 1.0\n" + LAB, "unknown 'mission.sped'; did you mean speed?"),
        (LAB + "stops_by_it_self = true\n", "did you mean stops_by_itself?"),
        (LAB + "wheels = 2\n", "it knows name, adapter, profile"),
    ],
)
def test_an_unknown_name_is_refused_with_the_one_that_was_meant(text, said):
    assert said in refused(text)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        (LAB.replace("-0.5", "nan"), "cage.z[0]"),
        (LAB.replace("-0.5", "-inf"), "cage.z[0]"),
        (LAB.replace("3.0]", "1e9]"), "cage.z[1]"),
        (LAB.replace("[-0.5, 3.0]", "[-0.5]"), "cage.z"),
        (LAB + "speed = inf\n", "ugv[0].speed"),
        (LAB + "speed = nan\n", "ugv[0].speed"),
        (LAB + "speed = 0.0\n", "ugv[0].speed"),
        (LAB + "offset = [0.0, nan, 0.0]\n", "ugv[0].offset[1]"),
        (LAB + 'guard = "yes"\n', "ugv[0].guard"),
        (LAB + 'adapter = "bluetooth"\n', "ugv[0].adapter"),
        ("[mission]\nspeed = nan\n" + LAB, "mission.speed"),
        ("[mission]\nspeed = 1.5\n" + LAB, "mission.speed"),
        ("[mission]\nsteps = true\n" + LAB, "mission.steps"),
        ("[mission]\nsteps = 1.5\n" + LAB, "mission.steps"),
        ("[mission]\narena = 2.0\n" + LAB, "mission.arena"),
        ("[mocap]\nyaw = nan\n" + LAB, "mocap.yaw"),
        ("[mocap]\norigin = [0.0, inf, 0.0]\n" + LAB, "mocap.origin[1]"),
        ("[mocap]\nport = 70000\n" + LAB, "mocap.port"),
        ("[mocap]\nrate = 0\n" + LAB, "mocap.rate"),
        ("[dds]\ndomain = -1\n" + LAB, "dds.domain"),
        ("mission = 3\n" + LAB, "mission"),
        ("uav = 3\n" + without("[[uav]]"), "uav"),
        ("uav = [1]\n" + without("[[uav]]"), "uav[0]"),
    ],
)
def test_a_value_out_of_bounds_or_of_another_kind_is_refused_by_its_place(text, where):
    assert f"`{where}`" in refused(text)


@pytest.mark.parametrize(
    ("field", "weaker"),
    [("stale", 0.11), ("blind", 0.6), ("alarm", 2.0), ("acceleration", 5.0), ("battery", 0.1)],
)
def test_a_site_may_make_the_supervisor_stricter_and_never_laxer(field, weaker):
    assert f"safety.{field}" in refused(f"[safety]\n{field} = {weaker}\n{LAB}")
    default = getattr(Safety(), field)
    assert getattr(site.parse(f"[safety]\n{field} = {default}\n{LAB}").safety, field) == default


@pytest.mark.parametrize("name", ["", "1uav", "uav-1", "uav 1", "ü", "uav1\\n", "u" * 24, "/uav1"])
def test_a_name_that_vicon_or_ros_cannot_have_is_refused(name):
    assert "uav[0].name" in refused(LAB.replace('"uav1"', f'"{name}"'))


def test_two_robots_of_one_name_are_refused():
    assert "two robots are called uav1" in refused(LAB.replace('"ugv1"', '"uav1"'))


def test_a_cage_that_ends_before_it_begins_is_refused():
    assert "cage.x goes from 6.7 to -0.7 m" in refused(LAB.replace("[-0.7, 6.7]", "[6.7, -0.7]", 1))


def test_a_site_has_at_most_8_drones_and_50_rovers():
    robots = "".join(f'[[ugv]]\nname = "more{number}"\n' for number in range(50))
    assert "got 1 and 51" in refused(LAB + robots)
    assert "got 1 and 0" in refused("ugv = []\n" + without("[[ugv]]"))


def test_a_second_drone_is_refused_that_would_land_through_the_first():
    more = '[[uav]]\nname = "uav2"\nadapter = "twist-dds"\n'
    assert "a site has 1 uav and 1 to 50 ugv, got 2" in refused(LAB + more)


@pytest.mark.parametrize("topic", ["/bad topic!_in", "a//b", "/1st", "x" * 300])
def test_a_topic_that_is_no_name_of_one_is_refused(topic):
    refused(LAB.replace("[[uav]]", f'[[uav]]\ntopic = "{topic}"', 1))


def test_a_cage_without_the_floor_is_refused():
    import re

    assert "above the floor" in refused(re.sub(r"z = \[[^]]*\]", "z = [1.0, 3.0]", LAB))


@pytest.mark.parametrize(
    ("adapter", "example"), [("crazyflie", "radio://0/80/2M"), ("mavlink", "udpin:")]
)
def test_a_drone_that_is_reached_by_an_address_needs_one(adapter, example):
    said = refused(LAB.replace("tum-simulator", adapter))
    assert "lacks uri" in said
    assert example in said


def test_a_file_that_is_missing_a_folder_too_large_or_no_toml_is_refused_by_its_path(tmp_path):
    large, binary, broken = (tmp_path / name for name in ("large", "binary", "broken"))
    large.write_text(LAB + "#" * site.LARGEST_FILE)
    binary.write_bytes(b"\xff\xfe\x00")
    broken.write_text("[cage\n")
    deep = tmp_path / "deep"
    deep.write_text("x = " + "[" * 20_000)
    for path in (tmp_path / "none", tmp_path, large, binary, broken, deep, Path("a\0b")):
        with pytest.raises(Refusal) as refusal:
            site.load(path)
        assert str(path).replace("\0", r"\x00") in str(refusal.value)
        assert "\n" not in str(refusal.value)

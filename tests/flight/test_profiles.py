import re
from dataclasses import fields, is_dataclass
from importlib import resources

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.flight import profiles
from skydog.flight.autopilot import GRAVITY

FOLDER = resources.files("skydog.flight").joinpath("profiles")
UAVS, ROVERS = profiles.ship("uav"), profiles.ship("rover")
LOADS = {"uav": profiles.uav, "rover": profiles.rover}


def text(name):
    return FOLDER.joinpath(f"{name}.toml").read_text()


def load(folder, content, kind="uav"):
    file = folder / "mine.toml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return LOADS[kind](str(file))


def changed(name, old, new):
    found, count = re.subn(old, new, text(name), count=1, flags=re.M)
    assert count == 1
    return found


# Those that ship


def test_the_drones_and_the_rover_of_the_readme_ship():
    assert set(UAVS) >= {"ardrone2", "crazyflie", "tum-simulator"}
    assert "kobuki" in ROVERS
    assert not set(UAVS) & set(ROVERS)


@pytest.mark.parametrize(
    ("kind", "name"), [*(("uav", n) for n in UAVS), *(("rover", n) for n in ROVERS)]
)
def test_a_profile_that_ships_is_loaded_by_its_name_and_as_a_file_alike(tmp_path, kind, name):
    found = LOADS[kind](name)
    assert found.name == name
    file = tmp_path / f"{name}.toml"
    file.write_text(text(name))
    assert LOADS[kind](str(file)) == found


@pytest.mark.parametrize("name", UAVS)
def test_a_drone_that_ships_can_lift_itself_and_is_not_heavier_than_physics_allows(name):
    body = profiles.uav(name).body
    assert 4.0 * body.rotor_thrust > 1.3 * GRAVITY * body.mass
    x, y, z = body.inertia
    assert x + y >= z  # or no such body exists
    assert max(body.inertia) < body.mass * body.radius**2


# Refusals


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (r"^arm = .*$", "", r"lacks 'body.arm'"),
        (r"^arm = ", "arms = ", r"'body.arm"),
        (r"^\[link\]$", "[radio]", r"lacks 'link'"),
        (r"^\[link\]$", "[link]\nrange = 30.0", r"does not know 'link.range'"),
        (r"^\[body\]$", "colour = 'red'\n[body]", r"does not know 'colour'"),
        (r"^mass = \S+", "mass = '1.4'", r"body.mass = '1.4'"),
        (r"^mass = \S+", "mass = true", r"body.mass = True"),
        (r"^mass = \S+", "mass = [1.0, 1.0, 1.0]", r"body.mass = \["),
        (r"^mass = \S+", "mass = 2020-01-01", r"body.mass = datetime"),
        (r"^mass = \S+", "mass = 0.0", r"body.mass = 0.0; it must be larger than 0"),
        (r"^mass = \S+", "mass = 0", r"body.mass = 0.0; it must be larger than 0"),
        (r"^mass = \S+", "mass = -1.0", r"body.mass = -1.0"),
        (r"^mass = \S+", "mass = nan", r"body.mass = nan"),
        (r"^mass = \S+", "mass = inf", r"body.mass = inf"),
        (r"^mass = \S+", "mass = 1e300", r"body.mass = 1e\+300"),
        (r"^drag = \S+", "drag = -0.1", r"body.drag = -0.1"),
        (r"^inertia = [^#]+", "inertia = [0.01, 0.01] ", r"body.inertia = \[0.01, 0.01\]"),
        (r"^inertia = [^#]+", "inertia = [0.01, 0.01, nan] ", r"body.inertia = \["),
        (r"^inertia = [^#]+", "inertia = [0, 0, 0] ", r"body.inertia = \(0.0, 0.0, 0.0\)"),
        (r"^inertia = [^#]+", "inertia = [0.01, 0.01, 0] ", r"body.inertia = \(0.01, 0.01, 0.0\)"),
        (r"^inertia = [^#]+", "inertia = 0.01 ", r"body.inertia = 0.01"),
        (r"^on_board = \S+", "on_board = 1", r"velocity.on_board = 1"),
        (r"^gain = \S+", "gain = 0.0", r"attitude.gain = 0.0; it must be larger"),
        (r"^kind = .*$", "kind = 'rover'", r"is no profile of a uav; it must say kind = 'uav'"),
        (r"^kind = .*$", "kind = ['uav']", r"it must say kind = 'uav'"),
        (r"^kind = .*$", "", r"it must say kind = 'uav'"),
        (r"^kind = .*$", "kind = 'uav'\nname = 3", r"name = 3"),
        (r"^kind = .*$", "kind = 'uav'\nbody = 3.0\n[more]", r"is not valid TOML"),
        (r"^mass", "mass mass", r"is not valid TOML"),
    ],
)
def test_a_broken_profile_is_refused_by_the_name_of_what_is_wrong(tmp_path, old, new, told):
    with pytest.raises(Refusal, match=told) as refused:
        load(tmp_path, changed("tum-simulator", old, new))
    assert "mine.toml" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_rover_with_a_dc_gain_above_zero_is_refused_too(tmp_path):
    with pytest.raises(Refusal, match="delta must be larger than 1 / phi; try delta = 4"):
        load(tmp_path, changed("kobuki", r"^delta = \S+", "delta = 1.0"), "rover")


def test_a_table_where_a_number_should_be_is_refused_and_a_number_for_a_table(tmp_path):
    tables = text("kobuki").split("[yaw]")[0]
    with pytest.raises(Refusal, match="yaw = 3"):
        load(tmp_path, tables.replace('kind = "rover"', 'kind = "rover"\nyaw = 3.0'), "rover")
    deep = changed("kobuki", r"^gain = \S+.*$", "").replace(
        "[yaw]", "[tracking.gain]\nx = 1\n[yaw]"
    )
    with pytest.raises(Refusal, match=r"tracking\.gain"):
        load(tmp_path, deep, "rover")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "must say kind"),
        (b"\xff\xfe\x00", "is not valid TOML"),
        (b"kind = 'uav'\n" + b"# " + b"x" * profiles.LARGEST_FILE, "more than any profile .65,536"),
        (b"a = " + b"[" * 5000, "is not valid TOML"),
        (b"PK\x03\x04", "is not valid TOML"),
    ],
)
def test_a_file_that_is_no_profile_is_refused(tmp_path, content, told):
    with pytest.raises(Refusal, match=told):
        load(tmp_path, content)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("ardrone3", "choose from ardrone2, crazyflie, tum-simulator"),
        ("kobuki", "no uav profile is called 'kobuki'"),
        ("../profiles/ardrone2", "no uav profile is called"),
        ("", "no uav profile is called"),
        ("missing.toml", "cannot read missing.toml: No such file"),
        (".toml", r"\.toml"),
    ],
)
def test_a_name_that_is_no_drone_is_refused_with_those_that_are(name, told):
    with pytest.raises(Refusal, match=told):
        profiles.uav(name)


def test_a_folder_is_no_profile(tmp_path):
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    with pytest.raises(Refusal, match="is a folder"):
        profiles.uav(str(folder))


BODY = {
    field.name: list(value) if isinstance(value, tuple) else value
    for field in fields(profiles.UAVBody)
    for value in [getattr(profiles.uav("ardrone2").body, field.name)]
}

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)


@given(anything)
def test_no_value_at_all_makes_a_profile_that_is_not_of_its_kinds(value):
    try:
        body = profiles._value("mine.toml", profiles.UAVBody, {**BODY, "mass": value}, "body")
    except Refusal:
        return
    assert type(body.mass) is float
    assert 0.0 < body.mass <= profiles.LARGEST


def test_every_number_of_a_profile_that_ships_is_finite_and_not_negative():
    def numbers(part):
        for field in fields(part):
            value = getattr(part, field.name)
            if is_dataclass(value):
                yield from numbers(value)
            elif not isinstance(value, str):
                yield from np.ravel(value)

    for kind, names in (("uav", UAVS), ("rover", ROVERS)):
        for name in names:
            assert all(0.0 <= number <= profiles.LARGEST for number in numbers(LOADS[kind](name)))

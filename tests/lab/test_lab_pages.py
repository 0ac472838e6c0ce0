"""What the pages on the laboratory say is what the code has."""

import re
from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_args

import pytest

pytest.importorskip("msgspec", reason="skydog[lab] is not installed")

from skydog.flight.limits import Limits
from skydog.flight.supervisor import TRANSITIONS, Mode
from skydog.lab import orders
from skydog.lab.site import (
    DDS,
    ROS1,
    Cage,
    Mission,
    Mocap,
    Safety,
    UAVAdapter,
    UAVSite,
    UGVAdapter,
    UGVSite,
)

DOCS = Path(__file__).parents[2] / "docs"
LAB, DRONES = ((DOCS / name).read_text() for name in ("lab.md", "drones.md"))
PARTS = {
    "mission": Mission,
    "cage": Cage,
    "mocap": Mocap,
    "ros1": ROS1,
    "dds": DDS,
    "uav": UAVSite,
    "ugv": UGVSite,
    "safety": Safety,
}


def mode(name):
    return Mode[name.strip().upper().replace(" ", "_")]


def modes(names):
    """The modes that a cell of the table names."""
    if names.startswith("all but "):
        return set(Mode) - {mode(names.removeprefix("all but "))}
    return {mode(name) for name in names.split(",")}


def test_the_table_of_transitions_is_the_supervisors():
    table = LAB.split("## The supervisor", 1)[1].split("### Limits", 1)[0]
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \| [^|]*\|$", table, re.M)[2:]
    told = {(one, event): mode(then) for names, event, then in rows for one in modes(names)}
    assert told == TRANSITIONS


def test_the_limits_are_those_that_ship():
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) ?(?:m|s|m/s|rad|rad/s)? \|", LAB, re.M)
    ship = {one.name: one.default for one in fields(Limits) if one.default is not MISSING}
    told = {name: float(value) for name, value in rows}
    set_by_sites_and_profiles = {"silence", "drone_speed", "rover_speed"}
    assert told == {name: ship[name] for name in ship.keys() - set_by_sites_and_profiles}


def test_the_keys_are_those_that_are_heard():
    table = LAB.split("## Ways to stop", 1)[1].split("- **A file", 1)[0]
    keys = re.findall(r"^\| (?:`(\w)`|space) \|", table, re.M)
    assert {key or " " for key in keys} == {*orders.KEYS, "q"}


@pytest.mark.parametrize("part", PARTS)
def test_every_field_of_a_site_and_no_other_stands_on_the_page(part):
    told = set(re.findall(rf"`{part}\.(\w+)`", LAB))
    assert told == {field.name for field in fields(PARTS[part])}


def test_every_adapter_stands_on_the_page_of_drones():
    told = set(re.findall(r'`adapter = "([\w-]+)"`', DRONES))
    assert told == set(get_args(UAVAdapter))
    assert all(f'"{name}"' in LAB for name in get_args(UGVAdapter))

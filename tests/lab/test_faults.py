"""The fault campaign: its table, its verdict, and two of its flights through the whole chain."""

import json

import pytest
from realtime import in_real_time

from skydog.errors import Refusal
from skydog.flight.limits import Limits
from skydog.flight.supervisor import Mode
from skydog.lab.emulation import faults
from skydog.lab.emulation.faults import FAULTS, GUARD
from skydog.lab.emulation.verdict import Row, judged, outcome, table

GOOD = Row(
    name="silent-1",
    what="the tracker is silent for 1 s",
    expected="holds, lands",
    outcome="holds, lands",
    did=("0.10 s: mission → hold: eyes stale", "0.50 s: hold → landing: eyes stale long"),
    after=0.1,
    excursion=-0.6,
    blind=0.5,
    landed=8.0,
    landing=7.5,
    stood=0.5,
    crashed=False,
    readable=True,
    grown=0.1,
    packets=300,
    as_expected=False,
    problem="",
)


@pytest.mark.parametrize(
    "told",
    [
        *(f"the tracker is silent for {time} s" for time in ("0.1", "0.3", "1", "5")),
        "occluded",
        "mistaken for one another",
        "frozen",
        "jumps by 1 m",
        "is cut, doubled, late",
        "100,000 random",
        "master is killed and restarted",
        "no number",
        "hangs",
        "a rover is stuck",
        "obeys its last command for ever",
        "the base station is killed",
        "the disk is full",
        "the clock is put",
        "somebody else commands",
        "battery",
    ],
)
def test_the_table_has_every_fault_of_the_campaign(told):
    assert any(told in fault.what for fault in FAULTS.values())


def test_every_fault_of_the_table_has_an_outcome_that_can_come():
    modes = [
        [],
        [Mode.HOLD],
        [Mode.HOLD, Mode.MISSION],
        [Mode.HOLD, Mode.LANDING, Mode.DISARMED],
        [Mode.LANDING],
    ]
    possible = {*map(outcome, modes), GUARD, faults.REFUSED}
    assert {word for fault in FAULTS.values() for word in fault.expected} <= possible


def test_a_name_that_is_none_is_refused_with_the_nearest():
    with pytest.raises(Refusal, match="did you mean silent-1"):
        faults.named("silent1")


def test_a_row_in_which_all_is_well_is_as_expected():
    assert judged(GOOD).as_expected
    assert judged(GOOD).problem == ""


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"outcome": "holds, goes on"}, "it holds, goes on"),
        ({"excursion": 0.02}, "0.02 m beyond the fence"),
        ({"excursion": float("nan")}, "beyond the fence"),
        ({"blind": Limits.blind + 0.01}, "blind for 0.51 s"),
        ({"after": 0.3}, "the first after 0.30 s"),
        ({"after": None}, "the first after —"),
        ({"crashed": True}, "crashed"),
        ({"readable": False}, "log cannot be read"),
        ({"landed": None}, "does not stand on the ground"),
        ({"landing": 20.0}, "the landing took 20.00 s"),
        ({"stood": None}, "a rover does not stand"),
        ({"grown": 100.0}, "memory grew by 100 MB"),
        ({"problem": "the base station has died"}, "the base station has died"),
        ({"name": "silent-5"}, "does not read 'ALARM'"),
        ({"name": "packets-flood", "outcome": "goes on"}, "only 300 packets came"),
    ],
)
def test_a_row_in_which_something_is_wrong_is_not_as_expected(wrong, why):
    row = judged(GOOD._replace(**wrong))
    assert not row.as_expected
    assert why in row.problem


def test_the_table_of_rows_says_what_was_expected_and_what_came():
    head, (line,) = table([judged(GOOD._replace(excursion=0.1))])
    assert len(head) == len(line)
    assert "+0.10 m beyond the fence" in " ".join(line).replace("0.10 m beyond", "+0.10 m beyond")
    assert json.loads(json.dumps(GOOD._asdict()))["did"] == list(GOOD.did)


def test_a_folder_that_is_there_is_refused_before_anything_flies(tmp_path):
    campaign = pytest.importorskip("skydog.lab.emulation.campaign")
    (tmp_path / "silent-1").mkdir()
    with pytest.raises(Refusal, match="is there already"):
        campaign.campaign(["silent-0.1", "silent-1"], tmp_path)
    assert [folder.name for folder in tmp_path.iterdir()] == ["silent-1"]


@pytest.mark.parametrize("name", ["base-killed"])
def test_a_fault_flown_through_the_whole_chain_ends_as_the_table_says(name, tmp_path):
    pytest.importorskip("rospy", reason="rospy of ROS 1 is not here; see make ros")
    pytest.importorskip("rosmaster", reason="rosmaster of ROS 1 is not here; see make ros")
    from skydog.lab.emulation import campaign

    def flown(folder):
        row = campaign.fly(name, folder)
        assert row.as_expected, row.problem

    in_real_time(flown, tmp_path)

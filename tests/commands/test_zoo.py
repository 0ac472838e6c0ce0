"""The sheepdogs that ship, and the study that flies them."""

import pytest
from studies import assert_whole

from skydog.commands import reproduce
from skydog.commands.zoo import Plan
from skydog.shepherds import store
from skydog.study import evaluate, transfer
from skydog.study.reproduction import SCALED


@pytest.fixture(scope="module")
def from_zoo(tmp_path_factory):
    out = tmp_path_factory.mktemp("zoo")
    return out, reproduce.run(out, Plan(), True, "skydog reproduce --from-zoo", evaluate.fly)


def test_the_sheepdogs_that_ship_are_flown_without_training(from_zoo):
    assert_whole(*from_zoo)
    assert store.ships() == ["dhrl-4x4", "dhrl-6x6", "h-ddpg-4x4", "h-ddpg-6x6"]


@pytest.mark.parametrize(
    ("name", "steps", "distance"),
    [
        ("H-DDPG-4x4", 92, 7.5),
        ("H-DDPG-6x6", 180, 13.0),
        ("H-DDPG-4x4to6x6", 180, 12.0),
        ("DHRL-4x4", 1000, 1000.0),
        ("DHRL-6x6", 1000, 1000.0),
        ("DHRL-4x4to6x6", 1000, 1000.0),
    ],
)
def test_the_sheepdogs_that_ship_accomplish_every_case_in_few_steps(
    from_zoo, name, steps, distance
):
    ours = from_zoo[1]["rows"][name]["ours"]
    assert ours["success"] == 1.0
    assert ours["steps"]["mean"] <= steps
    assert ours["distance"]["mean"] <= distance


def test_the_rule_dog_fails_once_in_thirty_at_most(from_zoo):
    for name in ("Strombom-4x4", "Strombom-6x6"):
        assert from_zoo[1]["rows"][name]["ours"]["success"] >= 29 / 30


def test_dhrl_zigzags_and_needs_more_steps_than_h_ddpg_and_that_fewer_than_the_rule(from_zoo):
    rows = from_zoo[1]["rows"]
    for size in ("4x4", "6x6"):
        rule, dhrl, ours = (rows[f"{who}-{size}"]["ours"] for who in ("Strombom", "DHRL", "H-DDPG"))
        assert ours["steps"]["mean"] < dhrl["steps"]["mean"] < rule["steps"]["mean"]
        assert dhrl["turn"]["mean"] > 3 * ours["turn"]["mean"]


def test_the_sheepdog_of_four_metres_herds_from_three_to_twenty(from_zoo):
    line = from_zoo[1]["transfer"][SCALED]
    assert line.keys() == {f"{arena:g}" for arena in transfer.ARENAS}
    assert all(row["success"] >= 29 / 30 for row in line.values())
    assert line["6"]["success"] == 1.0

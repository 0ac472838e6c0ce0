"""The sheepdogs that ship, and the study that flies them."""

import pytest
from studies import assert_whole

from skydog.commands import reproduce
from skydog.commands.zoo import Plan
from skydog.shepherds import store
from skydog.study import evaluate, robustness, statistics, transfer
from skydog.study.reproduction import SCALED


@pytest.fixture(scope="module")
def from_zoo(tmp_path_factory):
    out = tmp_path_factory.mktemp("zoo")
    with pytest.MonkeyPatch.context() as patch:
        # A tenth of the missions: the whole is `skydog reproduce --from-zoo`.
        few = {
            "MISSIONS": 100,
            "MISSIONS_ANYWHERE": 200,
            "FLOCKS": (1, 7),
            "TO_GOALS": {
                4.0: ("H-DDPG-4x4", "H-DDPG-4x4-paper-frame"),
                6.0: ("H-DDPG-4x4", "H-DDPG-6x6"),
            },
            "FROM_ANYWHERE": ("H-DDPG-4x4",),
        }
        for name, value in few.items():
            patch.setattr(robustness, name, value)
        patch.setattr(statistics, "RESAMPLES", 999)
        return out, reproduce.run(out, Plan(), True, "skydog reproduce --from-zoo", evaluate.fly)


def test_the_sheepdogs_that_ship_are_flown_without_training(from_zoo):
    assert_whole(*from_zoo)
    kinds = ["dhrl-4x4", "dhrl-6x6", "h-ddpg-4x4", "h-ddpg-6x6"]
    others = ["h-ddpg-4x4-navigate", "h-ddpg-4x4-physical", "h-ddpg-6x6-physical"]
    study = [name + frame for name in kinds for frame in ("", "-paper-frame")]
    assert store.ships() == sorted([*study, *others])


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
        assert dhrl["turn"]["mean"] > 2 * ours["turn"]["mean"]


def test_the_sheepdog_of_four_metres_herds_from_three_to_twenty(from_zoo):
    line = from_zoo[1]["transfer"][SCALED]
    assert line.keys() == {f"{arena:g}" for arena in transfer.ARENAS}
    assert all(row["success"] >= 29 / 30 for row in line.values())
    assert line["6"]["success"] == 1.0


GOALS = robustness.GOALS


@pytest.mark.parametrize("flown", ["H-DDPG-4x4, 4 m", "H-DDPG-4x4, 6 m", "H-DDPG-6x6, 6 m"])
def test_a_sheepdog_herds_to_every_goal_and_as_fast_to_every_corner(from_zoo, flown):
    row = from_zoo[1]["robustness"]["goals"][flown]
    assert row.keys() == GOALS.keys()
    assert sum(cell["failed"] for cell in row.values()) <= 1
    corners = [cell["steps"]["mean"] for goal, cell in row.items() if goal.startswith("corner")]
    assert max(corners) < 1.1 * min(corners)  # 100 missions each: two standard errors are 0.06


def test_in_the_papers_frame_a_sheepdog_herds_to_the_corner_of_its_lessons_alone(from_zoo):
    row = from_zoo[1]["robustness"]["goals"]["H-DDPG-4x4-paper-frame, 4 m"]
    assert row["corner 0,0"]["success"] == 1.0
    assert row["corner L,L"]["success"] < 0.2


def test_sheep_are_collected_from_anywhere_if_the_stray_at_hand_is_taken(from_zoo):
    starts = from_zoo[1]["robustness"]["starts"]
    ours = starts["H-DDPG-4x4, stray at hand"]
    assert all(cell["failed"] == 0 for cell in ours.values())
    furthest = starts["H-DDPG-4x4, furthest stray"]["three corners, 9 m"]
    assert furthest["steps"]["mean"] > 1.3 * ours["three corners, 9 m"]["steps"]["mean"]


def test_flocks_of_every_size_and_noise_are_herded(from_zoo):
    results = from_zoo[1]["robustness"]
    for table in ("flocks", "noise"):
        for name, row in results[table].items():
            if name.startswith("H-DDPG"):
                assert all(cell["failed"] <= 1 for cell in row.values())

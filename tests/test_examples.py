"""Each example runs, is short, and shows what it says."""

import pytest

from loaded import EXAMPLES, example


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_is_shorter_than_60_lines(path):
    assert len(path.read_text().splitlines()) < 60


def test_a_flock_that_does_not_group_is_harder_for_the_rule_than_for_the_sheepdog(capsys):
    rows = example("own_sheep").main(count=200)
    cohesive, loose = rows.values()
    for shepherd in ("strombom", "h-ddpg-4x4"):
        assert cohesive[shepherd]["success_ci95"][0] > 0.9
        more = loose[shepherd]["steps"]["ci95"][0]
        assert more > cohesive[shepherd]["steps"]["ci95"][1]
    assert loose["strombom"]["success_ci95"][1] < loose["h-ddpg-4x4"]["success_ci95"][0]
    assert capsys.readouterr().out.count("h-ddpg-4x4") == 2


def test_a_dog_that_goes_round_the_flock_needs_fewer_steps_than_one_that_cuts_through(capsys):
    rows = example("own_dog").main(count=200)
    assert rows["circler"]["success_ci95"][0] > 0.95
    assert rows["circler"]["steps less strombom's"]["ci95"][1] < 0.0
    assert "circler less strombom" in capsys.readouterr().out


def test_a_third_lesson_is_learnt_in_seconds(capsys):
    untaught, taught = example("own_lesson").main(steps=10_000)
    assert abs(untaught) < 0.5
    assert taught > 3.0
    assert "taught 10000 steps" in capsys.readouterr().out


def test_a_mixed_flock_takes_longer_the_slower_its_sheep(capsys):
    rows = list(example("mixed_flock").main(count=60).values())
    assert all(row["success_ci95"][0] > 0.9 for row in rows)
    alike, slow, bold = (row["steps"]["ci95"] for row in rows)
    assert alike[1] < slow[0]
    assert alike[1] < bold[0]
    assert capsys.readouterr().out.count("steps") == 3


def test_a_mission_of_which_most_must_be_home_ends_before_one_of_all(capsys):
    rows = example("own_end").main(count=60)
    assert rows["most"]["steps"]["ci95"][1] < rows["all"]["steps"]["ci95"][0]
    assert "most home" in capsys.readouterr().out

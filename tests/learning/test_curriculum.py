import pytest

from skydog.errors import Refusal
from skydog.learning import lessons
from skydog.learning.curriculum import Curriculum
from skydog.world import herding


def test_the_folded_frame_has_lessons_as_missions_are_and_the_papers_has_the_papers():
    folded, paper = Curriculum(), Curriculum(frame="paper")
    assert folded.lesson("drive").draws == lessons.AS_IN_MISSIONS
    assert paper.lesson("drive").draws == lessons.EVEN
    assert paper.config().discount == 0.99
    assert folded.config().discount < 0.99
    assert (folded.dog, paper.dog) == ("H-DDPG-4x4", "H-DDPG-4x4-paper-frame")
    assert folded.card() != paper.card()


def test_a_goal_may_be_a_list_and_is_the_worlds():
    curriculum = Curriculum(goal=[1, 4], goal_radius=1.5)  # pyright: ignore[reportArgumentType]
    assert herding.goal(curriculum.world().arena).tolist() == [1.0, 4.0]
    assert curriculum.card()["goal"] == [1.0, 4.0]
    assert not curriculum.as_paper
    assert Curriculum(goal=(0.0, 0.0)).as_paper


def test_an_unknown_frame_is_refused_before_anything_is_taught():
    with pytest.raises(Refusal, match="folded, paper"):
        Curriculum(frame="x").world()  # pyright: ignore[reportArgumentType]

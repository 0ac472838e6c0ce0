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


def test_the_goal_is_the_worlds_and_only_the_papers_own_makes_a_row_of_the_papers():
    curriculum = Curriculum(goal=(1.0, 4.0), goal_radius=1.5)
    assert herding.goal(curriculum.world().arena).tolist() == [1.0, 4.0]
    assert curriculum.card()["goal"] == [1.0, 4.0]
    assert not curriculum.as_paper
    assert Curriculum(goal=(0.0, 0.0)).as_paper
    assert not Curriculum(sheep=5).as_paper

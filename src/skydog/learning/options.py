"""The options of a training, spelled once. Free to import."""

from typing import Literal

Skill = Literal["collect", "drive", "navigate"]
"""The lessons, and what each teaches. Only who is asked to navigate has the third."""

Learner = Literal["ddpg", "dqn"]
"""What learns a skill: a module of `skydog.learning`. A sheepdog learnt by DQN is DHRL."""

Reward = Literal["progress", "paper"]
"""How a lesson pays: see `skydog.learning.lessons.Lesson`."""

Bodies = Literal["ideal", "physical"]
"""Whether dogs and sheep move as commanded, or late as in `skydog.learning.dynamics`."""

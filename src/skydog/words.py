"""The words that choose between ways of doing things, spelled once; free to import."""

from typing import Literal

Skill = Literal["collect", "drive"]
"""The two lessons, and what each teaches."""

Learner = Literal["ddpg", "dqn"]
"""What teaches a skill: a module of `skydog.learning`. A sheepdog that DQN taught is DHRL."""

Reward = Literal["progress", "paper"]
"""How a lesson pays: see `skydog.learning.lessons.Lesson`."""

Starts = Literal["paper", "random"]
"""Where cases start: see `skydog.study.cases.cases`."""

AtPoint = Literal["constant", "arrive"]
"""What the rule dog does at its point: see `skydog.shepherds.strombom.Strombom`."""

CaseSet = Literal["paper", "hard"]
"""The fixed cases that ship: see `skydog.study.cases.shipped`."""

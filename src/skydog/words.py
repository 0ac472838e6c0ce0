"""The words that choose between ways of doing things, spelled once; free to import."""

from typing import Literal

Skill = Literal["collect", "drive"]
"""The two lessons, and what each teaches."""

Reward = Literal["progress", "paper"]
"""How a lesson pays: see `skydog.learning.lessons.Lesson`."""

Starts = Literal["paper", "random"]
"""Where cases start: see `skydog.study.cases.cases`."""

AtPoint = Literal["constant", "arrive"]
"""What the rule dog does at its point: see `skydog.shepherds.strombom.Strombom`."""

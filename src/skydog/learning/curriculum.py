"""What a sheepdog is taught, where and how. Free to import, and to send to another process."""

from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, overload

from skydog import quantities
from skydog.errors import Refusal, short
from skydog.learning.options import Bodies, Learner, Reward, Skill
from skydog.shepherds.options import Frame
from skydog.world.options import PRESET_NAMES

if TYPE_CHECKING:  # a worker pins itself to its core before jax is imported
    from skydog.learning.lessons import Lesson
    from skydog.learning.navigation import Navigation
    from skydog.world.params import World


# γ in the folded frame. The paper's 0.99 looks 100 steps ahead, twice as far as an episode goes on;
# with goals and sheep anywhere, one seed in four then lost missions through ξ.
DISCOUNT = 0.97


@dataclass(frozen=True)
class Curriculum:
    """Two lessons or three, the learner that takes them, and how long each may last."""

    preset: str = "paper"
    arena: float | None = None  # metres; None is the preset's own
    sheep: int = 3
    reward: Reward = "progress"
    steps: int = 150_000  # for each skill: 3,000 episodes of `progress`, as many as the paper's
    learner: Learner = "ddpg"
    episodes: int | None = None  # end a lesson too, if they are over before its steps
    one_scale: bool = False  # lessons at the arena's own scale alone, as the paper has them
    own_world: str | None = None  # FILE.py:NAME, a world of your own in place of the preset's
    goal: tuple[float, float] | None = None  # metres; None is the world's own
    goal_radius: float | None = None
    # In the paper's frame the lessons are the paper's too: with the world's own goal, and the
    # furthest stray to collect.
    frame: Frame = "folded"
    bodies: Bodies = "ideal"  # in the lessons
    navigates: bool = False  # whether there is the third lesson: see `skydog.learning.navigation`

    def __post_init__(self) -> None:
        checked = {"sheep": quantities.SHEEP, "steps": quantities.TRAINING}
        checked |= {} if self.arena is None else {"arena": quantities.ARENA}
        checked |= {} if self.episodes is None else {"episodes": quantities.EPISODES}
        checked |= {} if self.goal_radius is None else {"goal_radius": quantities.GOAL_RADIUS}
        for name, quantity in checked.items():
            object.__setattr__(self, name, quantity.checked(getattr(self, name)))
        for name, words in (
            ("preset", PRESET_NAMES),
            ("reward", get_args(Reward)),
            ("learner", get_args(Learner)),
            ("frame", get_args(Frame)),
            ("bodies", get_args(Bodies)),
        ):
            word = getattr(self, name)
            if not isinstance(word, str) or word not in words:
                raise Refusal(f"no {name} is called {short(word)}; choose from {', '.join(words)}")
        if self.navigates and self.learner != "ddpg":
            raise Refusal(f"navigate is learnt by ddpg, not by {self.learner}; use --learner ddpg")
        if self.goal is not None:  # a tuple, so that it has a hash
            goal = self.goal if isinstance(self.goal, list | tuple) else ()
            if len(goal) != 2:
                raise Refusal(f"a goal is x and y in metres, got {short(self.goal)}; try (4, 4)")
            object.__setattr__(self, "goal", tuple(goal))
        for name in ("one_scale", "navigates"):
            if not isinstance(getattr(self, name), bool):
                raise Refusal(f"{name} is True or False, got {short(getattr(self, name))}")
        if not isinstance(self.own_world, str | None):
            raise Refusal(f"own_world is FILE.py:NAME, got {short(self.own_world)}")

    def world(self) -> "World":
        """The world of the lessons. Raises `Refusal` for parameters that cannot be."""
        return _world(self)

    def anywhere(self) -> "Curriculum":
        """The same, from every working folder: a world's file by its whole path."""
        own = self.own_world
        return self if own is None else replace(self, own_world=str(Path(own).absolute()))

    @property
    def skills(self) -> tuple[Skill, ...]:
        """The skills that are taught."""
        return ("collect", "drive", "navigate") if self.navigates else ("collect", "drive")

    @overload
    def lesson(self, skill: Literal["collect", "drive"]) -> "Lesson": ...
    @overload
    def lesson(self, skill: Skill) -> "Lesson | Navigation": ...
    def lesson(self, skill: Skill) -> "Lesson | Navigation":
        """The lesson that teaches a skill. All worlds have the same one to navigate."""
        from skydog.learning import lessons, navigation

        if skill == "navigate":
            return navigation.lesson()

        return lessons.Lesson(
            self.world(),
            skill,
            self.reward,
            self.sheep,
            stretches=self.learner == "ddpg",
            scales=self.scales,
            frame=self.frame,
            draws=lessons.AS_IN_MISSIONS if self.frame == "folded" else lessons.EVEN,
            bodies=self.bodies,
        )

    @property
    def scales(self) -> tuple[float, float]:
        """The least and the greatest scale ξ of an episode."""
        from skydog.learning import lessons

        return (1.0, 1.0) if self.one_scale else lessons.SCALES

    def config(self, skill: Skill = "drive") -> Any:
        """The learner's numbers, as its file has them, but the `DISCOUNT` of the folded frame.

        To navigate, those of its lesson.
        """
        if skill == "navigate":
            from skydog.learning import navigation

            return navigation.CONFIG
        config = import_module(f"skydog.learning.{self.learner}").Config()
        return config if self.frame == "paper" else replace(config, discount=DISCOUNT)

    @property
    def as_paper(self) -> bool:
        """Whether missions in its world are the paper's own: preset, flock and goal."""
        from skydog.world import presets

        ours = (self.preset, self.own_world, self.sheep) == ("paper", None, 3)
        return ours and presets.has_own_goal(self.world(), self.preset, self.sheep)

    @property
    def dog(self) -> str:
        """What the sheepdog is called that comes of it, as the paper does: H-DDPG-4x4."""
        from skydog.world import loading

        kind = {"ddpg": "H-DDPG", "dqn": "DHRL"}[self.learner]
        size = float(self.world().arena.size)
        odd = "-paper-reward" * (self.reward == "paper") + "-one-scale" * self.one_scale
        odd += "-paper-frame" * (self.frame == "paper") + "-physical" * (self.bodies == "physical")
        odd += "-navigate" * self.navigates
        own = "" if self.own_world is None else f"-{loading.title(self.own_world)}"
        return f"{kind}-{size:g}x{size:g}{odd}{own}"

    def card(self) -> dict[str, Any]:
        """What must be the same for a training to be continued."""
        from skydog.world import loading

        own, arena = self.own_world, self.world().arena
        return {
            "preset": self.preset if own is None else None,
            "own_world": None if own is None else loading.title(own),
            "SHA-256 of the world's file": None if own is None else loading.digest(own),
            "arena": float(arena.size),
            "goal": [float(arena.goal_x), float(arena.goal_y)],
            "goal_radius": float(arena.goal_radius),
            "sheep": self.sheep,
            "reward": self.reward,
            "learner": self.learner,
            "one_scale": self.one_scale,
            "frame": self.frame,
            # Trainings from before there were any say nothing of bodies.
            **({} if self.bodies == "ideal" else {"bodies": self.bodies}),
        }


@cache  # a world of one's own may take long to make, and the name of every message needs it
def _world(curriculum: Curriculum) -> "World":
    from skydog.world import loading, mission, presets

    own, goal = curriculum.own_world, (curriculum.goal, curriculum.goal_radius)
    if own is not None:
        made = presets.make(loading.maker(own), curriculum.arena, curriculum.sheep, *goal)
        made = mission.check(made, curriculum.sheep)
    else:
        made = presets.preset(curriculum.preset, curriculum.arena, curriculum.sheep, *goal)
    return presets.furthest_first(made) if curriculum.frame == "paper" else made

"""Whether `NumpyLesson` is the task that `skydog.learning.lessons.Lesson` is."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy_lesson import NumpyLesson
from scipy.stats import ks_2samp

from skydog.learning import lessons
from skydog.learning.lessons import Episode, Lesson
from skydog.world import presets, serialise

TOLERANCE = 1e-4  # metres: single precision, in arenas of up to 40 m, against double
UNLIKELY = 1e-3  # below this p, starts differ: of equal ones, ten p's fall below it one time in 100
AGO = 25  # steps flown at random before the one compared: flocks in motion, not only at rest


@dataclass(frozen=True)
class Agreement:
    """The greatest differences over so many steps, and how alike the starts are."""

    cases: int
    observation: float
    reward: float
    state: float  # places and forces
    truncation: bool  # whether time was over for both in the same cases
    starts: int
    starts_p: float  # the least p of Kolmogorov-Smirnov tests, one for each number of a start

    @property
    def same(self) -> bool:
        furthest = max(self.observation, self.reward, self.state)
        return furthest <= TOLERANCE and self.truncation and self.starts_p > UNLIKELY


def lesson() -> Lesson:
    """The task of the benchmark: drive three sheep in the paper's arena of 4 m."""
    world = presets.preset("paper", 4.0, 3)
    return Lesson(world, "drive", "progress", 3, frame="paper", draws=lessons.EVEN)


def numbers(task: Lesson) -> dict[str, float]:
    """The world's parameters and the lesson's own, as `NumpyLesson` takes them."""
    smallest, largest = lessons.SCALES
    world = serialise.flatten(task.world)
    plain = {name: float(value) for name, value in world.items() if isinstance(value, int | float)}
    return plain | {
        "lesson.horizon": float(lessons.HORIZON[task.reward]),
        "lesson.smallest_scale": smallest,
        "lesson.largest_scale": largest,
        "lesson.reach": lessons.REACH,
        "lesson.flock_share": lessons.FLOCK_SHARE,
        "lesson.nearer": lessons.NEARER,
        "lesson.distance_cost": lessons.DISTANCE_COST,
        "lesson.flight_cost": lessons.FLIGHT_COST,
    }


def check(cases: int = 200, starts: int = 10_000, seed: int = 0) -> Agreement:
    """Compare one step from each of `cases` random states and actions, and `starts` starts."""
    task = lesson()
    ours = NumpyLesson(numbers(task), task.sheep)
    rng = np.random.default_rng(seed)

    begun = jax.jit(jax.vmap(task.start))(jax.random.split(jax.random.key(seed), starts))
    ours.reset(seed)
    episodes = jax.tree.map(lambda leaf: leaf[:cases], begun)
    # Whole velocities for many steps on end: a dog that shivers on the spot meets few sheep.
    # Some are beyond what a dog can fly.
    actions = rng.uniform(-1.3, 1.3, (2, cases, 2)).astype(np.float32)
    fly = jax.jit(jax.vmap(task.step))
    for _ in range(AGO):
        episodes, _ = fly(episodes, actions[0])
    lasted = rng.integers(0, lessons.HORIZON[task.reward], cases)
    lasted[: cases // 10] = lessons.HORIZON[task.reward] - 1
    episodes = eqx.tree_at(lambda e: e.step, episodes, jnp.asarray(lasted))
    after, outcome = fly(episodes, actions[1])
    look = jax.vmap(task.observe)
    before_seen, after_seen = np.asarray(look(episodes)), np.asarray(look(after))

    far = {"observation": 0.0, "reward": 0.0, "state": 0.0}
    over = []
    for i in range(cases):
        seen = ours.set_state(*_state(episodes, i), episodes.scale[i], episodes.step[i])
        again, reward, truncated = ours.step(actions[1, i])
        over.append(truncated)
        pairs = [
            ("observation", seen, before_seen[i]),
            ("observation", again, after_seen[i]),
            ("reward", reward, outcome.reward[i]),
            *(("state", *both) for both in zip(ours.state(), _state(after, i), strict=True)),
        ]
        for name, one, other in pairs:
            far[name] = max(far[name], float(np.max(np.abs(one - np.asarray(other)))))
    return Agreement(
        cases=cases,
        **far,
        truncation=bool(np.all(np.array(over) == np.asarray(outcome.truncated)))
        and not np.any(outcome.terminated),
        starts=starts,
        starts_p=_starts_p(begun, [_drawn(ours) for _ in range(starts)]),
    )


def _state(episodes: Episode, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    state = episodes.state
    return np.asarray(state.sheep[i]), np.asarray(state.dogs[i, 0]), np.asarray(state.force[i])


def _drawn(task: NumpyLesson) -> tuple[np.ndarray, np.ndarray, float]:
    task.reset()
    sheep, dog, _ = task.state()
    return sheep, dog, task.scale


def _describe(sheep: np.ndarray, dog: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The ten numbers of each start: places, scale, and how far out the furthest sheep is."""
    reach = np.linalg.norm(sheep - sheep.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    numbers = np.column_stack([sheep.reshape(len(sheep), -1), dog, scale, reach])
    return numbers.astype(np.float32)  # where many dogs start: at the edge of the airspace


def _starts_p(begun: Episode, drawn: list[tuple[np.ndarray, np.ndarray, float]]) -> float:
    state, scale = begun.state, np.asarray(begun.scale)
    one = _describe(np.asarray(state.sheep), np.asarray(state.dogs)[:, 0], scale)
    sheep, dogs, scales = zip(*drawn, strict=True)
    other = _describe(np.array(sheep), np.array(dogs), np.array(scales))
    tests = [ks_2samp(*pair) for pair in zip(one.T, other.T, strict=True)]
    return min(float(test.pvalue) for test in tests)  # pyright: ignore[reportAttributeAccessIssue]


if __name__ == "__main__":
    print(check())

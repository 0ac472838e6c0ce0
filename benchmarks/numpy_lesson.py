"""The *drive* lesson with the `progress` reward, for learners that know no JAX.

`skydog.learning.lessons.Lesson` over again, law by law, in float64. For three sheep a Python
number is several times as fast as an array of two: positions are complex numbers, `abs` is
the distance, and NumPy draws the starts and carries what a learner sees. `same_task` proves
that it is the same task; here nothing of skydog is imported.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np


def unit(v: complex) -> complex:
    """The direction of `v`, and zero for zero."""
    return v / abs(v) if v else 0j


def vector(position: Sequence[float] | np.ndarray) -> complex:
    return complex(position[0], position[1])


class NumpyLesson:
    """One episode at a time, as in Gymnasium: `reset`, then `step` until it is truncated."""

    def __init__(self, numbers: Mapping[str, float], sheep: int = 3):
        """`numbers` is what `same_task.numbers` tells of a world and the lesson."""
        self.avoidance = numbers["flock.avoidance"]
        self.sensing = numbers["flock.sensing"]
        self.inertia = numbers["flock.inertia"]
        self.grouping = numbers["flock.grouping"]
        self.escape = numbers["flock.escape"]
        self.repulsion = numbers["flock.repulsion"]
        self.stride = numbers["sheep.speed"] * numbers["arena.dt"]
        self.gathered_radius = numbers["spread.length"] * sheep ** (2 / 3)
        self.flight = numbers["dog.speed"] * numbers["arena.dt"]
        self.driving = numbers["dog.driving"] * math.sqrt(sheep)
        self.home = numbers["arena.size"]
        self.goal = complex(numbers["arena.goal_x"], numbers["arena.goal_y"])
        self.beyond = numbers["dog.airspace"]
        self.horizon = numbers["lesson.horizon"]
        self.smallest = math.log(numbers["lesson.smallest_scale"])
        self.largest = math.log(numbers["lesson.largest_scale"])
        self.reach = numbers["lesson.reach"]
        self.flock_share = numbers["lesson.flock_share"]
        self.nearer = numbers["lesson.nearer"]
        self.distance_cost = numbers["lesson.distance_cost"]
        self.flight_cost = numbers["lesson.flight_cost"]
        self.count = sheep
        self.rng = np.random.default_rng()

    def reset(self, seed: int | None = None) -> np.ndarray:
        """Start as `Lesson.start` does; what the dog sees."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        x, y, dog_x, dog_y, scale, *others = self.rng.random(5 + 2 * self.count).tolist()
        self._live_at(math.exp(self.smallest + (self.largest - self.smallest) * scale))
        centre = self.size * complex(0.15 + 0.75 * x, 0.15 + 0.75 * y)
        sheep = []
        for share, turn in zip(others[: self.count], others[self.count :], strict=True):
            angle = 2 * math.pi * turn
            away = complex(math.cos(angle), math.sin(angle))
            one = centre + self.gathered_radius * math.sqrt(share) * away
            sheep.append(self._in_arena(one))
        away = self.reach * complex(2 * dog_x - 1, 2 * dog_y - 1)
        dog = self._in_airspace(sum(sheep) / self.count + away)
        return self._begin(sheep, dog, [0j] * self.count, 0)

    def set_state(
        self, sheep: np.ndarray, dog: np.ndarray, force: np.ndarray, scale: float, steps: int
    ) -> np.ndarray:
        """Go on from any state: places in metres, forces as `State.force`; what the dog sees."""
        self._live_at(float(scale))
        return self._begin(
            [vector(one) for one in sheep],
            vector(dog),
            [vector(one) for one in force],
            int(steps),
        )

    def state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sheep, dog and forces, as `set_state` takes them."""
        pairs = [(v.real, v.imag) for v in (*self.sheep, self.dog, *self.force)]
        numbers = np.array(pairs)
        return numbers[: self.count], numbers[self.count], numbers[self.count + 1 :]

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Fly one step: what the dog sees, the reward, and whether the time is over."""
        x, y = action.tolist()
        if self.scale != 1.0:
            x, y = math.tanh(x / self.scale), math.tanh(y / self.scale)
        velocity = complex(min(max(x, -1.0), 1.0), min(max(y, -1.0), 1.0))
        was, far, before = self.distance, self.far, self.dog
        self._move_sheep()
        self.dog = self._in_airspace(self.dog + self.flight * velocity)
        self.steps += 1
        seen = self._look()
        reward = was - self.distance + self.flock_share * (far - self.far)
        reward -= self.distance_cost * self.scale * self.distance
        reward -= self.flight_cost * abs(self.dog - before)
        return seen, reward, self.steps >= self.horizon

    def _move_sheep(self) -> None:
        sheep, count = self.sheep, self.count
        crowd, pull = [0j] * count, [0j] * count
        for i in range(count):
            for k in range(i + 1, count):
                away = sheep[i] - sheep[k]
                apart = abs(away)
                pull[i] -= away
                pull[k] += away
                if 0.0 < apart <= self.avoidance:
                    push = away / apart
                    crowd[i] += push
                    crowd[k] -= push
        for i in range(count):
            total = 0j
            flee = sheep[i] - self.dog
            afraid = abs(flee) <= self.sensing
            if afraid or crowd[i]:
                total = self.inertia * self.force[i] + self.repulsion * unit(crowd[i])
            if afraid:
                total += self.grouping * unit(pull[i]) + self.escape * unit(flee)
            self.force[i] = unit(total)
        for i in range(count):
            sheep[i] = self._in_arena(sheep[i] + self.stride * self.force[i])

    def _live_at(self, scale: float) -> None:
        self.scale = scale
        self.size = self.home / scale
        self.lowest, self.highest = -self.beyond, self.size + self.beyond

    def _begin(
        self, sheep: list[complex], dog: complex, force: list[complex], steps: int
    ) -> np.ndarray:
        self.sheep, self.dog, self.force = sheep, dog, force
        self.steps = steps
        return self._look()

    def _look(self) -> np.ndarray:
        """What the dog sees; keeps the two distances that the next reward starts from."""
        centre = sum(self.sheep) / self.count
        from_goal = centre - self.goal
        from_centre = self.dog - centre
        behind = self.driving * unit(from_goal)
        from_point = self.dog - self._in_airspace(centre + behind)
        self.far = abs(from_goal)
        self.distance = abs(self.dog - self._in_airspace(centre + self.nearer * behind))
        seen = (from_centre.real, from_centre.imag, from_point.real, from_point.imag)
        return np.array([self.scale * number for number in seen], np.float32)

    def _in_arena(self, v: complex) -> complex:
        return complex(min(max(v.real, 0.0), self.size), min(max(v.imag, 0.0), self.size))

    def _in_airspace(self, v: complex) -> complex:
        low, high = self.lowest, self.highest
        return complex(min(max(v.real, low), high), min(max(v.imag, low), high))

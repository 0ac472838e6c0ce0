"""The shepherd, in a thread of its own: one that hangs cannot hang the base station."""

import threading
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from skydog.errors import Refusal
from skydog.flight.base import Decided
from skydog.world import memory, mission, params
from skydog.world.mission import Shepherd
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import column

LONGEST_SELF_TEST = 60.0  # s: the first decision is compiled
TESTS = 4  # decisions of a self-test


class Seen(NamedTuple):
    """What is decided on: positions in metres, the latest forces, the number of the step."""

    step: int
    sheep: Float[np.ndarray, "sheep 2"]
    dogs: Float[np.ndarray, "dogs 2"]
    force: Float[np.ndarray, "sheep 2"]  # on the sheep, of the decision before


class Decision(NamedTuple):
    """`skydog.world.mission.Decision`, in NumPy."""

    velocity: Float[np.ndarray, "dogs 2"]
    force: Float[np.ndarray, "sheep 2"]
    subgoal: Float[np.ndarray, "dogs 2"]
    drives: Bool[np.ndarray, " dogs"]


class Answer(NamedTuple):
    """What was decided, on which step, how long it took in seconds, and whether all are home."""

    step: int
    decision: Decision
    moves: Decided  # as the base station takes it, a batch of one
    accomplished: bool
    took: float


class Policy:
    """Asked with `ask`, it answers with `answer`; asked again meanwhile, the newest counts."""

    def __init__(self, world: World, shepherd: Shepherd, sheep: int, dogs: int):
        memory.none(world, "the laboratory")
        self.problem: str | None = None
        self._period = float(world.arena.dt)
        self._sheep, self._dogs = sheep, dogs
        # World and shepherd are constants of what is compiled: a tenth of the time of a call.
        world, shepherd = params.traced(world), params.traced(shepherd)
        self._decide = jax.jit(lambda given: _decide(world, shepherd, dogs, given))
        self._asked: Seen | None = None
        self._answered: Answer | None = None
        self._lock = threading.Lock()  # so that no older answer passes for the newest
        self._wake, self._done = threading.Event(), threading.Event()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="policy", daemon=True)
        self._thread.start()

    def self_test(self, seen: Seen) -> None:
        """Decide a few times. Raises `Refusal` if it fails, is slow or has no number."""
        took = []
        for _ in range(TESTS):
            self.ask(seen)
            answer = self.answer(LONGEST_SELF_TEST)
            if self.problem is not None:
                raise Refusal(f"the sheepdog fails its self-test: {self.problem}")
            if answer is None:
                raise Refusal(f"the sheepdog does not decide within {LONGEST_SELF_TEST:g} s")
            if not all(np.isfinite(part).all() for part in answer.moves):
                raise Refusal("the sheepdog decides on something that is no number")
            took.append(answer.took)
        if min(took) > self._period:
            raise Refusal(
                f"the sheepdog takes {min(took):.2g} s to decide, and decisions are "
                f"{self._period:g} s apart"
            )

    def ask(self, seen: Seen) -> None:
        """Let it decide. Returns at once."""
        with self._lock:
            self._answered = None
            self._done.clear()
            self._asked = seen
        self._wake.set()

    def answer(self, patience: float) -> Answer | None:
        """What was decided since it was asked, if it comes within so many seconds."""
        self._done.wait(patience)
        answer, self._answered = self._answered, None
        return answer

    def close(self) -> None:
        """Let it go. A shepherd that hangs is left behind: its thread dies with the process."""
        self._closed = True
        self._wake.set()
        self._thread.join(0.5)

    def _run(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            if self._closed:
                return
            seen = self._asked
            assert seen is not None
            began = time.monotonic()
            try:
                answer = self._answer(seen, began)
            except Exception as problem:  # whatever a shepherd of one's own may raise
                self.problem = f"{type(problem).__name__}: {_in_a_line(problem)}"
                self._done.set()
                continue
            with self._lock:
                if self._asked is seen:
                    self._answered = answer
                    self._done.set()

    def _answer(self, seen: Seen, began: float) -> Answer:
        given = np.concatenate([seen.sheep, seen.dogs, seen.force], dtype=np.float32)
        found = np.asarray(self._decide(given))
        dogs, rows = self._dogs, found[:-1].reshape(-1, 2)
        velocity, subgoal, drives = rows[:dogs], rows[dogs : 2 * dogs], rows[2 * dogs : 3 * dogs]
        force, pushed = rows[3 * dogs : -self._sheep], rows[-self._sheep :]
        return Answer(
            seen.step,
            Decision(np.nan_to_num(velocity), force, subgoal, drives[:, 0] > 0.5),
            Decided(velocity[None].astype(float), pushed[None].astype(float)),
            bool(found[-1] > 0.5),
            time.monotonic() - began,
        )


def _in_a_line(problem: Exception) -> str:
    """What is wrong: the first line, and the last if there are more, where a traceback has it."""
    lines = str(problem).strip().splitlines() or [""]
    return " … ".join(f"{line.strip():.160}" for line in dict.fromkeys((lines[0], lines[-1])))


def _decide(
    world: World, shepherd: Shepherd, dogs: int, given: Float[Array, "rows 2"]
) -> Float[Array, " numbers"]:
    """All that is decided, in one array, since each that goes or comes takes its time.

    Given are rows of two: sheep, dogs, forces. What comes is, too: the dogs' velocities, subgoals,
    whether each drives; the sheep's forces, and at what velocities those push them. The last
    number is whether all are home.
    """
    sheep = (len(given) - dogs) // 2
    state = State(given[:sheep], given[sheep : sheep + dogs], given[sheep + dogs :])
    wanted = shepherd(world, state)
    decided = mission.decide(world, lambda *_: wanted, state)
    # A dog hovers on what is no number (`mission.limited`); the supervisor is to know of it.
    velocity = jnp.where(jnp.isfinite(wanted).all(), decided.velocity, jnp.nan)
    drives = jnp.repeat(decided.drives.astype(jnp.float32), 2).reshape(-1, 2)
    pushed = column(world.sheep.speed, sheep) * decided.force
    rows = (velocity, decided.subgoal, drives, decided.force, pushed)
    home = mission.accomplished(world, state).astype(jnp.float32)
    return jnp.concatenate([jnp.concatenate(rows).ravel(), home[None]])

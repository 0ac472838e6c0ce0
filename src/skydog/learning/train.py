"""The one loop: a task, a learner, compiled chunks; curves, checkpoints, resume."""

import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from skydog import files, numerics
from skydog.arrays import load_arrays, save_arrays
from skydog.errors import Refusal
from skydog.learning import history as histories
from skydog.learning import replay
from skydog.learning.history import EpisodeEnds, History
from skydog.learning.replay import Replay, Transition

KIND = "checkpoint"
CHUNK = 1_000  # steps a compiled call: long enough to cost nothing, short enough to watch
CHECKPOINT = 20_000  # steps between checkpoints
RECENT = 100  # episodes that tell how well a training goes; one alone tells where it started


@runtime_checkable
class Task(Protocol):
    """What is to be learnt: pure functions of an episode. A `Lesson` is one."""

    observation: ClassVar[int]
    action: ClassVar[int]

    def start(self, key: PRNGKeyArray) -> Any:
        """A fresh episode."""
        ...

    def observe(self, episode: Any) -> Float[Array, " seen"]:
        """What the learner sees of it."""
        ...

    def step(self, episode: Any, action: Float[Array, " action"]) -> tuple[Any, Any]:
        """The episode a step later, and its `Outcome`."""
        ...


class Training(eqx.Module):
    """The whole state of a training; with the seed, all that its future depends on."""

    agent: Any  # of the learner that the config belongs to
    memory: Replay
    episode: Any
    step: Int[Array, ""]
    reward: Float[Array, ""]  # summed over the episode so far
    length: Int[Array, ""]  # of the episode so far


@dataclass(frozen=True)
class Progress:
    """How far a training has come; what a callback gets after each chunk."""

    step: int
    steps: int
    episodes: int
    reward_per_action: float  # over the last 100 episodes
    success: float  # over the last 100 episodes
    # As it is now, to fly missions with. The next chunk takes its memory: use it before you return.
    skill: Any = None


def learner(config: Any) -> ModuleType:
    """The learner that a config belongs to: the module it comes from, `ddpg` or like it.

    A learner is a file with `Config`, `init`, `draw`, `explore`, `episode_start` and `update`.
    """
    return sys.modules[type(config).__module__]


def init(task: Task, config: Any, key: PRNGKeyArray) -> Training:
    """A training that has not begun."""
    for_agent, for_start = jax.random.split(key)
    return Training(
        agent=learner(config).init(for_agent, task.observation, task.action, config),
        memory=replay.empty(config.memory, _blank(task)),
        episode=task.start(for_start),
        step=jnp.asarray(0),
        reward=jnp.zeros(()),  # a strong type, as after a step: else the loop is compiled twice
        length=jnp.asarray(0),
    )


@numerics.ours()
def blank(task: Task, config: Any) -> Training:
    """A training of zeros, for `load` to be compared with: nothing is compiled for it."""
    shapes = jax.eval_shape(lambda: init(task, config, jax.random.key(0)))
    return jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), shapes)


@partial(jax.jit, static_argnames=("config", "steps"), donate_argnames="training")
def advance(
    task: Any, config: Any, training: Training, key: PRNGKeyArray, steps: int
) -> tuple[Training, EpisodeEnds]:
    """So many steps of Algorithm 1, each with one update, in one compiled loop.

    The randomness of a step comes from `key` and the step's number alone: however a training
    is cut into chunks, it is the same training.
    """

    learns = learner(config)

    def draw(step: Int[Array, ""]) -> tuple[Any, PRNGKeyArray]:
        for_learner, for_start = jax.random.split(jax.random.fold_in(key, step))
        return learns.draw(for_learner, task.action, config), for_start

    def one(training: Training, drawn: tuple[Any, PRNGKeyArray]) -> tuple[Training, EpisodeEnds]:
        random, for_start = drawn
        seen = task.observe(training.episode)
        agent, action = learns.explore(training.agent, seen, config, random)
        episode, outcome = task.step(training.episode, action)
        transition = Transition(
            observation=seen,
            action=action,
            reward=outcome.reward,
            next_observation=task.observe(episode),
            terminated=outcome.terminated.astype(jnp.float32),
        )
        # Written before sampled: XLA then updates the ring in place instead of copying it.
        memory = replay.add(training.memory, transition)
        batch = replay.sample(memory, random.picks, transition)
        agent = jax.lax.cond(
            memory.written >= config.batch,
            lambda: learns.update(agent, batch, config),
            lambda: agent,
        )

        ended = outcome.terminated | outcome.truncated
        reward, length = training.reward + outcome.reward, training.length + 1
        after = Training(
            agent=learns.episode_start(agent, ended),
            memory=memory,
            episode=jax.lax.cond(ended, lambda: task.start(for_start), lambda: episode),
            step=training.step + 1,
            reward=jnp.where(ended, 0.0, reward),
            length=jnp.where(ended, 0, length),
        )
        return after, EpisodeEnds(ended, reward, length, outcome.success)

    # Drawn for the whole chunk at once: inside the loop it would cost more than the learning.
    chances = jax.vmap(draw)(training.step + jnp.arange(steps))
    return jax.lax.scan(one, training, chances)


@numerics.ours()
def train(
    task: Task,
    config: Any,
    seed: int,
    steps: int,
    folder: Path | None = None,
    card: dict[str, Any] | None = None,
    resume: bool = False,
    callback: Callable[[Progress], bool] = lambda _: True,
    episodes: int | None = None,
) -> tuple[Training, History]:
    """Train until `steps` steps or `episodes` episodes are done, or `callback` returns False.

    `callback` gets a `Progress` after each chunk. With a `folder`, everything is kept there:
    `checkpoint.safetensors` (networks, optimisers, memory, episode, history; every 20,000
    steps and at the end) and `curve.csv`. `card` says what is trained; `resume` continues a
    checkpoint of the same card, bit for bit, and starts anew where there is none. Raises
    `Refusal` for a checkpoint that is damaged, of another training, or further than `steps`.
    """
    key, for_init = jax.random.split(jax.random.key(seed))
    training = init(task, config, for_init)
    history = histories.begun(training.agent.skill)
    card = {**(card or {}), "seed": seed, "config": files.plain(asdict(config))}
    if resume and folder is not None and checkpoint_in(folder).exists():
        training, history = load(folder, training, card)

    done = int(training.step)
    if done > steps:
        raise Refusal(
            f"{folder} was trained for {done:,} steps already, more than the {steps:,} that are "
            "asked for; ask for at least as many, or choose another --out"
        )
    saved = -1
    more = True
    while more and not finished(training, history, steps, episodes):
        chunk = min(CHUNK, steps - done, histories.SNAPSHOT - done % histories.SNAPSHOT)
        training, ended = advance(task, config, training, key, chunk)
        done = int(training.step)
        history = history.extended(done, training.agent.skill, ended)
        _refuse_diverged(done, np.asarray(ended.reward))
        more = callback(_progress(history, done, steps, training.agent.skill))
        if folder is not None and done % CHECKPOINT < CHUNK:
            _save(folder, training, history, card)
            saved = done
    if folder is not None and saved != done:
        _save(folder, training, history, card)
    return training, history


def finished(training: Training, history: History, steps: int, episodes: int | None = None) -> bool:
    """Whether a training has come to its end: to its steps, or before them to its episodes."""
    learnt_enough = episodes is not None and len(history.reward) >= episodes
    return int(training.step) >= steps or learnt_enough


def checkpoint_in(folder: Path) -> Path:
    """Where a training's checkpoint lies in its folder."""
    return Path(folder) / "checkpoint.safetensors"


@numerics.ours()
def load(folder: Path, like: Training, card: dict[str, Any]) -> tuple[Training, History]:
    """Read the checkpoint in a folder, of a training of the shapes of `like`.

    Raises `Refusal` if it is missing or damaged, or if its card contradicts `card`.
    """
    path = checkpoint_in(folder)
    arrays, found = load_arrays(path, KIND)
    for name, wanted in card.items():
        if found.get(name) != wanted:
            raise Refusal(
                f"{path} is of a training with {name} {found.get(name)!r}, not {wanted!r}; "
                "resume with the same options, or choose another --out"
            )
    begun, missing = histories.begun(like.agent.skill), np.zeros(())
    # A training from before skills were kept has none.
    older = "history.step" not in arrays
    kept = [
        arrays.pop(f"history.{name}", leaf[:0] if older else missing)
        for name, leaf in _named(begun).items()
    ]
    history = jax.tree.unflatten(jax.tree.structure(begun), kept)
    expected = _named(like)
    shapes = {name: (leaf.shape, leaf.dtype) for name, leaf in expected.items()}
    if {name: (leaf.shape, leaf.dtype) for name, leaf in arrays.items()} != shapes:
        raise Refusal(f"{path} does not fit this version of skydog; train again")
    if not history.fits(like.agent.skill):
        raise Refusal(f"{path} is damaged: its history is no list of episodes; train again")
    leaves = [jnp.asarray(arrays[name]) for name in expected]
    return jax.tree.unflatten(jax.tree.structure(like), leaves), history


def _refuse_diverged(step: int, *values: np.ndarray) -> None:
    """Raise `Refusal` if a reward or a weight is no finite number any more."""
    if not all(np.all(np.isfinite(each)) for each in values if each.dtype.kind == "f"):
        raise Refusal(
            f"the training diverged: a reward or a weight is not a finite number after {step:,} "
            "steps; does the task give a reward or an observation that is not finite?"
        )


def _blank(task: Task) -> Transition:
    seen, nothing = jnp.zeros(task.observation), jnp.zeros(())
    return Transition(seen, jnp.zeros(task.action), nothing, seen, nothing)


def _progress(history: History, done: int, steps: int, skill: Any) -> Progress:
    last = slice(-RECENT, None)
    actions = max(1, int(history.length[last].sum()))
    return Progress(
        step=done,
        steps=steps,
        episodes=len(history.reward),
        reward_per_action=float(history.reward[last].sum()) / actions,
        success=float(history.success[last].mean()) if len(history.success) else 0.0,
        skill=skill,
    )


def _named(tree: Any) -> dict[str, Any]:
    """The leaves of a tree by their paths in it, as a file names them."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="."): leaf for path, leaf in leaves}


def _save(folder: Path, training: Training, history: History, card: dict[str, Any]) -> None:
    arrays = {name: np.asarray(leaf) for name, leaf in _named(training).items()}
    _refuse_diverged(int(training.step), *arrays.values())
    arrays |= {f"history.{name}": values for name, values in _named(history).items()}
    save_arrays(checkpoint_in(folder), arrays, {"kind": KIND, **card})
    files.write_text(folder / "curve.csv", history.csv())

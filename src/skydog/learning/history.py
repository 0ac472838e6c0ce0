"""The history of a training: its episodes, the skill on the way, and the learning curve."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

SNAPSHOT = 5_000  # steps between the skills that are kept
EPISODES_A_ROW = 10  # paper, Section "Training": rewards in every 10 episodes

Curve = tuple[np.ndarray, np.ndarray]
"""What one seed learnt: episodes, and the reward per action in the ten up to each of them."""


class EpisodeEnds(eqx.Module):
    """Which steps of a chunk ended an episode, and what that episode had come to."""

    ended: Bool[Array, "*chunk"]
    reward: Float[Array, "*chunk"]
    length: Int[Array, "*chunk"]
    success: Bool[Array, "*chunk"]


class History(eqx.Module):
    """The episodes that have ended, in their order, and the skill as it was on the way."""

    reward: Float[np.ndarray, " episodes"]  # summed over the episode
    length: Int[np.ndarray, " episodes"]  # in steps
    success: Bool[np.ndarray, " episodes"]
    step: Int[np.ndarray, " snapshots"]  # 0, and every `SNAPSHOT` steps
    skills: Any  # the agent's skill at each of these steps, stacked along a first axis

    def skill(self, step: int) -> Any:
        """The skill after so many steps, one of `self.step`. At 0 it is untaught."""
        (row,) = np.flatnonzero(self.step == step)
        return jax.tree.map(lambda leaf: jnp.asarray(leaf[row]), self.skills)

    def rows(self) -> list[tuple[int, float, float]]:
        """Every 10 episodes: the last one's number, reward per action, share of successes."""
        whole = len(self.reward) // EPISODES_A_ROW * EPISODES_A_ROW
        reward, length, success = (
            values[:whole].reshape(-1, EPISODES_A_ROW)
            for values in (self.reward, self.length, self.success)
        )
        return [
            (
                (row + 1) * EPISODES_A_ROW,
                float(reward[row].sum() / length[row].sum()),
                float(success[row].mean()),
            )
            for row in range(len(reward))
        ]

    def curve(self) -> Curve:
        """Episodes, and the reward per action in the 10 up to each."""
        every_ten = self.rows()
        return np.array([row[0] for row in every_ten]), np.array([row[1] for row in every_ten])

    def csv(self) -> str:
        """The learning curve as a table for other tools."""
        lines = [f"{episode},{reward:.6g},{success:g}" for episode, reward, success in self.rows()]
        return "\n".join(["episode,reward_per_action,success", *lines, ""])

    def extended(self, step: int, skill: Any, ended: EpisodeEnds) -> "History":
        """The history a chunk later, which came to `step` and to `skill`."""
        since = _since(step, skill, ended)
        return jax.tree.map(
            lambda old, new: np.concatenate([old, new]) if len(new) else old, self, since
        )

    def fits(self, skill: Any) -> bool:
        """Whether arrays from a file are a history of such a skill, each as long as the others."""

        def kinds(history: History) -> list[tuple[Any, ...]]:
            leaves = jax.tree.leaves(history)
            return [(leaf.ndim, leaf.shape[1:], leaf.dtype) for leaf in leaves]

        if kinds(self) != kinds(begun(skill)):
            return False
        episodes = {len(values) for values in (self.reward, self.length, self.success)}
        snapshots = {len(leaf) for leaf in jax.tree.leaves((self.step, self.skills))}
        return len(episodes) == len(snapshots) == 1 and bool(np.all(np.diff(self.step) > 0))


def begun(skill: Any) -> History:
    """The history of a training that has not begun: no episode, and the untaught skill."""
    kinds = bool, np.float32, np.int32, bool
    return _since(0, skill, EpisodeEnds(*(jnp.zeros(0, kind) for kind in kinds)))


def _since(step: int, skill: Any, ended: EpisodeEnds) -> History:
    at, kept = np.asarray(ended.ended), int(step % SNAPSHOT == 0)
    return History(
        *(np.asarray(values)[at] for values in (ended.reward, ended.length, ended.success)),
        step=np.array([step], np.int32)[:kept],
        # A copy, since the loop donates the state that the skill is part of.
        skills=jax.tree.map(lambda leaf: np.array(leaf)[None][:kept], skill),
    )

"""Their side: the DDPG of Stable-Baselines3 or of SBX. Started by the benchmark, in an
environment of its own."""
# pyright: reportMissingImports=false

import sys

import slices

slices.pin(int(sys.argv[1]))

from importlib import import_module  # noqa: E402
from importlib.metadata import version  # noqa: E402

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from numpy_lesson import NumpyLesson  # noqa: E402
from stable_baselines3.common.noise import OrnsteinUhlenbeckActionNoise  # noqa: E402


class Drive(gymnasium.Env):
    """`NumpyLesson` as Gymnasium wants it."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def __init__(self, numbers):
        self.lesson = NumpyLesson(numbers)

    def reset(self, *, seed=None, options=None):
        return self.lesson.reset(seed), {}

    def step(self, action):
        seen, reward, truncated = self.lesson.step(action)
        return seen, reward, False, truncated, {}


def learner(library, task, config):
    """Their DDPG with our `ddpg.Config`, as closely as its options allow."""
    size = task.action_space.shape
    return import_module(library).DDPG(
        "MlpPolicy",
        task,
        learning_rate=config["critic_rate"],  # one rate serves both networks
        buffer_size=config["memory"],
        learning_starts=config["batch"],
        batch_size=config["batch"],
        tau=config["tau"],
        gamma=config["discount"],
        train_freq=1,
        gradient_steps=1,
        action_noise=OrnsteinUhlenbeckActionNoise(
            np.zeros(size), config["sigma"] * np.ones(size), theta=config["theta"], dt=1.0
        ),
        policy_kwargs={"net_arch": {"pi": config["actor"], "qf": config["critic"]}},
        **({"device": "cpu"} if library == "stable_baselines3" else {}),
        seed=0,
    )


def play(task, steps):
    """The task alone, with actions drawn beforehand."""
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, 2)).astype(np.float32)
    watch = slices.Watch()
    task.reset()
    for action in actions:
        *_, truncated, _ = task.step(action)
        if truncated:
            task.reset()
    watch.answer(steps)


def learn(model, steps):
    watch = slices.Watch()
    model.learn(steps, reset_num_timesteps=False, log_interval=None)
    watch.answer(steps)


asked = slices.requests()
task = next(asked)
torch.set_num_threads(1)
model = learner(task["library"], Drive(task["numbers"]), task["config"])
alone = Drive(task["numbers"])
slices.answer(
    python=sys.version.split()[0],
    **{name: version(name) for name in ("stable_baselines3", "sbx-rl", "jax", "torch", "numpy")},
)
for request in asked:
    if request["what"] == "play":
        play(alone, request["steps"])
    else:
        learn(model, request["steps"])

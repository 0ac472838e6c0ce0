"""Their side: VMAS's flocking with four agents. Started by the benchmark."""
# pyright: reportMissingImports=false

import sys

import slices

slices.pin(int(sys.argv[1]))

from importlib.metadata import version  # noqa: E402

import torch  # noqa: E402
import vmas  # noqa: E402

torch.set_num_threads(1)
asked = slices.requests()
task = next(asked)
worlds = vmas.make_env("flocking", num_envs=task["worlds"], device="cpu", n_agents=4, seed=0)
worlds.reset()
actions = [worlds.get_random_action(agent) for agent in worlds.agents]
slices.answer(python=sys.version.split()[0], vmas=version("vmas"), torch=torch.__version__)
for request in asked:
    watch = slices.Watch()
    for _ in range(max(1, request["steps"] // task["worlds"])):
        worlds.step(actions)
    watch.answer(max(1, request["steps"] // task["worlds"]) * task["worlds"])

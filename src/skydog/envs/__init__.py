"""The environments that other people's learners know: Gymnasium's and PettingZoo's.

Importing this tells Gymnasium of them. `gymnasium.make("skydog/Herd-v0")` is then the whole
mission, `Collect-v0` and `Drive-v0` are the two lessons; `gymnasium.make_vec` steps a thousand
worlds in one compiled call; `herd_parallel_v0` is the mission of several dogs, each an agent.
"""

from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register

if TYPE_CHECKING:
    from skydog.envs.parallel import ParallelHerdingEnv

# A mission ends after the paper's 1000 steps; a lesson ends by itself, as its reward asks.
for _name, _most in (("Herd", 1000), ("Collect", None), ("Drive", None)):
    register(
        f"skydog/{_name}-v0",
        entry_point="skydog.envs.single:HerdingEnv",
        vector_entry_point="skydog.envs.vector:HerdingVectorEnv",
        max_episode_steps=_most,
        kwargs={"task": _name.lower()},
    )


def herd_parallel_v0(dogs: int = 3, **options: Any) -> "ParallelHerdingEnv":
    """The mission for several dogs, each an agent: a `pettingzoo.ParallelEnv`.

    `options` are those of `skydog.envs.parallel.ParallelHerdingEnv`. Raises
    `gymnasium.error.DependencyNotInstalled` where PettingZoo is missing.
    """
    try:
        from skydog.envs.parallel import ParallelHerdingEnv
    except ModuleNotFoundError as missing:
        if missing.name != "pettingzoo":
            raise
        from gymnasium.error import DependencyNotInstalled

        raise DependencyNotInstalled(
            "several agents need PettingZoo; run: pip install 'skydog[pettingzoo]'"
        ) from None
    return ParallelHerdingEnv(dogs, **options)

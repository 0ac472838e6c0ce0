"""Other people's policies as shepherds: called once a step for all missions, and not compiled."""

from collections.abc import Callable
from typing import Any, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from skydog import references
from skydog.errors import Refusal, short
from skydog.quantities import Quantity
from skydog.shepherds import finding, observing
from skydog.shepherds.options import ObservationKind
from skydog.world import herding
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar

DIVISOR = Quantity(
    "divide_by is a length from 0.001 to 100,000 m", 0.001, 1e5, "divide_by=4.0", whole=False
)
Predict = Callable[[np.ndarray], Any]
"""Actions of a batch of observations, or a tuple that begins with them."""


class Foreign:
    """A function of arrays that is called outside what is compiled. It equals itself alone."""

    def __init__(self, call: Callable[..., Any], reference: str | None, called: str):
        """`reference` is the name by which it can be found again, and `called` says what it is."""
        self.reference, self.called = reference, called
        self._call = call
        self._tried: set[tuple[tuple[int, ...], ...]] = set()

    def __call__(self, *given: Float[Array, "..."]) -> Float[Array, "dogs 2"]:
        """Of all dogs: x and y that the function gives, which is called once for a whole batch.

        Its arrays are those that are given, with the batch along a first axis of theirs.
        """
        dogs = given[0].shape[0]
        shapes = tuple(each.shape for each in given)
        if shapes not in self._tried:  # what fails is told before it is compiled
            with jax.ensure_compile_time_eval():  # a policy may compute in jax itself
                self._batch(dogs, *(np.zeros((1, *shape), np.float32) for shape in shapes))
            self._tried.add(shapes)
        axes = [each.ndim for each in given]

        def host(*arrays: Any) -> np.ndarray:
            batch = arrays[0].shape[: arrays[0].ndim - axes[0]]
            flat = (
                np.asarray(array).reshape(-1, *array.shape[array.ndim - own :])
                for array, own in zip(arrays, axes, strict=True)
            )
            return self._batch(dogs, *flat).reshape(*batch, dogs, 2)

        shape = jax.ShapeDtypeStruct((dogs, 2), jnp.float32)
        return jax.pure_callback(host, shape, *given, vmap_method="broadcast_all")

    def _batch(self, dogs: int, *given: np.ndarray) -> np.ndarray:
        shown = " and ".join(str(each.shape) for each in given)
        try:
            found = self._call(*given)
            found = found[0] if isinstance(found, tuple) else found
            found = found.detach().cpu() if hasattr(found, "detach") else found  # of torch
            actions = np.asarray(found, np.float32)
        except Refusal:
            raise
        except (Exception, SystemExit) as problem:
            said = str(problem).strip().split("\n")[0]
            raise Refusal(
                f"{self.called} failed on arrays of the shape {shown}: "
                f"{type(problem).__name__}: {said:.200}"
            ) from problem
        if actions.size != 2 * dogs * len(given[0]):
            raise Refusal(
                f"{self.called} gave actions of the shape {actions.shape} for arrays of the shape "
                f"{shown}; it is to give two numbers, x and y, for each dog"
            )
        return actions


class Policy(eqx.Module):
    """A policy on observations as a shepherd. `from_policy` makes it.

    It observes what the environments observe (`skydog.shepherds.observing`), in metres divided by
    `divide_by`; its actions are theirs too: velocities in shares of the speed limit.
    """

    predict: Foreign = eqx.field(static=True)
    observation: ObservationKind = eqx.field(static=True, default="compact")
    divide_by: Scalar = 1.0  # metres

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        subgoal, _ = herding.gate(world, state.sheep, state.dogs)
        seen = observing.observe(world, state, subgoal, self.observation)
        most = observing.bound(world)
        return observing.velocity(world, self.predict(jnp.clip(seen, -most, most) / self.divide_by))


def from_policy(
    predict: Predict | str, observation: ObservationKind | None = None, divide_by: float = 1.0
) -> Policy:
    """A shepherd that asks a policy: NumPy's, torch's, `model.predict` of Stable-Baselines3, ...

    `predict` is given the observations of all dogs in all missions that are flown together, float32
    of (dogs, numbers), and returns as many actions: arrays of (dogs, 2), velocities in shares of
    the speed limit from -1 to 1. It is called once a step, and is not compiled. It may remember
    nothing from call to call: missions are flown together, and a call may be repeated.

    `observation` is `compact` or `full`, as of `skydog/Herd-v0`; if not given, what a model's
    observation space says, else `compact`. Metres are divided by `divide_by` before the policy
    sees them: 4.0 if it learnt in an environment whose observations were divided by 4 m.

    `predict` may also be a name: FILE.py:NAME, package.module:NAME, or ppo:FILE.zip of
    Stable-Baselines3 (a2c, ddpg, sac and td3 too). Such a shepherd can be saved
    (`skydog.shepherds.store.save`), and so can a function of a module that can be imported. What is
    named is run, and a zip holds pickles, which are too: load only what you trust.

    Raises `Refusal` for what is no policy or cannot be loaded.
    """
    divide_by = DIVISOR.checked(divide_by)
    called = short(predict)
    ask: Any = predict
    own: ObservationKind = "compact"
    if isinstance(predict, str):
        reference = called = predict
        if finding.kind(predict) == "zip":
            from skydog.shepherds import zips

            ask, own = zips.read(predict)
        else:
            ask = references.made(references.load(predict), predict, None)
    elif not callable(predict):
        raise Refusal(f"a policy is a function of observations, got {called}; try model.predict")
    else:
        reference = references.name_of(predict)
        called = getattr(predict, "__qualname__", called)
    observation = own if observation is None else observation
    if observation not in get_args(ObservationKind):
        kinds = ", ".join(get_args(ObservationKind))
        raise Refusal(f"no observation is called {short(observation)}; choose from {kinds}")

    def each_dog(seen: np.ndarray) -> Any:
        return ask(seen.reshape(-1, seen.shape[-1]))

    return Policy(Foreign(each_dog, reference, called), observation, divide_by)

"""The settings of jax that our figures stand on, whatever other programs have set.

jax has one set of settings for the whole process: a notebook that works in float64, draws by
another generator or debugs its own code would change ours too. What runs under `ours` does not see
it. The pure functions of the world follow their caller, who may be tracing them.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
from jax.core import Tracer

from skydog.errors import Refusal

Tree = TypeVar("Tree")
Given = ParamSpec("Given")
Result = TypeVar("Result")

SETTINGS: dict[str, tuple[Callable[[Any], AbstractContextManager[Any]], Any]] = {
    "jax_enable_x64": (jax.enable_x64, False),
    "jax_numpy_dtype_promotion": (jax.numpy_dtype_promotion, "standard"),
    "jax_numpy_rank_promotion": (jax.numpy_rank_promotion, "allow"),
    "jax_default_prng_impl": (jax.default_prng_impl, "threefry2x32"),
    "jax_threefry_partitionable": (jax.threefry_partitionable, True),
    "jax_enable_custom_prng": (jax.enable_custom_prng, False),
    "jax_legacy_prng_key": (jax.legacy_prng_key, "allow"),
    "jax_default_matmul_precision": (jax.default_matmul_precision, None),
    "jax_disable_jit": (jax.disable_jit, False),
    "jax_debug_nans": (jax.debug_nans, False),
    "jax_debug_infs": (jax.debug_infs, False),
    "jax_debug_key_reuse": (jax.debug_key_reuse, False),
    "jax_check_tracer_leaks": (jax.check_tracer_leaks, False),
    "jax_transfer_guard": (jax.transfer_guard, "allow"),
    "jax_transfer_guard_host_to_device": (jax.transfer_guard_host_to_device, "allow"),
    "jax_transfer_guard_device_to_host": (jax.transfer_guard_device_to_host, "allow"),
    "jax_transfer_guard_device_to_device": (jax.transfer_guard_device_to_device, "allow"),
}
"""By the name in `jax.config`: the context that sets it, and what it has to be."""

FIXED = {"jax_random_seed_offset": 0, "jax_no_tracing": False, "jax_no_execution": False}
"""Settings that no context sets, and what they have to be."""


@contextmanager
def ours() -> Iterator[None]:
    """Run a block, or a function that this decorates, under our settings.

    Raises `Refusal` for a setting that cannot be had otherwise.
    """
    for name, value in FIXED.items():
        if getattr(jax.config, name) != value:
            raise Refusal(
                f"jax's setting {name} is {getattr(jax.config, name)!r}, and no figure would be "
                f"right; try jax.config.update({name!r}, {value!r})"
            )
    with ExitStack() as settings:
        for name, (entered, value) in SETTINGS.items():
            if getattr(jax.config, name) not in (None, value):
                settings.enter_context(entered(value))
        yield


def untraced(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """A pure function that runs under `ours` when it is called, and as its caller when traced."""

    @wraps(function)
    def call(*given: Given.args, **named: Given.kwargs) -> Result:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((given, named))):
            with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
                return function(*given, **named)
        given, named = jax.tree.map(_typed_key, (given, named))  # as the caller draws
        with ours():
            given, named = single((given, named))
            return function(*given, **named)

    return call


def _typed_key(leaf: Any) -> Any:
    """A key that is plain numbers, as a key of the generator that is set now."""
    plain = isinstance(leaf, jax.Array) and leaf.dtype == jnp.uint32
    return jax.random.wrap_key_data(leaf) if plain else leaf


def single(tree: Tree) -> Tree:
    """A tree whose arrays are of 32 bits, as they are under our settings; typed keys stay."""

    def narrow(leaf: Any) -> Any:
        kind = str(getattr(leaf, "dtype", ""))
        if kind in ("float64", "int64") and not isinstance(leaf, Tracer):
            return jnp.asarray(leaf, kind.replace("64", "32"))
        return leaf

    return jax.tree.map(narrow, tree)


def fits(size: int, what: str) -> None:
    """Raise `Refusal` for what takes more bytes than this machine has: it would be killed."""
    has = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if size > has:
        raise Refusal(
            f"{what} takes {size / 2**30:,.0f} GiB, this machine has {has / 2**30:,.0f}; "
            "try fewer --cases, --sheep or --steps, or a larger --every"
        )

import ctypes
import gc
import os
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import settings

# More than half of the time goes to compiling: what one process has compiled serves the others, and
# the next run. Told before jax is imported.
COMPILED = Path(__file__).parents[1] / ".pytest_cache" / "compiled"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(COMPILED))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

# No deadline: the first example of each shape waits for a compilation.
settings.register_profile("skydog", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("skydog")


# A process of Linux may hold 65,530 pieces of memory, each compiled program takes some ten, and
# whoever loads one more crashes.
MANY = 15_000


@pytest.fixture(scope="module", autouse=True)
def forgotten():
    """Compiled programs are forgotten once there are many, and their memory is given back."""
    yield
    pieces = Path("/proc/self/maps")
    if pieces.exists() and pieces.read_bytes().count(b"\n") > MANY:
        import jax

        jax.clear_caches()
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)


@pytest.fixture(scope="module")
def unchecked():
    """Shapes are checked in one mission (`test_missions.py`); in all they would take minutes."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def checked():
    """Shapes are checked, as in every other room."""
    jaxtyping.config.update("jaxtyping_disable", False)
    yield
    jaxtyping.config.update("jaxtyping_disable", True)

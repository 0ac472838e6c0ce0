import jaxtyping
import pytest
from hypothesis import settings

# No deadline: the first example of each shape waits for a compilation.
settings.register_profile("skydog", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("skydog")


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

import jaxtyping
import pytest


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

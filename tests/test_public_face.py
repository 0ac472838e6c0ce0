import subprocess
import sys
from importlib import import_module

import pytest

import skydog


@pytest.mark.parametrize("name", skydog.__all__)
def test_every_public_name_is_the_one_that_lives_in_its_room(name):
    found = getattr(skydog, name)
    home = skydog._HOMES.get(name)
    assert found == (skydog.__version__ if home is None else getattr(import_module(home), name))
    assert name in dir(skydog)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="wolf"):
        _ = skydog.wolf


def test_the_example_in_the_docstring_runs():
    code = (skydog.__doc__ or "").split("\n\n", 1)[1]
    scope = {}
    exec(code, scope)
    trace = scope["trace"]
    assert bool(trace.accomplished[-1])
    assert trace.sheep.shape == (1001, 3, 2)


def test_importing_skydog_does_not_wait_for_jax():
    code = "import sys, skydog; print('jax' in sys.modules, 'numpy' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.stdout.split() == ["False", "False"]

"""The margins that the docs quote, of `benchmarks/margins.py`."""

import numpy as np
import pytest
from loops import MARGINS

from skydog.flight import profiles

UAVS = profiles.ship("uav")


@pytest.fixture(scope="module")
def found():
    return {name: MARGINS["margins"](name) for name in UAVS}


@pytest.mark.parametrize("name", UAVS)
def test_every_drone_bears_twice_its_gain_and_a_link_a_fifth_of_a_second_later(found, name):
    assert found[name].gain > 20.0 * np.log10(2.0)
    assert min(found[name].delay, found[name].altitude_delay) > 0.2


@pytest.mark.parametrize("name", UAVS)
def test_the_dc_gain_that_is_told_is_that_of_the_controller(found, name):
    loop = profiles.uav(name).position
    assert found[name].dc_gain == pytest.approx(1.0 / loop.phi - loop.delta)


@pytest.mark.parametrize(("gain", "delay"), [(1.0, 0.1), (2.0, 0.25)])
def test_the_margins_of_a_delayed_integrator_are_those_of_the_textbook(gain, delay):
    s = 1j * MARGINS["GRID"]
    bears = MARGINS["_margins"](gain / s * np.exp(-s * delay))
    expected = np.pi / 2 / gain - delay, 20.0 * np.log10(np.pi / 2 / (gain * delay))
    assert bears == pytest.approx(expected, rel=1e-3)


def test_the_table_has_a_row_for_each_drone_that_ships(capsys, tmp_path, found):
    MARGINS["main"](tmp_path / "margins.md")
    told = capsys.readouterr().out
    assert (tmp_path / "margins.md").read_text() == told
    head, _, *rows = told.splitlines()
    assert head.count("|") == 7
    assert [row.split("|")[1].strip() for row in rows] == list(UAVS)
    for row, name in zip(rows, UAVS, strict=True):
        ni, delay = row.split("|")[2].strip(), row.split("|")[4]
        assert ni == "all" or float(ni) == pytest.approx(found[name].ni_up_to, abs=0.06)
        assert float(delay) == pytest.approx(found[name].delay, abs=0.006)

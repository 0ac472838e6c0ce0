"""`skydog lab`: what it checks and refuses, and that signals do not kill what flies."""

import json
import os
import signal
from pathlib import Path

import pytest

from skydog.commands import lab as command
from skydog.flight.supervisor import Order
from skydog.lab.orders import Orders

SITES = Path(__file__).parents[2] / "examples" / "sites"
SITE = SITES / "ardrone_autonomy.toml"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "lab flies one site file, got 0 names"),
        (("a.toml", "b.toml"), "lab flies one site file, got 2 names"),
        (("nowhere.toml",), "cannot read nowhere.toml: No such file"),
        (("check", "nowhere.toml"), "cannot read nowhere.toml: No such file"),
        (("--faults", "silent-1"), "try --emulate too"),
        (("--emulate", str(SITE)), "makes its own site"),
        (("--emulate", "--faults", "silnet-1"), "did you mean silent-"),
        (("faults", "silnet-1"), "did you mean silent-"),
        (("--emulate", "--speed", "2"), "speed is a share from 0.001 to 1, got 2"),
        (
            ("--emulate", "--speed", "nan"),
            "speed is a share from 0.001 to 1, got 'nan'",
        ),
        (("--emulate", "--steps", "0"), "a flight has 1 to 100,000 steps, got 0"),
        (("--emulate", "--disturb", "storm"), "no disturbances are called 'storm'"),
        (("--emulate", "--sheepdog", "rex"), "rex"),
        (("--emulate", "--wait", "-1"), "the distance to wait for is from 0.001"),
        (("recover", "nowhere"), "nowhere"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_a_line_and_nothing_is_written(
    refused, arguments, words
):
    assert words in refused("lab", *arguments)


def test_a_site_file_is_checked_line_by_line(skydog):
    code, out, _ = skydog("lab", "check", str(SITE))
    assert code == 0
    assert "write " not in out.split("\n", 1)[0]
    code, out, _ = skydog("lab", "check", str(SITE), "--json")
    assert code == 0
    assert all(line["ok"] for line in json.loads(out))


def test_a_site_whose_robots_do_not_stop_is_told_what_to_write_and_does_not_fly(skydog, refused):
    text = SITE.read_text().replace("guard = true", "guard = false")
    Path("mine.toml").write_text(text)
    code, out, _ = skydog("lab", "check", "mine.toml")
    assert code == 2
    assert "guard.py --in" in out
    assert "skydog lab check mine.toml" in refused("lab", "mine.toml")


def test_ctrl_c_is_a_stop_and_sigterm_lands(monkeypatch):
    orders = Orders()
    before = signal.getsignal(signal.SIGINT)
    with command._operator(orders):
        os.kill(os.getpid(), signal.SIGINT)
        assert orders.take() == (Order.STOP, "Ctrl-C")
        os.kill(os.getpid(), signal.SIGTERM)
        assert orders.take() == (Order.LAND, "a signal to end")
    assert orders.quits
    assert signal.getsignal(signal.SIGINT) == before

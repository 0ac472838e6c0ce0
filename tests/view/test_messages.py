import json

import pytest

from skydog.errors import Refusal
from skydog.view.messages import parse
from skydog.view.session import ALONG, HOVER, TOWARD
from skydog.world.presets import PRESETS

WORLDS = list(PRESETS)

RUBBISH = (
    "",
    "sheep",
    "[]",
    "3",
    "null",
    '{"sheep": NaN}',
    '{"noise": 1e309}',
    '{"noise": -Infinity}',
    '{"noise": true}',
    '{"noise": "0.1"}',
    '{"sheep": 2.5}',
    '{"sheep": 0}',
    '{"sheep": 201}',
    '{"sheep": ' + "9" * 4000 + "}",
    '{"dogs": 9}',
    '{"dogs": true}',
    '{"arena": 0}',
    '{"preset": "wolf"}',
    '{"preset": ["paper"]}',
    '{"policy": "/etc/passwd"}',
    '{"policy": "../zoo/h-ddpg-4x4"}',
    '{"mode": "cheat"}',
    '{"speed": 1000}',
    '{"paused": 1}',
    '{"step": false}',
    '{"case": -1}',
    '{"seen": "all"}',
    '{"hold": {"who": "dog"}}',
    '{"hold": {"who": "wolf", "number": 0, "at": [1, 1]}}',
    '{"hold": {"who": {}, "number": 0, "at": [1, 1]}}',
    '{"hold": {"who": "dog", "number": 0, "at": [1]}}',
    '{"hold": {"who": "dog", "number": 0, "at": [1, NaN]}}',
    '{"fly": {"toward": [1e9, 0]}}',
    '{"fly": {"along": [2, 0]}}',
    '{"fly": {"along": [0, 0], "toward": [0, 0]}}',
    '{"fly": [0, 0]}',
    '{"wolf": 1}',
    '{"\\ud800": 1}',
    "[" * 4000,
    " " * 5000,
    b"\x00\xff",
    b'{"sheep": 5}',
)


@pytest.mark.parametrize("message", RUBBISH)
def test_rubbish_is_refused_in_a_line(message):
    with pytest.raises(Refusal) as refused:
        parse(message, ["strombom"], WORLDS)
    assert len(str(refused.value)) < 250
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ({"sheep": 5, "noise": 1, "paused": True}, {"sheep": 5, "noise": 1.0, "paused": True}),
        ({"policy": "strombom", "seen": 7}, {"policy": "strombom", "seen": 7}),
        ({"hold": {"who": "dog", "number": 0, "at": [1, 2]}}, {"hold": ("dog", 0, (1.0, 2.0))}),
        ({"hold": None, "fly": None}, {"hold": None, "fly": (HOVER, (0.0, 0.0))}),
        ({"fly": {"along": [0, -1]}}, {"fly": (ALONG, (0.0, -1.0))}),
        ({"fly": {"toward": [3.5, 0]}}, {"fly": (TOWARD, (3.5, 0.0))}),
    ],
)
def test_a_message_is_what_it_says(said, meant):
    assert parse(json.dumps(said), ["strombom"], WORLDS) == meant

import asyncio
import dataclasses
import http.client
import json
import math
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import Future
from contextlib import contextmanager
from urllib.parse import urlsplit

import jax
import numpy as np
import pytest
from browser import chromium, opened, pixels, until
from hypothesis import given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import metrics
from skydog.view import live
from skydog.view.colours import ROLES
from skydog.world import mission, params

client = pytest.importorskip("websockets.sync.client")
exceptions = pytest.importorskip("websockets.exceptions")

SHEPHERDS = {"strombom": Strombom(), "h-ddpg-4x4": store.load("h-ddpg-4x4")}
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
    '{"arena": 1.5}',  # shorter than the goal
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
    '{"hold": {"who": "dog", "number": 5, "at": [1, 1]}}',
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


def begun(**settings):
    opening = live.opening(SHEPHERDS, settings.pop("policy", "strombom"))
    game = live.new(dataclasses.replace(opening, **settings))
    return live.turn(game, SHEPHERDS, 0)


def places(game, flight=0):
    state = game.flights[flight].state
    return np.asarray(state.sheep), np.asarray(state.dogs)


# The game, without any server.


@pytest.mark.parametrize("policy", SHEPHERDS)
def test_turns_fly_a_mission_as_rollout_does(policy):
    game = begun(policy=policy)
    state = game.flights[0].state
    trace = mission.rollout(params.preset("paper"), SHEPHERDS[policy], state, 45)
    for steps in (1, 3, 0, 41):
        game = live.turn(game, SHEPHERDS, steps)
    sheep, dogs = places(game)
    np.testing.assert_allclose(sheep, trace.sheep[45], atol=1e-5)
    np.testing.assert_allclose(dogs, trace.dogs[45], atol=1e-5)
    assert int(game.flights[0].step) == 45
    assert float(game.flights[0].flown) == pytest.approx(float(metrics.distance(trace)), abs=1e-4)


def test_noise_is_that_of_a_rollout_with_the_case_as_its_key():
    game = live.told(begun(), {"preset": "strombom2014", "perception": 1.0, "case": 5})
    game = live.turn(game, SHEPHERDS, 0)
    trace = mission.rollout(
        game.world, SHEPHERDS["strombom"], game.flights[0].state, 20, jax.random.key(5)
    )
    game = live.turn(game, SHEPHERDS, 20)
    np.testing.assert_allclose(places(game)[0], trace.sheep[20], rtol=1e-5)


def test_a_mission_ends_where_it_is_accomplished_and_goes_on_when_the_goal_moves_away():
    game = live.turn(begun(), SHEPHERDS, 1000)
    steps = int(game.flights[0].step)
    assert bool(game.sights[0].done)
    assert game.rests
    assert steps < 1000
    assert int(live.turn(game, SHEPHERDS, 5).flights[0].step) == steps
    game = live.turn(live.told(game, {"hold": ("goal", 0, (4.0, 4.0))}), SHEPHERDS, 5)
    assert int(game.flights[0].step) == steps + 5


def test_a_reset_is_the_same_case_again_and_another_case_is_another():
    first = begun()
    flown = live.turn(first, SHEPHERDS, 9)
    again = live.turn(live.told(flown, {"reset": True}), SHEPHERDS, 0)
    other = live.turn(live.told(flown, {"case": 2}), SHEPHERDS, 0)
    np.testing.assert_array_equal(places(first)[0], places(again)[0])
    assert (places(first)[0] != places(other)[0]).any()
    assert first.start < again.start


@given(
    who=st.sampled_from(["dog", "sheep", "goal"]),
    x=st.floats(-1e6, 1e6, allow_nan=False),
    y=st.floats(-1e6, 1e6, allow_nan=False),
)
def test_who_is_dragged_stays_where_it_may_be(who, x, y):
    order = live.parsed(
        json.dumps({"hold": {"who": who, "number": 0, "at": [x, y]}}), list(SHEPHERDS)
    )
    game = live.turn(live.told(GAME, order), SHEPHERDS, 2)
    shown = live.shown(game)
    arena = game.world.arena
    beyond = float(game.world.dog.airspace) if who == "dog" else 0.0
    there = np.clip([x, y], -beyond, float(arena.size) + beyond)
    found = {
        "dog": shown["flights"][0]["dogs"][0],
        "sheep": shown["flights"][0]["sheep"][0],
        "goal": shown["world"]["goal"],
    }[who]
    np.testing.assert_allclose(found, there, atol=1e-3)


def test_who_is_dragged_is_where_the_hand_is_at_once_and_flies_no_distance():
    game = live.told(begun(), {"paused": True})
    game = live.told(game, {"hold": ("dog", 0, (3.0, 3.5))})
    np.testing.assert_allclose(places(game)[1], [[3.0, 3.5]])
    game = live.turn(live.told(game, {"hold": None}), SHEPHERDS, 0)
    np.testing.assert_allclose(places(game)[1], [[3.0, 3.5]])
    assert float(game.flights[0].flown) == 0.0


def test_a_player_flies_no_faster_than_a_dog_and_stops_where_it_is_sent():
    game = live.told(begun(), {"mode": "fly", "fly": (live.ALONG, (1.0, -0.5))})
    _, before = places(game)
    _, after = places(live.turn(game, SHEPHERDS, 1))
    np.testing.assert_allclose(after - before, [[0.1, -0.05]], atol=1e-6)
    game = live.turn(live.told(game, {"fly": (live.TOWARD, (1.23, 2.34))}), SHEPHERDS, 200)
    np.testing.assert_allclose(places(game)[1], [[1.23, 2.34]], atol=1e-5)


def test_the_players_dog_hovers_until_told_and_the_other_dogs_help():
    game = live.turn(live.told(begun(), {"dogs": 3, "mode": "fly"}), SHEPHERDS, 0)
    moved = np.abs(places(live.turn(game, SHEPHERDS, 3))[1] - places(game)[1]).max(axis=1)
    assert moved[0] == 0.0
    assert (moved[1:] > 0.0).all()


def test_a_race_waits_for_the_players_first_move_and_both_fly_the_same_case():
    game = live.turn(live.told(begun(), {"mode": "race"}), SHEPHERDS, 5)
    assert game.waits
    assert [int(flight.step) for flight in game.flights] == [0, 0]
    np.testing.assert_array_equal(places(game, 0)[0], places(game, 1)[0])
    watched = live.turn(begun(), SHEPHERDS, 30)
    game = live.turn(live.told(game, {"fly": (live.ALONG, (0.0, 1.0))}), SHEPHERDS, 30)
    np.testing.assert_allclose(places(game, 1)[0], places(watched)[0], atol=1e-6)
    assert (places(game, 0)[1] != places(game, 1)[1]).any()


def test_a_slider_compiles_nothing_anew():
    traced = []

    def still(world, state):
        traced.append(state)
        return 0.0 * state.dogs

    shepherds = {"still": still}
    game = live.turn(live.new(live.opening(shepherds, "still")), shepherds, 1)
    once = len(traced)
    for order in (
        {"arena": 9.0, "noise": 0.2},
        {"perception": 0.1, "actuation": 0.3, "speed": 16.0},
        {"hold": ("goal", 0, (2.0, 1.0))},
        {"hold": ("dog", 0, (2.0, 1.0))},
        {"mode": "race", "case": 77},
        {"fly": (live.TOWARD, (2.0, 1.0))},
    ):
        game = live.turn(live.told(game, order), shepherds, 3)
    assert len(traced) == once


def test_an_arena_stays_as_it_was_chosen_while_the_flock_fits():
    game = live.told(live.told(begun(), {"preset": "strombom2014"}), {"arena": 40.0})
    for order in ({"noise": 0.1}, {"sheep": 5}, {"case": 3}):
        game = live.told(game, order)
        assert float(game.world.arena.size) == 40.0


def test_a_flock_that_outgrows_its_arena_gets_a_wider_one():
    game = live.told(live.told(begun(), {"arena": 6.0}), {"sheep": 60})
    assert float(game.world.arena.size) > 2 * float(game.world.arena.goal_radius) - 1e-3
    game = live.told(game, {"sheep": 3})
    assert float(game.world.arena.size) == 4.0


def test_every_preset_has_its_own_noise_and_a_speed_to_watch():
    for preset in params.PRESETS:
        game = live.told(begun(), {"preset": preset})
        assert game.settings.noise == params.preset(preset).flock.noise
        steps = game.settings.speed / params.preset(preset).arena.dt
        assert 5.0 <= steps <= 20.0


@pytest.mark.parametrize(
    ("wrong", "remedy"),
    [
        ({"chosen": "wolf"}, "choose from strombom"),
        ({"sheep": 0}, "try --sheep"),
        ({"sheep": 201}, "try --sheep"),
        ({"dogs": 0}, "try --dogs"),
        ({"dogs": 9}, "try --dogs"),
        ({"preset": "wolf"}, "choose from paper"),
        ({"arena": 1.0}, "try --arena"),
        ({"arena": 4.0, "sheep": 60}, "try --arena"),
        ({"arena": math.inf}, "try --arena"),
        ({"arena": math.nan}, "try --arena"),
        ({"arena": 1e6}, "try --arena"),
        ({"arena": 0.0}, "try --arena"),
    ],
)
def test_an_option_out_of_bounds_is_refused_with_the_remedy(wrong, remedy):
    with pytest.raises(Refusal, match=remedy):
        live.opening(SHEPHERDS, **{"chosen": "strombom", **wrong})


def test_the_roster_has_the_chosen_sheepdog_first_and_all_that_ship():
    path = str(store.ZOO / "dhrl-6x6.safetensors")
    assert list(live.roster(path))[:2] == [path, "strombom"]
    assert {"strombom", "strombom-arrive", *store.ships()} < set(live.roster(path))
    with pytest.raises(Refusal, match="no sheepdog is called wolf"):
        live.roster("wolf")


@pytest.mark.parametrize("message", [m for m in RUBBISH if m != '{"arena": 1.5}'])
def test_rubbish_is_refused_in_a_line(message):
    with pytest.raises(Refusal) as refused:
        live.told(GAME, live.parsed(message, list(SHEPHERDS)))
    assert len(str(refused.value)) < 250
    assert "\n" not in str(refused.value)


# The server, without a browser.


@contextmanager
def serving(shepherds=SHEPHERDS, chosen="h-ddpg-4x4", port=0):
    """A server in a thread of its own, as long as the context lasts."""
    found = Future()

    async def run():
        over = asyncio.Event()
        async with live.listening(shepherds, live.opening(shepherds, chosen), port=port) as url:
            found.set_result((url, asyncio.get_running_loop(), over))
            await over.wait()

    server = threading.Thread(target=lambda: asyncio.run(run()))
    server.start()
    url, loop, over = found.result(60)
    try:
        yield url
    finally:
        loop.call_soon_threadsafe(over.set)
        server.join(60)
        assert not server.is_alive()


@pytest.fixture(scope="module")
def url():
    with serving() as url:
        yield url


class Player:
    """A page that draws nothing: it says what it has seen, and nothing else by itself."""

    def __init__(self, url, **options):
        self.connecting = client.connect(url.replace("http", "ws") + "live", **options)
        self.world = {}

    def __enter__(self):
        self.wire = self.connecting.__enter__()
        assert "hello" in self.hear()
        return self

    def __exit__(self, *problem):
        self.connecting.__exit__(*problem)

    def say(self, **order):
        self.wire.send(json.dumps(order))

    def hear(self):
        return json.loads(self.wire.recv(timeout=120))

    def frame(self):
        """The next frame, with all that was told before."""
        while True:
            told = self.hear()
            if "frame" in told:
                self.say(seen=told["frame"])
                self.world |= told
                return self.world

    def error(self):
        """The next error, however many frames come before."""
        while True:
            told = self.hear()
            if "error" in told:
                return told["error"]
            self.say(seen=told["frame"])

    def plays_on(self):
        before = self.frame()["flights"][0]["step"]
        self.say(reset=True)
        while self.frame()["flights"][0]["step"] > before:
            pass
        first = self.frame()["flights"][0]["step"]
        while self.frame()["flights"][0]["step"] <= first:
            pass
        return True


def test_rubbish_is_answered_and_the_game_goes_on(url):
    with Player(url) as player:
        player.frame()
        for message in RUBBISH:
            player.wire.send(message)
            assert player.error()
        assert player.plays_on()


def test_a_message_too_large_ends_its_own_connection_only(url):
    with Player(url) as good, Player(url) as bad:
        bad.wire.send(" " * 100_000)
        with pytest.raises(exceptions.ConnectionClosed):
            bad.error()
        assert good.plays_on()


def test_a_page_that_goes_away_in_the_middle_takes_nobody_along(url):
    with Player(url) as stays:
        with Player(url) as leaves:
            leaves.frame()
            leaves.wire.socket.shutdown(socket.SHUT_RDWR)
        with Player(url) as comes:
            assert comes.plays_on()
        assert stays.plays_on()


def test_a_flood_of_orders_leaves_the_others_playing(url):
    with Player(url) as flooding, Player(url) as good:
        for _ in range(2000):
            flooding.wire.send('{"reset": true, "sheep": 3}')
        assert good.plays_on()
        flooding.wire.socket.shutdown(socket.SHUT_RDWR)


def test_a_page_hears_of_its_game_again_even_after_a_flood_that_it_did_not_look_at(url):
    with Player(url) as player:
        told = [player.hear() for _ in range(live.AHEAD)]
        for _ in range(2 * live.PENDING):
            player.say(reset=True)
        assert "wait already" in player.hear()["error"]
        player.say(seen=told[-1]["frame"])
        assert player.plays_on()


def test_the_moves_of_a_hand_in_a_row_are_the_latest_and_none_is_let_go_unheard():
    inbox = live.Inbox()
    for at in range(200):
        inbox.put({"hold": ("dog", 0, (float(at), 0.0))})
    inbox.put({"hold": None})
    inbox.put({"hold": ("dog", 0, (1.0, 1.0))})
    inbox.put({"fly": (live.TOWARD, (1.0, 1.0))})
    inbox.put({})
    held = [order.get("hold") for order in inbox.take()]
    assert held == [("dog", 0, (199.0, 0.0)), None, ("dog", 0, (1.0, 1.0)), None]


def test_a_page_that_draws_nothing_is_sent_no_more_than_it_can_be_behind(url):
    with Player(url) as player:
        player.say(speed=64)
        told = [player.hear() for _ in range(live.AHEAD)]
        assert all("frame" in message for message in told)
        with pytest.raises(TimeoutError):
            player.wire.recv(timeout=0.5)
        player.say(seen=told[-1]["frame"])
        assert "frame" in player.hear()


def test_pages_choose_for_themselves_alone(url):
    with Player(url) as one, Player(url) as two:
        one.say(sheep=5)
        while one.frame()["settings"]["sheep"] != 5:
            pass
        assert two.frame()["settings"]["sheep"] == 3
        assert len(one.frame()["flights"][0]["sheep"]) == 5


def test_a_shepherd_that_fails_is_told_of_and_another_flies_on(caplog):
    def lost(world, state):
        raise RuntimeError("which way?")

    with serving({"strombom": Strombom(), "lost": lost}, "strombom") as url, Player(url) as player:
        player.frame()
        player.say(policy="lost")
        assert player.error() == "lost failed: 'which way?'"
        while not player.frame()["settings"]["paused"]:
            pass
        assert player.world["settings"]["policy"] == "strombom"
        player.say(paused=False)
        assert player.plays_on()
    assert "lost failed" in caplog.text


def asked(url, path="/", method="GET", **headers):
    place = urlsplit(url)
    assert place.hostname
    wire = http.client.HTTPConnection(place.hostname, place.port, timeout=60)
    try:
        wire.request(method, path, headers=headers)
        response = wire.getresponse()
        return response.status, dict(response.headers), response.read().decode()
    finally:
        wire.close()


def test_the_page_holds_all_it_needs_and_may_run_nothing_else(url):
    status, headers, page = asked(url)
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "script-src 'nonce-" in headers["Content-Security-Policy"]
    assert "{{" not in page
    for role, colour in ROLES.items():
        assert f"--{role}: {colour};" in page
    # New for each, or it would protect nothing.
    assert asked(url)[1]["Content-Security-Policy"] != headers["Content-Security-Policy"]


def test_other_addresses_are_not_found(url):
    assert asked(url, "/etc/passwd")[0] == 404
    assert asked(url, "/../live.py")[0] == 404


def test_a_foreign_name_and_a_foreign_page_stay_outside(url):
    port = urlsplit(url).port
    assert asked(url, Host=f"localhost:{port}")[0] == 200
    for host in (f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", ""):
        assert asked(url, Host=host)[0] == 403
    with Player(url, origin=f"http://localhost:{port}") as player:
        assert player.frame()
    for origin in ("http://evil.example", f"https://127.0.0.1:{port}", "null", url):
        with pytest.raises(exceptions.InvalidStatus, match="403"), Player(url, origin=origin):
            pass


def test_what_is_no_http_is_turned_away_and_the_server_stays(url):
    place = urlsplit(url)
    for rubbish in (b"\x00\xff" * 50, b"POST / HTTP/1.1\r\n\r\n", b"GET /\r\n\r\n", b""):
        with socket.create_connection((place.hostname, place.port), timeout=60) as wire:
            wire.sendall(rubbish)
            wire.shutdown(socket.SHUT_WR)
            while wire.recv(4096):
                pass
    assert asked(url)[0] == 200


def test_a_port_that_is_taken_is_refused_with_the_next(url):
    port = urlsplit(url).port
    with pytest.raises(Refusal, match=f"port {port} is taken; try --port {port + 1}"):
        served(port=port)


@pytest.mark.parametrize(
    ("where", "remedy"),
    [
        ({"port": 70_000}, "try --port 8020"),
        ({"port": -1}, "try --port 8020"),
        ({"host": "0.0.0.0"}, "try --host 127.0.0.1"),
        ({"host": ""}, "try --host 127.0.0.1"),
        ({"host": "no.such.host.invalid"}, "try --host 127.0.0.1"),
        ({"host": "203.0.113.7"}, "try --host 127.0.0.1"),
    ],
)
def test_where_nobody_can_listen_is_refused_with_the_remedy(where, remedy):
    with pytest.raises(Refusal, match=remedy):
        served(**{"port": 0, **where})


def served(**where):
    """`serve`, in a thread, since a browser's driver has a loop in this one."""
    raised = []

    def run():
        try:
            live.serve(SHEPHERDS, "strombom", **where)
        except Refusal as refusal:
            raised.append(refusal)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(60)
    raise raised[0]


def test_without_websockets_the_line_to_install_it_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    with pytest.raises(Refusal, match=r"pip install 'skydog\[watch\]'"):
        served(port=0)


def test_ctrl_c_ends_the_server_in_silence():
    code = (
        "from skydog.shepherds.strombom import Strombom\n"
        "from skydog.view import live\n"
        "live.serve({'strombom': Strombom()}, 'strombom', port=0,\n"
        "           ready=lambda url: print(url, flush=True))\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout
        assert server.stdout.readline().startswith("http://127.0.0.1:")
        server.send_signal(signal.SIGINT)
        _, errors = server.communicate(timeout=60)
    assert (server.returncode, errors) == (0, "")


# The page, in a browser.


@pytest.fixture(scope="module")
def browser(url):
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser, url):
    with opened(browser, url) as page:
        until(page, "window.skydog?.flights.length > 0")
        yield page


def step(page):
    return page.evaluate("skydog.flights[0].step")


def halted(page):
    """The page, paused at the start of its case, and whoever glided at rest."""
    page.keyboard.press("Space")
    until(page, "skydog.settings.paused")
    page.keyboard.press("r")
    until(page, "skydog.flights[0].step === 0")
    page.wait_for_timeout(400)


def drag(page, at, to):
    seen, before = page.evaluate("skydog.screen([0, 0])"), None
    while seen != before:  # the picture is at rest
        page.wait_for_timeout(200)
        seen, before = page.evaluate("skydog.screen([0, 0])"), seen
    x, y = page.evaluate("p => skydog.screen(p)", at)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(*page.evaluate("p => skydog.screen(p)", to), steps=5)


def test_the_canvas_moves(page):
    one = pixels(page, "canvas.arena")
    page.wait_for_timeout(500)
    two = pixels(page, "canvas.arena")
    assert len(np.unique(one.reshape(-1, 3), axis=0)) > 20
    assert (one != two).any()


def test_what_is_told_beside_the_arena_follows_the_mission(page):
    until(page, "skydog.flights[0].done")
    steps = step(page)
    until(page, f"document.querySelector('.step').textContent === '{steps}'")
    assert page.inner_text(".now > .doing") == "accomplished"
    assert page.inner_text(".home") == "3 of 3"
    assert page.inner_text(".news").startswith(f"home in {steps} steps")


def test_the_slider_of_sheep_changes_the_world(page):
    page.locator("input.sheep").focus()
    for _ in range(2):
        page.keyboard.press("ArrowRight")
    until(page, "skydog.flights[0].sheep.length === 5")
    assert page.inner_text("label:has(.sheep) output") == "5"
    assert page.evaluate("skydog.world.size") == 6.0


def test_the_chosen_sheepdog_preset_and_noise_are_flown(page):
    page.select_option(".policy", "strombom")
    until(page, "skydog.settings.policy === 'strombom'")
    page.select_option(".preset", "strombom2014")
    until(page, "skydog.world.size === 150 && skydog.settings.noise === 0.3")
    page.locator("input.noise").focus()
    page.keyboard.press("Home")
    until(page, "skydog.settings.noise === 0")
    page.fill("input.size", "90")
    page.keyboard.press("Enter")
    until(page, "skydog.world.size === 90")


def test_an_arena_too_short_is_answered_on_the_page_and_set_back(page):
    page.fill("input.size", "1.5")
    page.locator("input.sheep").focus()
    until(page, "document.querySelector('.news').textContent.includes('try 4')")
    assert page.input_value("input.size") == "4"
    assert page.evaluate("skydog.world.size") == 4.0


def test_pause_stops_and_a_step_is_one(page):
    halted(page)
    page.wait_for_timeout(300)
    assert step(page) == 0
    page.click("button.single")
    until(page, "skydog.flights[0].step === 1")
    page.keyboard.press(".")
    until(page, "skydog.flights[0].step === 2")
    page.wait_for_timeout(300)
    assert step(page) == 2
    page.click("button.play")
    until(page, "skydog.flights[0].step > 3")


def test_reset_is_the_same_case_and_new_case_another(page):
    halted(page)
    first = page.evaluate("skydog.flights[0].sheep")
    page.click("button.other")
    until(page, "skydog.settings.case === 2")
    assert page.evaluate("skydog.flights[0].sheep") != first


def test_the_dog_follows_the_mouse_and_stays_while_held(page):
    halted(page)
    dog = page.evaluate("skydog.flights[0].dogs[0]")
    drag(page, dog, [1.0, 3.0])
    near = "Math.hypot(skydog.flights[0].dogs[0][0] - 1, skydog.flights[0].dogs[0][1] - 3) < 0.1"
    until(page, near)
    page.keyboard.press("Space")
    until(page, "skydog.flights[0].step > 5")
    assert page.evaluate(near)
    page.mouse.up()
    until(page, f"!({near})")


def test_a_sheep_and_the_goal_follow_the_mouse_and_the_goal_stays_in_the_arena(page):
    halted(page)
    drag(page, page.evaluate("skydog.flights[0].sheep[1]"), [0.5, 3.5])
    page.mouse.up()
    until(page, "Math.abs(skydog.flights[0].sheep[1][0] - 0.5) < 0.05")
    drag(page, [0, 0], [2.0, 1.0])
    page.mouse.up()
    until(page, "Math.hypot(skydog.world.goal[0] - 2, skydog.world.goal[1] - 1) < 0.05")
    drag(page, page.evaluate("skydog.world.goal"), [9.0, -9.0])
    page.mouse.up()
    until(page, "skydog.world.goal[0] === 4 && skydog.world.goal[1] === 0")


def test_a_case_that_is_reset_before_its_first_step_is_shown_as_before(page):
    halted(page)
    page.keyboard.press("r")
    page.wait_for_timeout(400)
    assert page.evaluate("skydog.flights[0].sheep.length") == 3
    shown = pixels(page, "canvas.arena")
    assert (shown == shown[shown.shape[0] // 2, 2]).all(axis=-1).mean() < 0.9


def test_the_goal_moves_by_keys_too(page):
    page.keyboard.press("Shift+ArrowUp")
    until(page, "skydog.world.goal[1] > 0 && skydog.world.goal[0] === 0")


def test_a_player_flies_by_keys_and_hovers_when_they_are_let_go(page):
    page.keyboard.press("2")
    until(page, "skydog.settings.mode === 'fly'")
    page.keyboard.press("r")
    until(page, "skydog.flights[0].step > 2")
    x, y = page.evaluate("skydog.flights[0].dogs[0]")
    page.keyboard.down("ArrowUp")
    until(page, f"skydog.flights[0].dogs[0][1] > {y} + 0.5")
    assert page.evaluate("skydog.flights[0].dogs[0][0]") == x
    page.keyboard.up("ArrowUp")
    page.wait_for_timeout(300)
    rest = page.evaluate("skydog.flights[0].dogs[0]")
    page.wait_for_timeout(300)
    assert page.evaluate("skydog.flights[0].dogs[0]") == rest
    page.keyboard.down("d")
    until(page, f"skydog.flights[0].dogs[0][0] > {x} + 0.2")


def test_a_player_flies_to_where_the_pointer_is_held(page):
    page.check("[name=mode][value=fly]", force=True)
    until(page, "skydog.settings.mode === 'fly'")
    page.mouse.move(*page.evaluate("skydog.screen([1, 3])"))
    page.mouse.down()
    until(
        page, "Math.hypot(skydog.flights[0].dogs[0][0] - 1, skydog.flights[0].dogs[0][1] - 3) < .1"
    )
    page.mouse.up()


def test_a_race_shows_two_worlds_and_tells_who_won(page):
    page.keyboard.press("3")
    until(page, "skydog.flights.length === 2")
    until(page, "document.querySelector('.news').textContent.startsWith('ready')")
    assert page.evaluate("skydog.flights.map((f) => f.step)") == [0, 0]
    page.keyboard.press("ArrowLeft")
    until(page, "skydog.flights[1].step > 5")
    assert page.is_visible(".score")
    assert page.inner_text(".rival") == "h-ddpg-4x4"
    until(page, "document.querySelector('.news').textContent.startsWith('h-ddpg-4x4 is home')")
    page.keyboard.press("1")
    until(page, "skydog.flights.length === 1")


def test_sixty_sheep_and_three_dogs_are_drawn(page):
    for box, many in (("sheep", 60), ("dogs", 3)):
        page.evaluate(
            "([box, many]) => { const b = document.querySelector('input.' + box);"
            "b.value = many; b.dispatchEvent(new Event('change')); }",
            [box, many],
        )
    until(page, "skydog.flights[0].sheep.length === 60 && skydog.flights[0].dogs.length === 3")
    until(page, "skydog.flights[0].step > 10")


def test_a_page_finds_its_server_again_and_goes_on_with_its_choices(browser):
    with serving() as url:
        context = browser.new_context()
        page = context.new_page()
        page.goto(url)
        until(page, "window.skydog?.flights.length > 0")
        page.keyboard.press("2")
        until(page, "skydog.settings.mode === 'fly'")
    until(page, "document.querySelector('.link').textContent.startsWith('no connection')")
    with serving(port=urlsplit(url).port, chosen="strombom"):
        until(page, "document.querySelector('.link').textContent === 'live'")
        until(page, "skydog.settings.mode === 'fly' && skydog.settings.policy === 'h-ddpg-4x4'")
        context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_shows_everything_within_its_width(browser, url, scheme):
    phone = {"has_touch": True, "color_scheme": scheme}
    with opened(browser, url, **phone) as page:
        page.set_viewport_size({"width": 390, "height": 844})
        until(page, "window.skydog?.flights.length > 0")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        page.tap("label:has([value=fly])")
        until(page, "skydog.settings.mode === 'fly'")


def test_who_wants_little_motion_begins_paused(browser, url):
    with opened(browser, url, reduced_motion="reduce") as page:
        until(page, "window.skydog?.settings?.paused")


GAME = begun()

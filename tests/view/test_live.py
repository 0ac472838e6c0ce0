import asyncio
import http.client
import json
import math
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser import chromium, opened, pixels, until, waited

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.view import live
from skydog.view.colours import ROLES
from skydog.view.game import TOWARD

client = pytest.importorskip("websockets.sync.client")
exceptions = pytest.importorskip("websockets.exceptions")

SHEPHERDS = {"strombom": Strombom(), "h-ddpg-4x4": store.load("h-ddpg-4x4")}


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


# The server, without a browser.


@contextmanager
def serving(shepherds=SHEPHERDS, chosen="h-ddpg-4x4", port=0):
    """A server in a thread of its own, as long as the context lasts."""
    found = Future()

    async def run():
        over = asyncio.Event()
        begin = live.opening(shepherds, chosen)
        async with live.listening(shepherds, begin, "127.0.0.1", port) as url:
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
        address = url.replace("http", "ws") + "live"
        self.connecting = client.connect(address, open_timeout=60, **options)
        self.world = {}

    def __enter__(self):
        self.wire = self.connecting.__enter__()
        assert "hello" in self.hear()
        self.frame()
        return self

    def __exit__(self, *problem):
        self.connecting.__exit__(*problem)

    def say(self, **order):
        self.wire.send(json.dumps(order))

    def hear(self):
        return json.loads(self.wire.recv(timeout=120))

    def seen(self, told):
        self.say(seen=told["frame"])
        self.world |= told

    def frame(self):
        """The next frame, with all that was told before."""
        while "frame" not in (told := self.hear()):
            pass
        self.seen(told)
        return self.world

    def error(self):
        """The next error, however many frames come before."""
        while "error" not in (told := self.hear()):
            self.seen(told)
        return told["error"]

    def plays_on(self):
        before = self.world["start"]
        self.say(reset=True)
        while self.frame()["start"] == before:
            pass
        while self.frame()["flights"][0]["step"] == 0:
            pass
        return True


def test_rubbish_is_answered_and_the_game_goes_on(url):
    with Player(url) as player:
        for message in ("sheep", '{"sheep": 0}', '{"arena": 1.5}', b"\x00\xff"):
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
    inbox.put({"fly": (TOWARD, (1.0, 1.0))})
    inbox.put({})
    held = [order.get("hold") for order in inbox.take()]
    assert held == [("dog", 0, (199.0, 0.0)), None, ("dog", 0, (1.0, 1.0)), None]


def test_a_page_that_draws_nothing_is_sent_no_more_than_it_can_be_behind(url):
    with Player(url) as player:
        told = [player.hear() for _ in range(live.AHEAD)]
        assert all("frame" in message for message in told)
        with pytest.raises(TimeoutError):
            player.wire.recv(timeout=0.5)
        player.say(seen=told[-1]["frame"])
        assert player.plays_on()


def test_pages_choose_for_themselves_alone(url):
    with Player(url) as one, Player(url) as two:
        one.say(sheep=60)
        while one.frame()["settings"]["sheep"] != 60:
            pass
        assert len(one.world["flights"][0]["sheep"]) == 60
        assert two.plays_on()
        assert two.world["settings"]["sheep"] == len(two.world["flights"][0]["sheep"]) == 3


def test_a_shepherd_that_fails_is_told_of_and_another_flies_on(caplog):
    def lost(world, state):
        raise RuntimeError("which way?")

    with serving({"strombom": Strombom(), "lost": lost}, "strombom") as url, Player(url) as player:
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
        ({"host": "0"}, "try --host 127.0.0.1"),
        ({"host": "0:0::0"}, "try --host 127.0.0.1"),
        ({"host": "127..0.1"}, "try --host 127.0.0.1"),
        ({"host": ""}, "try --host 127.0.0.1"),
        ({"host": "*"}, "try --host 127.0.0.1"),
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


def test_a_server_that_ends_cuts_its_connections_and_waits_for_nobody():
    with ExitStack() as stay:
        with serving() as url:
            place = urlsplit(url)
            stay.enter_context(socket.create_connection((place.hostname, place.port)))
            player = stay.enter_context(Player(url))
        with pytest.raises(exceptions.ConnectionClosedError):  # and not by a farewell
            player.error()


def test_ctrl_c_ends_the_server_in_silence():
    # A shell may have told those that it starts in the background to ignore Ctrl-C.
    code = (
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from skydog.shepherds.strombom import Strombom\n"
        "from skydog.view import live\n"
        "live.serve({'strombom': Strombom()}, 'strombom', port=0,\n"
        "           ready=lambda url: print(url, flush=True))\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout
        place = urlsplit(server.stdout.readline().strip())
        with socket.create_connection((place.hostname, place.port)):
            server.send_signal(signal.SIGINT)
            _, errors = server.communicate(timeout=60)
    assert (server.returncode, errors) == (0, "")


# The page, in a browser. What is told of a place or a step is told of a paused game, which goes
# on when it is told to, in a page without motion, which shows what it has heard.


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser, url):
    with opened(browser, url, reduced_motion="reduce") as page:
        until(page, "window.skydog?.settings?.paused")  # who wants little motion begins so
        restart(page)
        assert step(page) == 0
        yield page


def step(page):
    return page.evaluate("skydog.flights[0].step")


def dog(page):
    return page.evaluate("skydog.flights[0].dogs[0]")


def restart(page):
    before = page.evaluate("skydog.start")
    page.keyboard.press("r")
    until(page, f"skydog.start > {before}")


def steps(page, many=1):
    """Go on by single steps; all that was said before has then been heard."""
    for _ in range(many):
        before = step(page)
        page.keyboard.press(".")
        until(page, f"skydog.flights[0].step > {before}")
        assert step(page) == before + 1


def to_the_end(page):
    page.locator("input.speed").press("End")
    until(page, "skydog.settings.speed === 64")
    page.keyboard.press("Space")


def move(page, place):
    page.mouse.move(*page.evaluate("(place) => skydog.screen(place)", place), steps=3)


def grasp(page, who, at):
    """Take hold of who is shown at a place; tried again if the picture moved meanwhile."""

    def grasped():
        move(page, page.evaluate(at))
        if page.evaluate("skydog.hand.hovered?.who") != who:
            return False
        page.mouse.down()
        if page.evaluate("skydog.hand.held?.who") == who:
            return True
        page.mouse.up()
        return False

    waited(grasped)


def let_go(page):
    page.mouse.up()
    until(page, "!skydog.hand.held")


def at(place, x, y):
    return f"Math.hypot({place}[0] - {x}, {place}[1] - {y}) < 0.05"


def test_a_mission_is_drawn_and_told_of_until_it_is_accomplished(page):
    start = pixels(page, "canvas.arena")
    assert len(np.unique(start.reshape(-1, 3), axis=0)) > 20
    steps(page, 3)
    waited(lambda: (pixels(page, "canvas.arena") != start).any())
    to_the_end(page)
    until(page, "skydog.flights[0].done")
    assert page.inner_text(".step") == str(step(page))
    assert page.inner_text(".now > .doing") == "accomplished"
    assert page.inner_text(".home") == "3 of 3"
    assert page.inner_text(".news").startswith(f"home in {step(page)} steps")


def test_a_page_with_motion_plays_at_once(browser, url):
    with opened(browser, url) as page:
        until(page, "window.skydog?.flights[0]?.step > 1")
        shown = pixels(page, "canvas.arena")
        restart(page)
        waited(lambda: (pixels(page, "canvas.arena") != shown).any())


def test_the_chosen_sheep_and_dogs_are_flown(page):
    page.fill("input.sheep", "60")
    page.fill("input.dogs", "3")
    until(page, "skydog.flights[0].sheep.length === 60 && skydog.flights[0].dogs.length === 3")
    assert page.inner_text("label:has(.sheep) output") == "60"
    steps(page)


def test_the_chosen_sheepdog_preset_and_noise_are_flown(page):
    page.select_option(".policy", "strombom")
    until(page, "skydog.settings.policy === 'strombom'")
    page.select_option(".preset", "strombom2014")
    until(page, "skydog.world.size === 150 && skydog.settings.noise === 0.3")
    page.locator("input.noise").press("Home")
    until(page, "skydog.settings.noise === 0")
    page.fill("input.size", "90")
    page.keyboard.press("Enter")
    until(page, "skydog.world.size === 90")


def test_an_arena_too_short_is_answered_on_the_page_and_set_back(page):
    page.evaluate(
        "() => { const news = document.querySelector('.news'); window.heard = [];"
        "new MutationObserver(() => heard.push(news.textContent)).observe(news,"
        "{ childList: true }); }"
    )
    page.fill("input.size", "1.5")
    page.locator("input.sheep").focus()
    until(page, "heard.some((text) => text.includes('try 4'))")
    assert page.input_value("input.size") == "4"
    assert page.evaluate("skydog.world.size") == 4.0


def test_pause_stops_and_a_step_is_one_and_reset_is_the_same_case(page):
    first = page.evaluate("skydog.flights[0].sheep")
    page.click("button.single")
    until(page, "skydog.flights[0].step > 0")
    steps(page, 2)
    assert step(page) == 3
    page.click("button.play")
    until(page, "skydog.flights[0].step > 4")
    page.click("button.play")
    until(page, "skydog.settings.paused")
    restart(page)
    assert page.evaluate("skydog.flights[0].sheep") == first
    restart(page)  # and so before its first step
    shown = pixels(page, "canvas.arena")
    assert (shown == shown[shown.shape[0] // 2, 2]).all(axis=-1).mean() < 0.9
    page.click("button.other")
    until(page, "skydog.settings.case === 2")
    assert page.evaluate("skydog.flights[0].sheep") != first


def test_the_dog_follows_the_mouse_and_stays_while_held(page):
    grasp(page, "dog", "skydog.flights[0].dogs[0]")
    move(page, [1.0, 3.0])
    until(page, at("skydog.flights[0].dogs[0]", 1, 3))
    held = dog(page)
    steps(page, 3)
    assert dog(page) == held
    let_go(page)
    steps(page)
    assert dog(page) != held


def test_a_sheep_and_the_goal_follow_the_mouse_and_the_goal_stays_in_the_arena(page):
    grasp(page, "sheep", "skydog.flights[0].sheep[1]")
    move(page, [0.5, 3.5])
    until(page, at("skydog.flights[0].sheep[1]", 0.5, 3.5))
    let_go(page)
    grasp(page, "goal", "skydog.world.goal")
    move(page, [2.0, 1.0])
    until(page, at("skydog.world.goal", 2, 1))
    page.mouse.move(1278, 798)  # the corner of the window
    until(page, "skydog.world.goal[0] === 4 && skydog.world.goal[1] === 0")
    let_go(page)
    page.keyboard.press("Shift+ArrowUp")
    steps(page)
    assert page.evaluate("skydog.world.goal") == [4.0, 0.1]


def test_a_player_flies_by_keys_and_to_the_pointer_and_hovers_when_they_are_let_go(page):
    page.keyboard.press("2")
    until(page, "skydog.settings.mode === 'fly'")
    x, y = dog(page)
    for key, way in (("ArrowUp", (0.0, 0.1)), ("d", (0.1, 0.0))):
        page.keyboard.down(key)
        steps(page, 3)
        page.keyboard.up(key)
        x, y = x + 3 * way[0], y + 3 * way[1]
        steps(page, 2)
        assert dog(page) == pytest.approx([x, y], abs=1e-3)
    x, y = x - 0.25, y - 0.2
    move(page, [x, y])
    page.mouse.down()

    def arrives():
        steps(page)
        return page.evaluate(at("skydog.flights[0].dogs[0]", x, y))

    waited(arrives)


def test_a_race_shows_two_worlds_and_tells_who_won(page):
    page.keyboard.press("3")
    until(page, "skydog.flights.length === 2")
    to_the_end(page)
    until(page, "!skydog.settings.paused")
    assert page.inner_text(".news").startswith("ready")
    assert page.evaluate("skydog.flights.map((f) => f.step)") == [0, 0]
    page.keyboard.press("w")
    until(page, "skydog.flights[1].done")
    assert page.is_visible(".score")
    assert page.inner_text(".rival") == "h-ddpg-4x4"
    assert page.inner_text(".news").startswith("h-ddpg-4x4 is home")
    page.keyboard.press("1")
    until(page, "skydog.flights.length === 1")


def test_a_page_finds_its_server_again_and_goes_on_with_its_choices(browser):
    with browser.new_context() as context:
        page = context.new_page()
        with serving() as url:
            page.goto(url)
            until(page, "window.skydog?.flights.length > 0")
            page.keyboard.press("2")
            until(page, "skydog.settings.mode === 'fly'")
        until(page, "document.querySelector('.link').textContent.startsWith('no connection')")
        with serving(port=urlsplit(url).port, chosen="strombom"):
            until(page, "document.querySelector('.link').textContent === 'live'")
            until(page, "skydog.settings.mode === 'fly' && skydog.settings.policy === 'h-ddpg-4x4'")


def test_a_phone_in_the_dark_shows_everything_within_its_width(browser, url):
    with opened(browser, url, has_touch=True, color_scheme="dark") as page:
        page.set_viewport_size({"width": 390, "height": 844})
        until(page, "window.skydog?.flights.length > 0")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        page.tap("label:has([value=fly])")
        until(page, "skydog.settings.mode === 'fly'")

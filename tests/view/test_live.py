import asyncio
import json
import math
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from urllib.parse import urlsplit

import pytest
from browser import PATIENCE
from serving import SHEPHERDS, asked, serving

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.view import connection, live
from skydog.view.colours import ROLES
from skydog.view.session import TOWARD

client = pytest.importorskip("websockets.sync.client")
exceptions = pytest.importorskip("websockets.exceptions")


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


def test_the_policies_have_the_chosen_sheepdog_first_and_all_that_ship():
    path = str(store.ZOO / "dhrl-6x6.safetensors")
    assert list(live.policies(path))[:2] == [path, "strombom"]
    assert {"strombom", "strombom-arrive", *store.ships()} < set(live.policies(path))
    with pytest.raises(Refusal, match="no sheepdog is called wolf"):
        live.policies("wolf")


# The server, without a browser.


@pytest.fixture(scope="module")
def url():
    with serving() as server:
        yield server.url


class Player:
    """A page that draws nothing: it says what it has seen, and nothing else by itself."""

    def __init__(self, url, **options):
        address = url.replace("http", "ws") + "live"
        self.connecting = client.connect(address, open_timeout=PATIENCE, **options)
        self.world = {}

    def __enter__(self):
        self.wire = self.connecting.__enter__()
        assert "hello" in self.hear()
        self.frame()
        return self

    def __exit__(self, *problem):
        self.connecting.__exit__(*problem)

    def say(self, **message):
        self.wire.send(json.dumps(message))

    def hear(self):
        return json.loads(self.wire.recv(timeout=PATIENCE))

    def seen(self, told):
        if "frame" in told:
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


def test_rubbish_is_answered_and_the_session_goes_on(url):
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


def test_a_flood_of_messages_leaves_the_others_playing(url):
    with Player(url) as flooding, Player(url) as good:
        for _ in range(2000):
            flooding.wire.send('{"reset": true, "sheep": 3}')
        assert good.plays_on()
        flooding.wire.socket.shutdown(socket.SHUT_RDWR)


def test_a_page_hears_of_its_session_again_even_after_a_flood_that_it_did_not_look_at(url):
    with Player(url) as player:
        told = [player.hear() for _ in range(connection.AHEAD)]
        for _ in range(2 * connection.PENDING):
            player.say(reset=True)
        assert "wait already" in player.hear()["error"]
        player.say(seen=told[-1]["frame"])
        assert player.plays_on()


def test_the_moves_of_a_pointer_in_a_row_are_the_latest_and_none_is_let_go_unheard():
    inbox = connection.Inbox()
    for at in range(200):
        inbox.put({"hold": ("dog", 0, (float(at), 0.0))})
    inbox.put({"hold": None})
    inbox.put({"hold": ("dog", 0, (1.0, 1.0))})
    inbox.put({"fly": (TOWARD, (1.0, 1.0))})
    inbox.put({})
    held = [message.get("hold") for message in inbox.take()]
    assert held == [("dog", 0, (199.0, 0.0)), None, ("dog", 0, (1.0, 1.0)), None]


def test_a_page_that_draws_nothing_is_sent_no_more_than_it_can_be_behind(url):
    with Player(url) as player:
        told = [player.hear() for _ in range(connection.AHEAD)]
        assert all("frame" in message for message in told)
        for _ in range(3):
            player.wire.send("rubbish")
            assert "error" in player.hear()  # and no frame before it
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

    shepherds = {"strombom": Strombom(), "lost": lost}
    with serving(shepherds, "strombom") as server, Player(server.url) as player:
        player.say(policy="lost")
        assert player.error() == "lost failed: 'which way?'"
        while not player.frame()["settings"]["paused"]:
            pass
        assert player.world["settings"]["policy"] == "strombom"
        player.say(paused=False)
        assert player.plays_on()
    assert "lost failed" in caplog.text


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


def test_it_is_served_from_a_notebooks_loop_and_from_a_thread_and_leaves_nothing():
    before = set(threading.enumerate())

    async def cell():
        with serving() as server, Player(server.url) as player:
            assert player.plays_on()
        return server

    with ThreadPoolExecutor() as pool:
        for server in asyncio.run(cell()), pool.submit(asyncio.run, cell()).result(PATIENCE):
            place = urlsplit(server.url)
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((place.hostname, place.port))
            server.close()  # once more does no harm
    assert set(threading.enumerate()) <= before


def test_what_is_no_http_is_turned_away_and_the_server_stays(url):
    place = urlsplit(url)
    for rubbish in (b"\x00\xff" * 50, b"POST / HTTP/1.1\r\n\r\n", b"GET /\r\n\r\n", b""):
        with socket.create_connection((place.hostname, place.port), timeout=PATIENCE) as wire:
            wire.sendall(rubbish)
            wire.shutdown(socket.SHUT_WR)
            while wire.recv(4096):
                pass
    assert asked(url)[0] == 200


def test_a_port_that_is_taken_is_refused_with_the_next(url):
    port = urlsplit(url).port
    with pytest.raises(Refusal, match=f"port {port} is taken; try --port {port + 1}"):
        serving(port=port)


@pytest.mark.parametrize(
    ("where", "remedy"),
    [
        ({"port": 70_000}, "try --port 8020"),
        ({"port": -1}, "try --port 8020"),
        ({"host": "127..0.1"}, "try --host 127.0.0.1"),
        ({"host": ""}, "try --host 127.0.0.1"),
        ({"host": "no.such.host.invalid"}, "try --host 127.0.0.1"),
        ({"host": "203.0.113.7"}, "try --host 127.0.0.1"),
    ],
)
def test_where_nobody_can_listen_is_refused_with_the_remedy(where, remedy):
    with pytest.raises(Refusal, match=remedy):
        serving(**where)


def test_without_websockets_the_line_to_install_it_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    with pytest.raises(Refusal, match=r"pip install 'skydog\[watch\]'"):
        serving()


def test_a_server_that_ends_cuts_its_connections_and_waits_for_nobody():
    with ExitStack() as stay:
        with serving() as server:
            place = urlsplit(server.url)
            stay.enter_context(socket.create_connection((place.hostname, place.port)))
            player = stay.enter_context(Player(server.url))
        with pytest.raises(exceptions.ConnectionClosedError):  # and not by a farewell
            player.error()


@pytest.mark.parametrize("ends", ["server.wait()", "input()"])
def test_a_program_ends_by_ctrl_c_or_by_itself_in_silence(ends):
    # A shell may have told those that it starts in the background to ignore Ctrl-C.
    code = (
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from skydog.shepherds.strombom import Strombom\n"
        "from skydog.view import live\n"
        "server = live.serve({'strombom': Strombom()}, 'strombom', port=0)\n"
        f"print(server.url, flush=True)\n{ends}\n"
    )
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen([sys.executable, "-c", code], text=True, **pipes) as program:
        assert program.stdout
        with Player(program.stdout.readline().strip()) as player:
            assert player.plays_on()
            if ends == "server.wait()":
                program.send_signal(signal.SIGINT)
            _, errors = program.communicate("\n", timeout=PATIENCE)
    assert (program.returncode, errors) == (0, "")

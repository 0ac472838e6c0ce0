"""Who is let in to the live view, by the headers of a browser, a tunnel or a proxy."""

import socket
from urllib.parse import urlsplit

import pytest
from browser import PATIENCE
from serving import asked, serving

pytest.importorskip("websockets")


@pytest.fixture(scope="module")
def url():
    with serving() as server:
        yield server.url


HANDSHAKE = (
    "GET /live HTTP/1.1",
    "Upgrade: websocket",
    "Connection: Upgrade",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
)


def lets_in(url, *headers):
    """Whether the socket is opened to a browser that sends these headers besides its handshake."""
    place = urlsplit(url)
    with socket.create_connection((place.hostname, place.port), timeout=PATIENCE) as wire:
        wire.sendall("\r\n".join([*HANDSHAKE, *headers, "", ""]).encode())
        status = int(wire.makefile("rb").readline().split()[1])
    assert status in (101, 403)
    return status == 101


LOCALLY = ("localhost:9000", "localhost", "127.0.0.1:1", "[::1]:9000", "127.8.9.10", "192.0.2.7:80")
FOREIGN = (
    "evil.example:{port}",
    "evil.example",
    "localhost.evil.example:{port}",
    "127.0.0.1.evil.example:{port}",
    "[::1].evil.example",
    "evil.example:{port}@localhost:{port}",
    "localhost:{port}.evil.example",
    "localhost.:{port}",
    "LOCALHOST:{port}",
    "127.1:{port}",
    "127.0.0.01:{port}",
    "2130706433:{port}",
    "0x7f000001:{port}",
    "::1",
    "[127.0.0.1]:{port}",
    "localhost:",
    "",
)


@pytest.mark.parametrize("name", LOCALLY)
def test_a_tunnel_may_have_any_port_and_a_proxy_may_speak_https(url, name):
    assert asked(url, Host=name)[0] == 200
    for scheme in ("http", "https"):
        assert lets_in(url, f"Host: {name}", f"Origin: {scheme}://{name}")
    assert lets_in(url, f"Host: {name}")  # no browser


@pytest.mark.parametrize("name", FOREIGN)
def test_a_foreign_name_that_was_made_to_lead_here_stays_outside(url, name):
    name = name.format(port=urlsplit(url).port)
    assert asked(url, Host=name)[0] == 403
    headers = f"Host: {name}", f"Origin: http://{name}"
    assert not lets_in(url, *headers)
    assert not lets_in(url, *headers, "X-Forwarded-Host: localhost")


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "http://localhost:3000",
        "http://localhost",
        "http://127.0.0.1:9000",
        "http://localhost:9000.evil.example",
        "http://localhost:9000/",
        "ws://localhost:9000",
        "localhost:9000",
        "null",
        "",
    ],
)
def test_a_foreign_page_stays_outside(url, origin):
    assert not lets_in(url, "Host: localhost:9000", f"Origin: {origin}")
    twice = "Origin: http://localhost:9000", f"Origin: {origin}"
    assert not lets_in(url, "Host: localhost:9000", *twice)


def test_a_host_has_to_be_said_once(url):
    assert not lets_in(url)
    assert not lets_in(url, "Host: localhost", "Host: localhost")


def test_a_proxy_tells_what_it_was_asked_for_itself(url):
    for host in ("localhost:8020", "lab.example"):  # some say their own name, some the server's
        assert asked(url, Host=host, **{"X-Forwarded-Host": "lab.example"})[0] == 200
        proxied = f"Host: {host}", "X-Forwarded-Host: lab.example"
        assert lets_in(url, *proxied, "Origin: https://lab.example")
        assert not lets_in(url, *proxied, "Origin: https://evil.example")
        assert not lets_in(url, *proxied, "Origin: http://localhost:8020")
    own_name = "Host: lab.example", "X-Forwarded-Proto: https"
    assert lets_in(url, *own_name, "Origin: https://lab.example")
    assert not lets_in(url, *own_name, "Origin: https://evil.example")
    through_two = "X-Forwarded-Host: lab.example, inner.example"
    assert lets_in(url, "Host: localhost:8020", through_two, "Origin: https://lab.example")


def test_all_addresses_may_be_listened_at_and_a_foreign_name_stays_outside():
    with serving(host="0.0.0.0") as server:
        assert server.url.startswith("http://127.0.0.1:")
        assert asked(server.url)[0] == 200
        assert asked(server.url, Host="evil.example")[0] == 403


def test_a_host_that_was_named_may_be_asked_for_by_its_name(monkeypatch):
    place = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", 0))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: place)
    with serving(host="Lab.example") as server:
        monkeypatch.undo()
        assert asked(server.url, Host="lab.example:9000")[0] == 200
        assert asked(server.url, Host="other.example:9000")[0] == 403

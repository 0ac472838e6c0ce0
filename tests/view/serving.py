"""The live view's server, for the tests of its manners and of its page."""

import http.client
from urllib.parse import urlsplit

from browser import PATIENCE

from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.view import live

SHEPHERDS = {"strombom": Strombom(), "h-ddpg-4x4": store.load("h-ddpg-4x4")}


def serving(shepherds=SHEPHERDS, chosen="h-ddpg-4x4", port=0, **options):
    """A server, as long as the context lasts."""
    return live.serve(shepherds, chosen, port=port, **options)


def asked(url, path="/", method="GET", **headers):
    """What the server answers: status, headers and content."""
    place = urlsplit(url)
    assert place.hostname
    wire = http.client.HTTPConnection(place.hostname, place.port, timeout=PATIENCE)
    try:
        wire.request(method, path, headers=headers)
        response = wire.getresponse()
        return response.status, dict(response.headers), response.read().decode()
    finally:
        wire.close()

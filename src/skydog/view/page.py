"""The pages' common parts: how a flock is drawn, in which colours, and the key to both."""

from importlib import resources

from skydog.study.report import fill
from skydog.view.colours import ROLES


def filled(name: str, **values: str) -> str:
    """A page's template by its file name, with the common parts and `values` filled in."""
    colours = " ".join(f"--{role}: {colour};" for role, colour in ROLES.items())
    common = {"colours": colours, "key": read("key.html").rstrip(), "arena": read("arena.js")}
    return fill(read(name), **common, **values)


def read(name: str) -> str:
    """A part of a page, by its file name."""
    return resources.files("skydog.view").joinpath(name).read_text("utf-8")


def live_page(nonce: str) -> str:
    """The page of the live view, whose scripts run under a policy that names `nonce`."""
    parts = {"style": filled("live.css"), "live": read("live.js"), "controls": read("controls.js")}
    return filled("live.html", nonce=nonce, **parts)

"""The pages' common parts: how a flock is drawn, in which colours, and the key to both."""

from importlib import resources

from skydog.study.report import fill
from skydog.view.colours import ROLES


def filled(name: str, **values: str) -> str:
    """A page's template by its file name, with the common parts and `values` filled in."""

    def read(part: str) -> str:
        return resources.files("skydog.view").joinpath(part).read_text("utf-8")

    colours = " ".join(f"--{role}: {colour};" for role, colour in ROLES.items())
    key, arena = read("key.html").rstrip(), read("arena.js")
    return fill(read(name), colours=colours, key=key, arena=arena, **values)

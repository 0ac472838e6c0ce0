"""A Sphinx extension: what must hold of the built site. With `-W` a fault fails the build."""

import re
from importlib.resources import files
from pathlib import Path

from sphinx.util import logging

# One file without fonts, which draws formulas as SVG. Sphinx takes MathJax from a CDN by default.
MATHJAX = str(files("sphinx-mathjax-offline") / "static" / "mathjax" / "tex-svg.js")

ADDRESS = r"[\"']?((?:https?:)?//[^\"'\s>)]+)"
TAG = re.compile(rf"<(?!a\b)[a-z]\w*\b[^>]*?\s(?:src|srcset|href|data)={ADDRESS}")
STYLE = re.compile(rf"(?:url\(|@import)\s*{ADDRESS}")


def fetched(text: str) -> list[str]:
    """The addresses on other servers that a browser fetches to draw this HTML or CSS.

    The target of a link, `<a href>`, is not fetched.
    """
    return TAG.findall(text) + STYLE.findall(text)


def faults(site: Path) -> list[str]:
    """What is wrong with a built site: pages that need another server, a notebook not run."""
    pages = [*site.rglob("*.html"), *site.rglob("*.css")]
    found = [
        f"{page.relative_to(site)} needs another server: {address}"
        for page in pages
        for address in fetched(page.read_text())
    ]
    if "<img" not in (site / "story.html").read_text():
        found.append("story.html has no pictures: the notebook was not run")
    return found


def check(app, exception):
    """Warn of each fault once the site is built."""
    for fault in [] if exception else faults(Path(app.outdir)):
        logging.getLogger(__name__).warning(fault)


def setup(app):
    """Called by Sphinx."""
    app.config.html_static_path.append(MATHJAX)
    app.config.mathjax_path = Path(MATHJAX).name
    app.connect("build-finished", check)

"""What the build of the site refuses, and the notebook that it runs."""

import json
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture
def checks(monkeypatch):
    """The Sphinx extension of the site."""
    monkeypatch.setattr(sys, "path", [str(DOCS), *sys.path])
    return pytest.importorskip("checks", reason="Sphinx is not installed")


@pytest.mark.parametrize(
    "text",
    [
        '<script defer="defer" src="https://cdn.example/mathjax.js"></script>',
        '<link rel="stylesheet" href="//fonts.example/a.css">',
        "<img alt='x' src='http://pictures.example/a.png'>",
        "@font-face { src: url(https://fonts.example/a.woff2); }",
        "@import 'https://fonts.example/a.css';",
    ],
)
def test_what_another_server_has_is_found(checks, text):
    (address,) = checks.fetched(text)
    assert ".example/" in address


@pytest.mark.parametrize(
    "text",
    [
        '<a class="reference external" href="https://arxiv.org/abs/2004.11543">the paper</a>',
        '<script src="_static/tex-svg.js"></script><img src="_images/twin.png">',
        "a { background: url('minus.png'); }",
    ],
)
def test_what_the_site_has_itself_is_not(checks, text):
    assert checks.fetched(text) == []


def test_a_site_is_refused_for_a_script_from_elsewhere_and_for_a_notebook_without_pictures(
    checks, tmp_path
):
    (tmp_path / "story.html").write_text('<img src="_images/1.png">')
    assert checks.faults(tmp_path) == []
    (tmp_path / "story.html").write_text('<script src="https://cdn.example/a.js"></script>')
    elsewhere, no_pictures = checks.faults(tmp_path)
    assert "https://cdn.example/a.js" in elsewhere
    assert "no pictures" in no_pictures


def test_the_notebook_is_kept_without_outputs():
    for cell in json.loads((DOCS / "story.ipynb").read_text())["cells"]:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None

"""A real Chromium, without a window, for the tests of pages."""

import io
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from PIL import Image

QUIET = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PATIENCE = 600  # seconds: only what hangs takes so long, on however busy a machine


@contextmanager
def chromium() -> Iterator[Any]:
    """The system's Chromium. Skips the test where there is none."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("chromium is not on the PATH, so no page is opened in a browser")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=program, args=list(QUIET), timeout=PATIENCE * 1000
        )
        yield browser
        browser.close()


@contextmanager
def opened(browser: Any, url: str, **options: Any) -> Iterator[Any]:
    """A page of its own, which afterwards must have had no errors on its console."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, **options)
    page, errors = context.new_page(), []
    context.set_default_timeout(PATIENCE * 1000)
    page.on("console", lambda told: errors.append(told.text) if told.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    try:
        page.goto(url)
        yield page
    finally:
        context.close()
    assert errors == []


def waited(state: Callable[[], Any]) -> Any:
    """Wait until a state is there, and return what it is: no matter how long on a busy machine."""
    for _ in range(PATIENCE * 20):
        if value := state():
            return value
        time.sleep(0.05)
    raise AssertionError("never so")


def until(page: Any, expression: str) -> Any:
    """Wait until an expression is true in the page, and return what it is.

    Asked from outside, since the page's own policy forbids it to evaluate text.
    """
    return waited(lambda: page.evaluate(expression))


def pixels(page: Any, selector: str) -> np.ndarray:
    """What is seen of an element: red, green and blue."""
    shot = page.locator(selector).screenshot()
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))

"""The page of the live view, in a browser.

What is told of a place or a step is told of a paused session, which goes on when it is told to, in
a page without motion, which shows what it has heard.
"""

import threading
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser import opened, pixels, until, waited
from proxy import proxied
from serving import serving

pytest.importorskip("websockets")


@pytest.fixture(scope="module")
def url():
    with serving() as server:
        yield server.url


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
    assert page.inner_text(".doing") == "accomplished"
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
        with serving() as server:
            page.goto(server.url)
            until(page, "window.skydog?.flights.length > 0")
            page.keyboard.press("2")
            until(page, "skydog.settings.mode === 'fly'")
        until(page, "document.querySelector('.link').textContent.startsWith('no connection')")
        with serving(port=urlsplit(server.url).port or 0, chosen="strombom"):
            until(page, "document.querySelector('.link').textContent === 'live'")
            until(page, "skydog.settings.mode === 'fly' && skydog.settings.policy === 'h-ddpg-4x4'")


def test_a_page_behind_a_proxy_plays_at_its_path_by_https(browser, url, tmp_path):
    with (
        proxied(url, tmp_path) as proxy,
        opened(browser, proxy.url, ignore_https_errors=True) as page,
    ):
        until(page, "window.skydog?.flights[0]?.step > 1")


def test_a_page_says_so_while_its_world_is_compiled(browser):
    traces = threading.Event()

    def slow(world, state):
        traces.wait()
        return 0.0 * state.dogs

    try:
        with serving({"slow": slow}, "slow") as server, opened(browser, server.url) as page:
            for sheep in (3, 4):
                page.locator("text=Compiling the world…").wait_for(state="visible")
                traces.set()
                page.locator("text=Compiling the world…").wait_for(state="hidden")
                until(page, f"skydog.flights[0].sheep.length === {sheep}")
                traces.clear()
                page.fill("input.sheep", str(sheep + 1))
            traces.set()
    finally:
        traces.set()


PHONES = ((320, 568), (390, 844), (568, 320), (667, 375), (844, 390))
SCREENS = ((768, 1024), (1024, 600), (1280, 600), (1280, 800))
# Keeps what is written beyond the edges of its canvas.
WRITTEN = """
window.cut = [];
const { fillText } = CanvasRenderingContext2D.prototype;
CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
  const box = this.measureText(text), { clientWidth, clientHeight } = this.canvas;
  const inside = x >= box.actualBoundingBoxLeft && x + box.actualBoundingBoxRight <= clientWidth
    && y >= box.actualBoundingBoxAscent && y + box.actualBoundingBoxDescent <= clientHeight;
  if (!inside) cut.push(text);
  fillText.call(this, text, x, y);
};
"""
DRAWN = "new Promise((then) => requestAnimationFrame(() => requestAnimationFrame(then)))"
OUTSIDE = """[...document.querySelectorAll("main *")].filter((part) => {
  const { left, right, width } = part.getBoundingClientRect();
  return width && part.checkVisibility() && (left < 0 || right > innerWidth);
}).map((part) => part.outerHTML)"""
BELOW = """[...document.querySelectorAll(".picture, .transport > *")].filter((part) =>
  part.getBoundingClientRect().bottom > innerHeight).map((part) => part.outerHTML)"""


@pytest.mark.parametrize("colours", ["light", "dark"])
def test_nothing_is_cut_on_any_screen(browser, url, colours):
    look = {"has_touch": True, "color_scheme": colours, "reduced_motion": "reduce"}
    with opened(browser, "about:blank", **look) as page:
        page.add_init_script(WRITTEN)
        page.goto(url)
        until(page, "window.skydog?.flights.length > 0")
        page.select_option(".policy", "strombom")
        page.select_option(".preset", "strombom2014")
        until(page, "skydog.world.size === 150")
        for width, height in PHONES + SCREENS:
            page.set_viewport_size({"width": width, "height": height})
            page.evaluate("cut.length = 0")
            page.evaluate(DRAWN)
            steps(page)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert page.evaluate(OUTSIDE) == page.evaluate(BELOW) == page.evaluate("cut") == []
        page.tap("label:has([value=fly])")
        until(page, "skydog.settings.mode === 'fly'")

"""A real browser on the page: skipped where none is installed.

Starting a process, and drawing its page in software for the first time, is what takes long: the
tests share one process with the virtual rig and one tab.
"""

import contextlib
import importlib.util
import os
import pathlib
import signal
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from tests.view.serve_page import STRIKE_SETUP
from tools.browse_page import TablePage, find_browser, open_browser

from cablecast.setup import Setup
from cablecast.view.look import open_collection

if importlib.util.find_spec("playwright") is not None:
    from playwright.sync_api import TimeoutError

HAS_BROWSER = find_browser() is not None and importlib.util.find_spec("playwright") is not None
pytestmark = [
    pytest.mark.skipif(not HAS_BROWSER, reason="no Chromium, or no Playwright to drive it"),
    pytest.mark.slow,
]

TARGET = np.array([0.35, 1.15])

# The model lands here, too, between the lines of the table, where nothing is drawn but the map.
BESIDE = np.array([-0.63, 1.13])

# The browser asks for a new connection once a second, and drops the one before if that is not up
# yet: a busy computer, which draws in software, needs many attempts [ms].
RECONNECTED = 300_000
# After so long without a plan, a person clicks again [ms].
CLICK_LOST = 20_000

# A pixel in the middle of the table is 4 mm wide; the page shows the target to a millimetre.
POINTING = 0.01

# What a finger touches is as high as this at least [pixel].
FINGER = 44

# Between the blue of the map, half transparent over the table, and the table [of 255].
MAP_BLUENESS = 30


class Served:
    """A page in a process of its own."""

    def __init__(self, folder, kind):
        self.folder, self.kind = folder, kind
        self.port = 8600 + os.getpid() % 900
        self.start()

    def start(self):
        options = [str(self.folder), str(self.port), self.kind]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.view.serve_page", *options],
            cwd=pathlib.Path(__file__).parents[2],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.address = self.process.stdout.readline().strip()
        assert self.address.startswith("http://127.0.0.1:")
        self.port = int(self.address.rpartition(":")[2])

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@pytest.fixture(scope="module")
def browser():
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    virtual = Served(tmp_path_factory.mktemp("virtual"), "virtual")
    yield virtual
    virtual.kill()


@pytest.fixture(scope="module")
def page(served, browser):
    return open_page(browser, served)


def open_page(browser, served, setup=None, **options):
    # Stripes and notices that move are drawn in software, too.
    options = {"viewport": {"width": 800, "height": 360}} | options
    tab = browser.new_page(reduced_motion="reduce", **options)
    page = TablePage(tab, setup or Setup())
    page.open(served.address)
    page.wait_for("Click on the")
    page.hide_notices()
    return page


def numbers(page):
    """Return the numbers of the tries at their targets, as the table of tries shows them."""
    return [row.split()[0] for row in page.tries()]


WATCH_CAST_BUTTON = """() => {
  window.castWasDisabled = false;
  const look = () => {
    for (const button of document.querySelectorAll("button:disabled"))
      if (button.innerText.trim() === "Cast") window.castWasDisabled = true;
  };
  new MutationObserver(look).observe(
    document.body, {subtree: true, childList: true, attributes: true});
}"""
"""Remembers in a tab whether its button Cast was ever disabled after a change of the page."""


def test_a_person_points_casts_and_corrects_in_two_tabs(page, browser, served):
    page.point_at(TARGET)
    page.wait_for("Look at the plan")
    assert np.linalg.norm(page.target() - TARGET) < POINTING
    page.button("Cast").click()
    page.wait_for_rest()
    assert numbers(page) == ["1"]
    assert "1.20 m, 17°" in page.tries()[0]
    # A second tab sees the same, and cannot cast while the first does.
    second = browser.new_page(viewport={"width": 500, "height": 300}, reduced_motion="reduce")
    second = TablePage(second, Setup())
    second.open(served.address)
    second.wait_for_rest()
    # Watched from before the cast on: it may be over when the next question is asked.
    second.tab.evaluate(WATCH_CAST_BUTTON)
    page.button("Correct and cast again").click()
    second.tab.wait_for_function("window.castWasDisabled")
    second.tab.close()
    # Reloaded in mid-cast, the page knows of the cast and of its end.
    page.tab.reload()
    page.wait_for_rest()
    page.tab.wait_for_function("document.querySelectorAll('tbody tr').length >= 2")
    page.hide_notices()
    assert numbers(page) == ["1", "2"]
    page.button("Replay").click()
    page.button("Undo the last try").click()
    page.wait_for("is discarded")


def test_the_map_is_seen_on_the_table_and_the_camera_beside_it(page, tmp_path, wait_until):
    def blueness():
        path = page.picture(tmp_path / "page.png")
        red, _, blue = Image.open(path).convert("RGB").getpixel(page.pixel(BESIDE))
        return blue - red

    page.point_at(TARGET)
    page.wait_for("Look at the plan")
    plain = blueness()
    page.tab.get_by_text("View", exact=True).first.click()
    page.tab.get_by_label("Where it can land").click()
    page.wait_for("Expected miss of a first cast")
    # The model is sure there.
    wait_until(lambda: blueness() - plain > MAP_BLUENESS)
    page.tab.get_by_label("Where it can land").click()
    page.button("Cast").click()
    page.wait_for_rest()
    page.tab.get_by_text("Camera", exact=True).wait_for()


def test_a_page_whose_process_dies_in_mid_cast_finds_the_session_again_by_itself(
    page, served, wait_until
):
    before = numbers(page)
    page.point_at(TARGET * [-1, 1])
    page.wait_for("Look at the plan")
    page.button("Cast").click()
    page.wait_for("is under way")
    address = served.address
    served.kill()
    served.start()
    assert served.address == address
    page.wait_for("Click on the table", RECONNECTED)
    wait_until(lambda: numbers(page) == before)
    assert len(open_collection(served.folder / "aim")) == len(before)

    def has_planned():
        # A connection that came up late is followed by another, between which a click is lost.
        page.point_at(TARGET * [-1, 1])
        with contextlib.suppress(TimeoutError):
            page.wait_for("Look at the plan", CLICK_LOST)
            return True

    wait_until(has_planned)
    assert np.linalg.norm(page.target() - TARGET * [-1, 1]) < POINTING
    local = (address, "data:", "blob:", "ws://127.0.0.1")
    assert all(url.startswith(local) for url in page.requests)
    page.tab.close()


def test_a_rig_that_fails_says_so_and_a_hit_offers_another_target(browser, tmp_path):
    served = Served(tmp_path, "failing")
    try:
        page = open_page(browser, served)
        page.point_at(TARGET)
        page.wait_for("Look at the plan")
        page.button("Cast").click()
        # A rig that moves something is asked for twice.
        page.button("Yes, it may move").click()
        page.wait_for("protective stop")
        assert page.tries() == []
        page.button("Cast").click()
        page.button("Yes, it may move").click()
        page.wait_for("Hit: ")
        page.wait_for_rest()
        # Another cast at a target that was hit could only miss it.
        names = ("Correct and cast again", "Cast all the same", "Cast")
        assert not any(page.button(name).is_visible() for name in names)
        page.button("Another target").click()
        page.wait_for("Look at the plan")
        assert np.linalg.norm(page.target() - TARGET) > POINTING
        # A click beside the table leaves nothing of that plan.
        page.point_at([0.0, -0.1])
        page.wait_for("Click on the table")
        assert page.button("Cast").is_disabled()
        page.tab.close()
    finally:
        served.kill()


def test_a_finger_taps_a_point_in_the_air_and_the_cable_is_swung_there(browser, tmp_path):
    served = Served(tmp_path, "strike")
    try:
        phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
        page = open_page(browser, served, STRIKE_SETUP, **phone)
        page.tab.touchscreen.tap(*page.pixel((1.2, 0.9)))
        page.wait_for("Look at the plan")
        ahead, height = (page.tab.get_by_label(name).input_value() for name in ("ahead", "height"))
        assert np.allclose([float(ahead), float(height)], (1.2, 0.9), atol=POINTING)
        # The panel is as wide as the phone, and its buttons are as high as a finger.
        box = page.button("Swing").bounding_box()
        assert box["width"] > 0.9 * 390
        assert page.button("Plan").bounding_box()["height"] >= box["height"] >= FINGER
        page.button("Swing").click()
        page.wait_for_rest()
        page.wait_for("The nearest point of its path is")
        assert numbers(page) == ["1"]
        page.tab.context.close()
    finally:
        served.kill()

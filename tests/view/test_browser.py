"""A real browser on the page: skipped where none is installed."""

import importlib.util
import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image
from tools.browse_page import TablePage, find_browser, open_browser

from cablecast.setup import Setup
from cablecast.view.look import open_collection

HAS_BROWSER = find_browser() is not None and importlib.util.find_spec("playwright") is not None
pytestmark = [
    pytest.mark.skipif(not HAS_BROWSER, reason="no Chromium, or no Playwright to drive it"),
    pytest.mark.slow,
]

TARGET = np.array([0.35, 1.15])

# A pixel in the middle of the table is 3 mm wide; the page shows the target to a millimetre.
POINTING = 0.01


class Served:
    """A page in a process of its own."""

    def __init__(self, folder, kind):
        self.folder, self.kind = folder, kind
        self.port = 8600 + os.getpid() % 900
        self.start()

    def start(self):
        script = pathlib.Path(__file__).with_name("serve_page.py")
        self.process = subprocess.Popen(
            [sys.executable, str(script), str(self.folder), str(self.port), self.kind],
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


@pytest.fixture
def serve(tmp_path):
    served = []

    def start(kind):
        served.append(Served(tmp_path, kind))
        return served[-1]

    yield start
    for one in served:
        one.kill()


def open_page(browser, served):
    tab = browser.new_page(viewport={"width": 960, "height": 540})
    page = TablePage(tab, Setup())
    page.open(served.address)
    return page


def test_a_person_points_casts_corrects_and_survives_a_kill(browser, serve):
    served = serve("virtual")
    page = open_page(browser, served)
    page.wait_for("Click on the table")
    page.hide_notices()
    page.point_at(TARGET)
    page.wait_for("Look at the plan")
    assert np.linalg.norm(page.target() - TARGET) < POINTING
    page.button("Cast").click()
    page.wait_for_rest()
    assert len(page.tries()) == 1
    assert "1.20 m, 17°" in page.tries()[0]

    # A second tab sees the same, and cannot cast while the first does.
    second = open_page(browser, served)
    second.wait_for_rest()
    page.button("Correct and cast again").click()
    second.wait_for("is under way")
    assert second.button("Cast").is_disabled()
    # Reloaded in mid-cast, the page knows of the cast and of its end.
    page.tab.reload()
    page.wait_for_rest()
    page.tab.wait_for_function("document.querySelectorAll('tbody tr').length >= 2")
    second.tab.close()
    assert [row.split()[0] for row in page.tries()] == ["1", "2"]
    page.button("Replay").click()
    page.tab.get_by_text("Undo the last try").click()
    page.wait_for("is taken back")

    # The process dies in the middle of a cast, and another goes on with the session.
    page.point_at(TARGET * [-1, 1])
    page.wait_for("Look at the plan")
    page.button("Cast").click()
    page.wait_for("is under way")
    served.kill()
    served.start()
    page.open(served.address)
    page.wait_for("Click on the table")
    assert [row.split()[0] for row in page.tries()] == ["1", "2"]
    assert len(open_collection(served.folder)) == 2
    assert all(
        url.startswith((served.address, "data:", "blob:", "ws://127.0.0.1"))
        for url in page.requests
    )
    page.tab.close()


def test_the_map_is_seen_on_the_table_and_the_camera_beside_it(browser, serve, tmp_path):
    page = open_page(browser, serve("virtual"))
    page.wait_for("Click on the table")
    page.hide_notices()

    def blueness(name):
        page.picture(tmp_path / name)
        red, _, blue = Image.open(tmp_path / name).convert("RGB").getpixel(page.pixel(TARGET))
        return blue - red

    plain = blueness("plain.png")
    page.tab.get_by_text("View", exact=True).first.click()
    page.tab.get_by_label("Where it can land").click()
    page.wait_for("Expected miss of a first cast")
    # The model is sure there: the map is blue, and half transparent over a yellow table.
    for _ in range(30):
        if (coloured := blueness("map.png")) - plain > 30:
            break
        time.sleep(1.0)
    assert coloured - plain > 30
    page.point_at(TARGET)
    page.wait_for("Look at the plan")
    page.button("Cast").click()
    page.wait_for_rest()
    page.tab.get_by_text("Camera", exact=True).wait_for()
    page.tab.close()


def test_a_page_that_loses_its_connection_finds_the_table_again_by_itself(browser, serve):
    served = serve("own")
    page = open_page(browser, served)
    page.wait_for("Click on the table")
    page.hide_notices()
    page.point_at(TARGET)
    page.wait_for("Look at the plan")
    served.kill()
    address = served.address
    served.start()
    assert served.address == address
    page.wait_for("Click on the table")
    page.point_at(TARGET)
    page.wait_for("Look at the plan")
    page.tab.close()


def test_a_rig_that_fails_says_so_and_the_page_lives(browser, serve):
    page = open_page(browser, serve("failing"))
    page.wait_for("Click on the table")
    page.hide_notices()
    page.point_at(TARGET)
    page.wait_for("Look at the plan")
    page.button("Cast").click()
    # A rig that moves something is asked for twice.
    page.button("Yes, cast").click()
    page.wait_for("protective stop")
    assert page.tries() == []
    page.button("Cast").click()
    page.button("Yes, cast").click()
    page.wait_for("from the target")
    page.tab.close()

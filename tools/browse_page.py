"""A browser without a display on the page of `cablecast view`: for its tests and its pictures.

    python tools/browse_page.py http://127.0.0.1:8080 docs/images

takes the pictures of the documentation from a page that runs with a prepared session, and with
--strike those of `view --task strike`. With --first-cast it goes the way of a newcomer instead:
three clicks on a page without a model.
"""

import argparse
import base64
import contextlib
import io
import pathlib
import re
import shutil
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from PIL import Image

from cablecast.conventions import polar_to_xy
from cablecast.setup import Setup, StrikeConfig
from cablecast.view.film import camera_behind_robot
from cablecast.view.page import WIDE
from cablecast.view.shapes import Surface

BROWSERS = ("chromium", "chromium-browser", "google-chrome")

# Software drawing, and nothing that talks to anybody. --disable-gpu would switch WebGL off.
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

PICTURED = (-0.5, 0.85)
"""Target of the pictures [m]."""

STRUCK = (0.9, 1.4)
"""Target of the picture of a strike: distance ahead and height [m]."""

COLORS = 256
"""Colours of a picture."""

PATIENCE = 240_000
"""Longest wait for anything on the page [ms]: a busy machine draws slowly."""


def find_browser() -> str | None:
    """Return the path of a browser that can be driven; None where there is none."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


@contextlib.contextmanager
def open_browser() -> Iterator[Any]:
    """Yield a browser of Playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_browser(), args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


class TablePage:
    """The page in one tab.

    Args:
        tab: Page of Playwright.
        setup: Set-up that the page shows.

    Attributes:
        tab: Page of Playwright.
        requests: Addresses that the page asked for.
    """

    def __init__(self, tab: Any, setup: Setup):
        self.tab, self._setup = tab, setup
        self.requests: list[str] = []
        tab.on("request", lambda request: self.requests.append(request.url))
        tab.set_default_timeout(PATIENCE)

    def open(self, address: str) -> None:
        """Open the page, and wait until its controls are there."""
        self.tab.goto(address)
        self.wait_for("cablecast")

    def wait_for(self, text: str, patience: float = PATIENCE) -> None:
        """Wait until a text is seen on the page [ms]; what hidden tabs say does not count."""
        self.tab.locator(f"text={text} >> visible=true").first.wait_for(timeout=patience)

    def button(self, name: str) -> Any:
        """Return a button by its whole label."""
        return self.tab.get_by_role("button", name=name, exact=True)

    def text(self) -> str:
        """Return all text on the page."""
        return str(self.tab.inner_text("body"))

    def point_at(self, xy: Any) -> None:
        """Click on a point of the table, or of the plane of a swing [m], shape [2]."""
        self.tab.mouse.click(*self.pixel(xy))

    def pixel(self, xy: Any) -> tuple[float, float]:
        """Return where in the window a target [m], shape [2], is seen before anybody turns it."""
        box = self.tab.locator("canvas").first.bounding_box()
        aspect = min(box["width"] / box["height"], WIDE)
        size = round(box["width"]), round(box["height"])
        camera = camera_behind_robot(self._setup, *size, aspect, panel=True)
        x, y = camera.to_image(Surface.of(self._setup).points(xy))
        return box["x"] + float(x), box["y"] + float(y)

    def target(self) -> np.ndarray:
        """Wait for a plan on the page, and return its target [m], shape [2]."""
        self.tab.locator("tr").filter(has_text=re.compile(r"^target")).first.wait_for()
        found = re.search(r"target\s+([\d.]+) m, (-?[\d.]+)°", self.text())
        if found is None:
            raise RuntimeError("the page shows no plan")
        return polar_to_xy([float(found[1]), np.radians(float(found[2]))])

    def tries(self) -> list[str]:
        """Return the rows of the table of tries."""
        rows = self.tab.locator("tr").all_inner_texts()
        return [row for row in rows if re.match(r"\d+\t", row)]

    def wait_for_rest(self) -> None:
        """Wait until a cast has ended, with a landing or without."""
        name = re.compile("^(Correct and (cast|swing) again|Another target)$")
        self.tab.get_by_role("button", name=name, disabled=False).first.wait_for(state="visible")

    def hide_notices(self) -> None:
        """Close the browser's own notices, such as that it draws in software."""
        buttons = ".mantine-Notification-closeButton"
        # All at once, in the page: notices vanish by themselves, too, and none must be waited for.
        while self.tab.locator(buttons).count():
            self.tab.evaluate(
                "buttons => document.querySelectorAll(buttons).forEach(b => b.click())", buttons
            )
            time.sleep(0.3)

    def picture(self, path: pathlib.Path) -> pathlib.Path:
        """Save what the tab shows as PNG, and return its path.

        Playwright's own way waits for two quiet frames, which a page that moves never has.
        """
        session = self.tab.context.new_cdp_session(self.tab)
        answer = session.send("Page.captureScreenshot", {"format": "png"})
        path.parent.mkdir(parents=True, exist_ok=True)
        shown = Image.open(io.BytesIO(base64.b64decode(answer["data"]))).convert("RGB")
        shown.quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)
        return path


def open_page(
    browser: Any, address: str, setup: Setup, width: int = 1280, height: int = 720
) -> TablePage:
    """Open the page in a new tab of a size [px]."""
    page = TablePage(browser.new_page(viewport={"width": width, "height": height}), setup)
    page.open(address)
    return page


def take_pictures(address: str, folder: pathlib.Path) -> None:
    """Take the pictures of docs/view.md from a page with a prepared session."""
    with open_browser() as browser:
        page = open_page(browser, address, Setup())
        page.wait_for("Click on the table")
        page.hide_notices()
        page.point_at(PICTURED)
        page.wait_for("Look at the plan")
        # The ghost is on its way.
        time.sleep(2.0)
        page.picture(folder / "view-plan.png")
        page.button("Cast").click()
        for _ in range(2):
            page.wait_for_rest()
            time.sleep(6.0)
            if page.button("Correct and cast again").is_visible():
                page.button("Correct and cast again").click()
                page.wait_for("is under way")
        page.wait_for_rest()
        time.sleep(8.0)
        page.picture(folder / "view-cast.png")
        page.tab.get_by_role("tab", name="Look").click()
        page.button("Open").click()
        page.wait_for("from measured")
        # The last one, which the other pictures show, too.
        page.tab.get_by_label("Cast", exact=True).last.click()
        page.tab.get_by_role("option").last.click()
        time.sleep(4.0)
        for kind in ("believed", "tuned"):
            page.tab.get_by_label(kind).click()
            time.sleep(2.0)
        time.sleep(8.0)
        page.picture(folder / "view-look.png")
        page.tab.get_by_role("tab", name="Cast").click()
        page.button("Replay").click()
        time.sleep(8.0)
        page.tab.get_by_text("View", exact=True).first.click()
        page.tab.get_by_label("Where it can land").click()
        page.wait_for("Expected miss of a first cast")
        # The colours are explained at the bottom of the panel, and the camera's picture is there.
        page.tab.mouse.move(1100, 500)
        page.tab.mouse.wheel(0, 4000)
        time.sleep(4.0)
        page.picture(folder / "view-map.png")
        page.tab.get_by_label("Where it can land").click()
        phone = open_page(browser, address, Setup(), width=390, height=780)
        time.sleep(6.0)
        phone.hide_notices()
        phone.picture(folder / "view-phone.png")


def take_strike_picture(address: str, folder: pathlib.Path) -> None:
    """Take the picture of docs/strike.md, of a first try."""
    with open_browser() as browser:
        page = open_page(browser, address, Setup(strike=StrikeConfig()))
        page.wait_for("Click on the plane")
        page.hide_notices()
        page.point_at(STRUCK)
        page.wait_for("Look at the plan")
        page.button("Swing").click()
        page.wait_for_rest()
        time.sleep(6.0)
        page.picture(folder / "view-strike.png")


def make_first_cast(address: str, folder: pathlib.Path) -> None:
    """Go from a page without a model to the first cast in three clicks, and say what each took."""
    with open_browser() as browser:
        page = open_page(browser, address, Setup())
        page.hide_notices()
        begun = time.monotonic()

        def say(what: str) -> None:
            print(f"{time.monotonic() - begun:6.1f} s  {what}", flush=True)

        say("click 1: Get ready")
        page.button("Get ready").click()
        done: set[str] = set()
        while "Click on the table" not in (text := page.text()):
            for task in re.findall(r"^(.+?): \d+ of \d+ ", text, re.MULTILINE):
                if task not in done:
                    say(f"    {task}")
                    done.add(task)
            time.sleep(0.2)
        say("click 2: the table")
        page.point_at(PICTURED)
        page.wait_for("Look at the plan")
        say("    the plan is seen")
        say("click 3: Cast")
        page.button("Cast").click()
        page.wait_for("from the target")
        say(f"    {page.tries()[0]!r}")
        page.picture(folder / "first-cast.png")


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("address", help="address of a page with a prepared session")
    parser.add_argument("folder", type=pathlib.Path, help="folder of the pictures")
    parser.add_argument("--first-cast", action="store_true", help="make the first cast")
    parser.add_argument("--strike", action="store_true", help="strike a point in the air")
    arguments = parser.parse_args()
    if find_browser() is None:
        raise SystemExit(f"none of {', '.join(BROWSERS)} is installed")
    browse = make_first_cast if arguments.first_cast else take_pictures
    browse = take_strike_picture if arguments.strike else browse
    browse(arguments.address, arguments.folder)


if __name__ == "__main__":
    main()

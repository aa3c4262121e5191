"""Latencies and memory of the page, without and with a browser.

    python -m benchmarks page --session runs/cable_1/aim

The session is one that `cablecast view` or `aim` prepared. Each wall time is followed by the
processor time of the same work, which a busy machine lengthens less.
"""

import contextlib
import dataclasses
import os
import pathlib
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator

import numpy as np
from tools.browse_page import TablePage, find_browser, open_browser

from benchmarks.common import has
from benchmarks.result import Table
from cablecast.aiming.session import AimSession
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.rigs.make import make_rig
from cablecast.view.desk import Desk
from cablecast.view.look import ShownCast
from cablecast.view.page import SLIDERS, Page, slid_params
from cablecast.view.worker import Worker

SLOWLY = 0.2
"""Shown seconds per second at which a plan lasts longer than frames are counted."""


@dataclasses.dataclass
class Args:
    session: pathlib.Path = pathlib.Path("runs/cable_1/aim")
    """Folder of a prepared session; nothing in it is changed."""
    count: int = 20
    """Plans and slider moves."""
    casts: int = 200
    """Casts after which the memory is measured."""
    browser: bool = True
    """Measure the frames in a browser, where one is installed."""


def main(args: Args) -> Iterator[Table]:
    """Yield the waits on the page; frames and memory are printed."""
    if "OPENBLAS_NUM_THREADS" not in os.environ:
        # As `cablecast view` does. NumPy reads it on import, so restart the process.
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environment)
    policy = ForwardSearchPolicy.load(args.session / "model")
    setup = policy.setup
    with (
        tempfile.TemporaryDirectory(prefix="cablecast-") as folder,
        make_rig("virtual", setup) as rig,
    ):
        desk = Desk(rig)
        page = Page(desk, Worker(), lambda report: None, pathlib.Path(folder), port=8690)
        start = time.perf_counter()
        # As the page does at the end of getting ready.
        desk.open_session(AimSession(policy, out=pathlib.Path(folder) / "session"))
        print(f"session opened in {time.perf_counter() - start:.1f} s")
        try:
            rows = measure(page, policy, args)
        finally:
            page.close()
    columns = ("wait", "median [ms]", "longest [ms]", "processor [ms]", "longest of it [ms]")
    yield Table(title="Waits on the page", columns=columns, rows=rows)


def measure(page: Page, policy: ForwardSearchPolicy, args: Args) -> list[tuple]:
    desk, rng = page.desk, np.random.default_rng(0)
    targets = policy.predicted_xy[rng.choice(len(policy.predicted_xy), args.count)]
    print(f"cores {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
    rows = [
        timed("the first plan after a click", lambda k: page.aim(targets[0]), 1),
        timed(
            "a plan after a click, while the last one plays",
            lambda k: page.aim(targets[k]),
            args.count,
        ),
    ]
    page.stage.player.seek(0.0)
    preview = desk.aim(targets[0])
    exponents = rng.uniform(-0.5, 0.5, (args.count, len(SLIDERS)))

    def slide(k: int) -> None:
        params = slid_params(desk.dynamics.params, dict(zip(SLIDERS, exponents[k], strict=True)))
        slid = desk.dynamics.with_params(params)
        ShownCast.simulated(preview.proposal.trajectory, desk.setup, desk.engine, slid)

    rows.append(timed("slider to simulated cast", slide, args.count))
    rows.append(timed("map of expected misses", lambda k: page.show_map(True), 3))
    page.show_map(False)
    if args.browser and find_browser() is not None and has("playwright"):
        measure_frames(page, targets)
    measure_memory(page, targets, args)
    return rows


def timed(what: str, work: Callable[[int], object], count: int) -> tuple:
    """Return a row: median and longest time by the clock and of the processor [ms]."""
    walls, cpus = [], []
    for k in range(count):
        wall, cpu = time.perf_counter(), time.process_time()
        work(k)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    cells = (f"{1000 * value:.0f}" for own in (walls, cpus) for value in (np.median(own), max(own)))
    return what, *cells


def measure_memory(page: Page, targets: np.ndarray, args: Args) -> None:
    """Cast through the page, ten times at each target, and print the process's peak memory."""
    for k in range(args.casts):
        if k % 10 == 0:
            page.aim(targets[(k // 10) % len(targets)])
            page.cast()
        else:
            page.correct()
        page.worker.drain()
        if page.worker.state.message:
            raise SystemExit(f"cast {k} failed: {page.worker.state.message}")
        if k + 1 in (1, args.casts // 4, args.casts // 2, args.casts):
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"memory after {k + 1} casts: at most {peak:.0f} MB", flush=True)


def measure_frames(page: Page, targets: np.ndarray) -> None:
    with open_browser() as browser:
        for ratio in (1.0, 0.5):
            window = browser.new_page(viewport={"width": 1280, "height": 720})
            tab = TablePage(window, page.desk.setup)
            tab.open(f"{page.address}/?fixedDpr={ratio:g}")
            tab.wait_for("plan")
            print(f"frames a second, {ratio:g} drawn pixels for each of the window's:")
            print(f"  while a plan plays: {frames_while_playing(page, tab, targets[0])}")
            with hidden(page):
                print(f"  with an empty scene: {frames_while_playing(page, tab, targets[0])}")
            window.close()


@contextlib.contextmanager
def hidden(page: Page) -> Iterator[None]:
    """Hide everything in the scene while frames are still sent: what is left is the browser's."""
    handles = page.server.scene._handle_from_node_name.values()
    parts = [handle for handle in handles if handle.visible]
    for part in parts:
        part.visible = False
    yield
    for part in parts:
        # A plan may have replaced it.
        with contextlib.suppress(RuntimeError):
            part.visible = True


def frames_while_playing(page: Page, tab: TablePage, target: np.ndarray) -> str:
    """Return how many frames are drawn and sent while a plan plays slowly enough not to end."""
    page.stage.player.speed = SLOWLY
    page.aim(target)
    before, start = page.stage.player.frame_count, time.perf_counter()
    drawn = tab.frames_per_second()
    sent = (page.stage.player.frame_count - before) / (time.perf_counter() - start)
    page.stage.player.speed = 1.0
    return f"{drawn:.1f} drawn, {sent:.1f} sent"

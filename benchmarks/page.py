"""Latencies and memory of the page, without and with a browser.

    python -m benchmarks page --session runs/cable_1/aim

The session is one that `cablecast view` or `aim` prepared. Beside the wall time stands that of
the processor for the same work, which a busy machine does not lengthen as much.
"""

import dataclasses
import os
import pathlib
import resource
import time
from collections.abc import Callable

import numpy as np
from tools.browse_page import TablePage, find_browser, open_browser

from benchmarks.common import has
from cablecast.pipeline.aim_session import AimSession
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.rigs.make import make_rig
from cablecast.view.desk import Desk
from cablecast.view.look_controls import SLIDERS, slid_params
from cablecast.view.session import make_desk


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


def main(args: Args) -> None:
    policy = ForwardSearchPolicy.load(args.session / "model")
    setup = policy.setup
    rng = np.random.default_rng(0)
    rig = make_rig("engine", setup)
    desk = make_desk(rig)
    desk.set_session(AimSession(policy))
    targets = policy.predicted_xy[rng.choice(len(policy.predicted_xy), args.count)]
    desk.aim(targets[0])
    print(f"cores {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
    report("plan after a click, with its simulated cast", lambda k: desk.aim(targets[k]), args)
    preview = desk.aim(targets[0])
    exponents = rng.uniform(-0.5, 0.5, (args.count, len(SLIDERS)))

    def slide(k: int) -> None:
        params = slid_params(desk.params, dict(zip(SLIDERS, exponents[k], strict=True)))
        desk.simulate(preview.proposal.trajectory, params)

    report("slider to simulated cast", slide, args)
    measure_memory(desk, targets, args)
    if args.browser and find_browser() is not None and has("playwright"):
        measure_frames(desk, targets)


def report(what: str, work: Callable[[int], object], args: Args) -> None:
    walls, cpus = [], []
    for k in range(args.count):
        wall, cpu = time.perf_counter(), time.process_time()
        work(k)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    print(
        f"{what}: median {1000 * np.median(walls):.0f} ms, longest {1000 * max(walls):.0f} ms; "
        f"processor {1000 * np.median(cpus):.0f} ms, longest {1000 * max(cpus):.0f} ms"
    )


def measure_memory(desk: Desk, targets: np.ndarray, args: Args) -> None:
    for k in range(args.casts):
        if k % 10 == 0:
            desk.aim(targets[(k // 10) % len(targets)])
        desk.cast()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"memory after {args.casts} casts: at most {peak:.0f} MB")


def measure_frames(desk: Desk, targets: np.ndarray) -> None:
    from cablecast.view.page import Page
    from cablecast.view.worker import Worker

    page = Page(desk, Worker(), lambda report: None, port=8690)
    try:
        with open_browser() as browser:
            tab = TablePage(browser.new_page(viewport={"width": 1280, "height": 720}), desk.setup)
            tab.open(page.address)
            tab.wait_for("target")
            print(f"frames a second at rest: {tab.frames_per_second():.1f}")
            page.aim(targets[0])
            tab.wait_for("Look at the plan")
            before = page.player.frame_count
            shown = tab.frames_per_second()
            sent = (page.player.frame_count - before) / 3.0
            print(f"frames a second while a plan plays: {shown:.1f} drawn, {sent:.1f} sent")
    finally:
        page.close()

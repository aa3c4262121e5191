"""Serve the page with a model that needs no training: python serve_page.py FOLDER PORT RIG."""

import pathlib
import sys
import time

from cablecast.aiming.session import AimSession
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.action import ActionRanges, grid_actions
from cablecast.rigs.make import make_rig
from cablecast.view.desk import Desk
from cablecast.view.page import Page
from cablecast.view.worker import Worker
from conftest import SETUP, OffsetRig, linear_model

FRAMES_PER_SECOND = 5.0
"""Fewer pictures than a person wants: drawing in software takes most of the time of these tests."""

STOPPED_CAST = 4
"""Number of the cast of `OffsetRig`, from 0, that does not end before somebody stops it."""


def main() -> None:
    """Serve until somebody ends it."""
    folder, port, kind = pathlib.Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    own = OffsetRig()
    own.failures, own.during = 3, lambda: wait_to_be_stopped(own)
    rig = make_rig("virtual" if kind == "virtual" else own, SETUP)
    policy = ForwardSearchPolicy.from_candidates(
        grid_actions(ActionRanges(), (3, 40, 20, 3)), linear_model()
    )
    session = AimSession(policy, out=folder / "aim" / "session")
    desk, worker = Desk(rig, session=session), Worker()
    page = Page(
        desk, worker, lambda report: None, folder / "aim", port=port, rate=FRAMES_PER_SECOND
    )
    print(page.address, flush=True)
    worker.run()


def wait_to_be_stopped(own: OffsetRig) -> None:
    """Sleep as an arm moves, until the work is interrupted."""
    if own.cast_count == STOPPED_CAST:
        own.during = None
        time.sleep(600.0)


if __name__ == "__main__":
    main()

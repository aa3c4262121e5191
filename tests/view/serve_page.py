"""Serve the page with a model that needs no training, or with few swings of few cables.

python -m tests.view.serve_page FOLDER PORT RIG
"""

import pathlib
import sys

import numpy as np
from tests.learning.synthetic_casts import SETUP, linear_model
from tests.view.conftest import OffsetRig

from cablecast.aiming.session import AimSession
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.action import ActionRanges, grid_actions
from cablecast.pipeline.strike import prepare_strike
from cablecast.rigs.engine import RigSwing
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup, StrikeConfig
from cablecast.view.desk import Desk
from cablecast.view.page import Page
from cablecast.view.worker import Worker

FRAMES_PER_SECOND = 5.0
"""Fewer pictures than a person wants: drawing in software takes most of the time of these tests."""


STRIKE_SETUP = Setup(strike=StrikeConfig(watch_time=1.6))


def main() -> None:
    """Serve until somebody ends it."""
    folder, port, kind = pathlib.Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    if kind == "strike":
        rig = make_rig(RigSwing(STRIKE_SETUP, segment_count=12), STRIKE_SETUP)
        counts = {"move_count": 64, "cable_count": 2}
        serve(rig, prepare_strike(rig, out=folder / "aim", **counts), folder / "aim", port)
        return
    own = OffsetRig()
    # It fails as often as a trial is tried, and hits from then on.
    own.failures, own.offset = 3, np.zeros(2)
    rig = make_rig("virtual" if kind == "virtual" else own, SETUP)
    policy = ForwardSearchPolicy.from_candidates(
        grid_actions(ActionRanges(), (3, 40, 20, 3)), linear_model()
    )
    session = AimSession(policy, out=folder / "aim" / "session")
    serve(rig, session, folder / "aim", port)


def serve(rig, session, folder, port):
    """Serve a session of a rig."""
    desk, worker = Desk(rig), Worker()
    desk.set_session(session)
    page = Page(desk, worker, lambda report: None, folder, port=port)
    page.stage.player.rate = FRAMES_PER_SECOND
    print(page.address, flush=True)
    worker.run()


if __name__ == "__main__":
    main()

"""Serve the page with a model that needs no training.

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
from cablecast.rigs.make import make_rig
from cablecast.view.desk import Desk
from cablecast.view.page import Page
from cablecast.view.worker import Worker

FRAMES_PER_SECOND = 5.0
"""Fewer pictures than a person wants: drawing in software takes most of the time of these tests."""


def main() -> None:
    """Serve until somebody ends it."""
    folder, port, kind = pathlib.Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    own = OffsetRig()
    # It fails as often as a trial is tried, and hits from then on.
    own.failures, own.offset = 3, np.zeros(2)
    rig = make_rig("virtual" if kind == "virtual" else own, SETUP)
    policy = ForwardSearchPolicy.from_candidates(
        grid_actions(ActionRanges(), (3, 40, 20, 3)), linear_model()
    )
    session = AimSession(policy, out=folder / "aim" / "session")
    desk, worker = Desk(rig), Worker()
    desk.set_session(session)
    page = Page(
        desk, worker, lambda report: None, folder / "aim", port=port, rate=FRAMES_PER_SECOND
    )
    print(page.address, flush=True)
    worker.run()


if __name__ == "__main__":
    main()

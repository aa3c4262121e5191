"""Serve the page with a model that needs no training: python serve_page.py FOLDER PORT RIG."""

import pathlib
import sys

from cablecast.motion.action import ActionRanges, grid_actions
from cablecast.pipeline.aim_session import AimSession
from cablecast.policies import ForwardSearchPolicy
from cablecast.rigs.make import make_rig
from cablecast.view.page import Page
from cablecast.view.session import make_desk
from cablecast.view.worker import Worker
from conftest import SETUP, OffsetRig, linear_model


def main() -> None:
    """Serve until somebody ends it."""
    folder, port, kind = pathlib.Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    own = OffsetRig()
    own.failures = 3 if kind == "failing" else 0
    rig = make_rig("virtual" if kind == "virtual" else own, SETUP)
    policy = ForwardSearchPolicy.from_candidates(
        grid_actions(ActionRanges(), (3, 40, 20, 3)), linear_model()
    )
    desk, worker = make_desk(rig, folder), Worker()
    desk.set_session(AimSession(policy, out=folder / "session"))
    page = Page(desk, worker, lambda report: None, port=port, suggestion=folder)
    print(page.address, flush=True)
    worker.run()


if __name__ == "__main__":
    main()

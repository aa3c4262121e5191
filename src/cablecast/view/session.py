"""serve: a rig, a session and a page together, until somebody ends them."""

import os
import pathlib
from collections.abc import Callable
from typing import Any

from cablecast.datasets.reader import settings_object
from cablecast.errors import CheckpointError
from cablecast.motion.servo import ServoModel
from cablecast.pipeline.places import require
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.progress import ProgressCallback
from cablecast.view.desk import Desk
from cablecast.view.quick_model import make_quick_model
from cablecast.view.tries import TryStore, open_tries
from cablecast.view.worker import Worker

MODEL_FOLDER = "quick-model"

SEGMENT_COUNT, STEP = 30, 1e-3
"""Resolution of previews: a cast in a fraction of the time, the landing within some per cent of
that of the full resolution (docs/engine.md)."""


def make_desk(
    rig: CheckedRig,
    store: TryStore,
    folder: pathlib.Path,
    model: str | os.PathLike[str] | None = None,
) -> Desk:
    """Return the desk of a session.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        store: Store of the tries.
        folder: Folder of the session, which may hold a model that was made on the spot.
        model: Folder of a trained model.

    Raises:
        CheckpointError: The model is damaged.
        InputError: It was made for another set-up.
    """
    from cablecast.engines.warp_ import EngineWarp

    engine = EngineWarp(segment_count=SEGMENT_COUNT, dt=STEP)
    desk = Desk(rig, rig.setup, engine, store=store)
    own = folder / MODEL_FOLDER / "model"
    if model is not None:
        use_model(desk, ForwardSearchPolicy.load(pathlib.Path(model)))
    elif (own / "metrics.json").exists():
        try:
            use_model(desk, ForwardSearchPolicy.load(own))
        except CheckpointError as error:
            desk.message = f"{error}. Make the model again"
    return desk


def use_model(desk: Desk, policy: ForwardSearchPolicy) -> None:
    """Plan with a policy, and simulate with the cable and the servo that it learned from."""
    from cablecast.cable import CableParams

    info: dict[str, Any] = policy.model.info.get("dataset", {})
    settings = info.get("settings", {})
    params, servo = None, None
    if settings.get("params") is not None:
        params = settings_object(lambda values: CableParams(**values), info, "params", "the model")
    if settings.get("servo") is not None:
        servo = settings_object(ServoModel.from_dict, info, "servo", "the model")
    desk.set_model(policy, params, servo)


def serve(
    rig: CheckedRig,
    folder: str | os.PathLike[str],
    *,
    model: str | os.PathLike[str] | None = None,
    host: str,
    port: int,
    dark: bool = False,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve the page of a rig until Ctrl-C.

    Args:
        rig: Rig that `make_rig` returned.
        folder: Folder of the session.
        model: Folder of a trained model; the page makes one where None.
        host: Address to listen on.
        port: Port to listen on.
        dark: Whether the page begins dark.
        ready: Told the address once the page can be opened.
    """
    from cablecast.view.page import Page

    require("the page", "viser", "trimesh")
    folder = pathlib.Path(folder)
    settings = {"rig": rig.description, **rig.setup.to_settings()}
    with open_tries(folder, settings) as store:
        desk, worker = make_desk(rig, store, folder, model), Worker()

        def make_model(report: ProgressCallback) -> None:
            policy = make_quick_model(rig.setup, folder / MODEL_FOLDER, progress=report)
            use_model(desk, policy)

        page = Page(desk, worker, make_model, host=host, port=port, dark=dark)
        try:
            if ready is not None:
                ready(page.address)
            worker.run()
        finally:
            page.close()

"""serve: a rig, a session and a page together, until somebody ends them."""

import os
import pathlib
from collections.abc import Callable

from cablecast.engines.warp_ import EngineWarp
from cablecast.models.many_cables import ManyCablesModel
from cablecast.pipeline.aim import CALIBRATION_COUNT, SIMULATED_COUNT, prepare_aim
from cablecast.pipeline.aim_session import AimSession
from cablecast.pipeline.many_cables import REFINE_COUNT
from cablecast.pipeline.places import require
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import METRICS_FILE
from cablecast.runs.parts import Parts
from cablecast.runs.places import MODEL_FOLDER
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.view.album import ALBUM_FOLDER, Album
from cablecast.view.arm_meshes import ArmMeshes
from cablecast.view.desk import Desk
from cablecast.view.page import Page
from cablecast.view.worker import Work, Worker

SEGMENT_COUNT, STEP = 30, 1e-3
"""Resolution of previews: a cast in a fraction of the time, with a landing some per cent of the
cable's length from that of the full resolution (docs/view.md)."""


def make_desk(rig: CheckedRig, folder: pathlib.Path | None = None) -> Desk:
    """Return the desk of a session, still without a model.

    Args:
        rig: Rig that `make_rig` returned.
        folder: Folder of the session; nothing is kept where None.
    """
    album = Album(None if folder is None else Parts(folder / ALBUM_FOLDER))
    return Desk(rig, EngineWarp(segment_count=SEGMENT_COUNT, dt=STEP), album)


def preparation(
    desk: Desk,
    folder: pathlib.Path | None,
    *,
    calibration_count: int,
    count: int,
    seed: int,
    model: ManyCablesModel | None = None,
    refine: int = REFINE_COUNT,
) -> Work:
    """Return the work that gets a desk ready: casts, fit, simulation, training.

    Args:
        desk: Desk to hand the session to.
        folder: Folder of the session; what is done there is not done again.
        calibration_count: Casts that the rig makes.
        count: Simulated casts that the model learns from.
        seed: Seed of everything that is drawn by chance.
        model: Model of many cables, in place of one that learns from simulated casts of this one.
        refine: Simulated casts that the model of many cables learns from first.
    """

    def work(report: ProgressCallback) -> None:
        session = prepare_aim(
            desk.rig,
            calibration_count=calibration_count,
            count=count,
            seed=seed,
            model=model,
            refine=refine,
            out=folder,
            progress=report,
        )
        open_session(desk, session, report)

    return work


def open_session(desk: Desk, session: AimSession, report: ProgressCallback = ignore) -> None:
    """Hand a session to a desk, once its first plan will be as quick as the others.

    Args:
        desk: Desk to hand the session to.
        session: Session that `prepare_aim` returned.
        report: Told what is done.
    """
    report(Progress(task="A plan to begin with"))
    desk.rehearse(session)
    desk.set_session(session)


def serve(
    rig: CheckedRig,
    folder: str | os.PathLike[str],
    *,
    calibration_count: int = CALIBRATION_COUNT,
    count: int = SIMULATED_COUNT,
    seed: int = 0,
    host: str,
    port: int,
    dark: bool = False,
    model: ManyCablesModel | None = None,
    refine: int = REFINE_COUNT,
    arm_meshes: str | os.PathLike[str] | None = None,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve the page of a rig until Ctrl-C.

    Args:
        rig: Rig that `make_rig` returned.
        folder: Folder of the session, the same as that of `cablecast aim`.
        calibration_count: Casts that the rig makes to begin with.
        count: Simulated casts that the model learns from.
        seed: Seed of everything that is drawn by chance.
        host: Address to listen on.
        port: Port to listen on; the next free one if it is taken.
        dark: True for a page that begins dark.
        model: Model of many cables, in place of one that learns from simulated casts of this one.
        refine: Simulated casts that the model of many cables learns from first.
        arm_meshes: MJCF or URDF file whose meshes draw the arm; it is drawn as rods where None.
        ready: Told the address once the page can be opened.

    Raises:
        MissingExtraError: A library of the page is not installed.
        InputError: The model is of another set-up, or the file of meshes shows another arm.
    """
    require("the page", "viser", "trimesh", "torch", "safetensors")
    meshes = None if arm_meshes is None else ArmMeshes(arm_meshes, rig.setup.arm)
    if model is not None:
        model.check_setup(rig.setup)
    folder = pathlib.Path(folder)
    desk, worker = make_desk(rig, folder), Worker()
    prepare = preparation(
        desk,
        folder,
        calibration_count=calibration_count,
        count=count,
        seed=seed,
        model=model,
        refine=refine,
    )
    page = Page(
        desk,
        worker,
        prepare,
        host=host,
        port=port,
        dark=dark,
        suggestion=folder,
        home=folder.parent,
        meshes=meshes,
    )
    try:
        if ready is not None:
            ready(page.address)
        if (folder / MODEL_FOLDER / METRICS_FILE).exists():
            page.prepare()
        worker.run()
    finally:
        page.close()

"""`cablecast view`: the page to point, cast and look."""

import dataclasses
import os
import pathlib
from typing import TYPE_CHECKING, Annotated

import tyro

from cablecast.aiming.config import AimConfig
from cablecast.cli.options import (
    CableName,
    LabFile,
    RigName,
    TaskName,
    TimeLimit,
    WithPolar,
    argument,
)

if TYPE_CHECKING:
    from cablecast.setup import Setup
    from cablecast.view.arm_meshes import ArmMeshes


@dataclasses.dataclass(frozen=True, kw_only=True)
class View(AimConfig):
    """Open a page in the browser: click on the table, and the cable is cast there.

    With --task strike the page shows the plane in which a cable swings from a stick: click on it,
    and the free end passes there.

    The page shows the table, the arm and the cable, and runs until Ctrl-C. The first time it gets
    ready as `cablecast aim` does: the rig makes five casts, the simulator is fitted to them, which
    takes a minute or two of computing, and the rig makes three polar casts. A real arm moves only
    at a click. Every cast is kept in --out and counts; the same command goes on with the session.
    Only this computer sees the page, unless --host says otherwise.
    """

    task: TaskName = None
    setup: LabFile = None
    cable: CableName = None
    rig: RigName = "virtual"
    refit: tyro.conf.Suppress[bool] = True
    polar: WithPolar = True
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/aim or strike")] = None
    """Folder of the session, which `cablecast aim` goes on with."""
    time_limit: TimeLimit = 120.0
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets every computer in the network in, without a password."""
    port: int = 8080
    """Port to listen on; the next free one if it is taken."""
    arm_meshes: Annotated[
        pathlib.Path | None, argument("FILE", "those of the lab file's arm, or simple shapes")
    ] = None
    """MJCF or URDF file of your arm, whose meshes are drawn instead of simple shapes."""

    def run(self) -> None:
        """Serve the page until it is interrupted."""
        # NumPy reads this once. A plan multiplies small matrices, where a second thread mostly
        # waits: with two, a plan takes twice the processor time.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        from cablecast.cli.options import load_lab, open_rig
        from cablecast.errors import check_count
        from cablecast.runs.places import AIM_FOLDER, STRIKE_FOLDER, cable_folder
        from cablecast.view.arm_meshes import ArmMeshes
        from cablecast.view.page import serve

        check_count("port", self.port, 1, 65535)
        setup = load_lab(self.setup, self.cable, self.task)
        folder = AIM_FOLDER if setup.strike is None else STRIKE_FOLDER
        out = self.out or cable_folder(setup.cable.name) / folder
        if self.arm_meshes is not None:
            meshes = ArmMeshes(self.arm_meshes, setup.arm)
        else:
            meshes = _own_meshes(self.setup, setup)
        with open_rig(self.rig, setup, self.seed, out, self.time_limit) as rig:
            serve(
                rig,
                out,
                config=AimConfig.of(self),
                host=self.host,
                port=self.port,
                meshes=meshes,
                ready=lambda at: print(f"the page is at {at} (Ctrl-C ends it)", flush=True),
            )


def _own_meshes(lab_file: pathlib.Path | None, setup: "Setup") -> "ArmMeshes | None":
    """Return the meshes of the arm that a lab file names, if they can be drawn."""
    from cablecast.errors import CablecastError
    from cablecast.files import read_yaml
    from cablecast.view.arm_meshes import ArmMeshes

    arm = {} if lab_file is None else read_yaml(lab_file).get("arm")
    if lab_file is None or not isinstance(arm, dict) or "file" not in arm:
        return None
    try:
        return ArmMeshes(lab_file.parent / str(arm["file"]), setup.arm)
    except CablecastError:
        return None

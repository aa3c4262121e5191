"""`cablecast view`: the page to point, cast and look."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.options import argument


@dataclasses.dataclass(frozen=True, kw_only=True)
class View:
    """Open a page in the browser: click on the table, and the cable is cast there.

    The page shows the table, the arm and the cable. It runs until Ctrl-C. Every try is stored when
    it is done; the same command goes on with the session. Without a trained model the page makes
    a small one in a minute. Only this computer sees the page, unless --host says otherwise.
    """

    setup: Annotated[pathlib.Path | None, argument("FILE", "the paper's set-up")] = None
    """Lab file that describes cable, table, arm and motion."""
    cable: Annotated[str | None, argument("CABLE", "that of --setup, or cable_1")] = None
    """Cable in the gripper: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    model: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/model, if any")] = None
    """Folder that `cablecast train` wrote."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """Rig that makes the casts: virtual, engine, or your own robot as package.module:factory."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/view-RIG")] = None
    """Folder of the session."""
    seed: int = 0
    """Seed of the virtual rig."""
    time_limit: Annotated[float, argument("S")] = 120.0
    """Time limit of a reset or a cast [s]."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets every computer in the network in, without a password."""
    port: int = 8080
    """Port to listen on; the next free one if it is taken."""
    dark: bool = False
    """Begin with dark colours."""

    def run(self) -> None:
        """Serve the page until it is interrupted."""
        from cablecast.checks import check_count
        from cablecast.cli.options import load_lab, open_rig
        from cablecast.runs.places import MODEL_FOLDER, cable_folder, rig_folder
        from cablecast.view.session import serve

        check_count("port", self.port, 1, 65535)
        setup = load_lab(self.setup, self.cable)
        home = cable_folder(setup.cable.name)
        out = self.out or home / rig_folder("view", self.rig)
        model = self.model
        if model is None and (home / MODEL_FOLDER).is_dir():
            model = home / MODEL_FOLDER
        with open_rig(self.rig, setup, self.seed, out, self.time_limit) as rig:
            serve(
                rig,
                out,
                model=model,
                host=self.host,
                port=self.port,
                dark=self.dark,
                ready=lambda address: print(
                    f"the page is at {address} (Ctrl-C ends it)", flush=True
                ),
            )


def _announce(address: str) -> None:
    print(f"the page is at {address} (Ctrl-C ends it)", flush=True)

"""`cablecast import`: take casts that were recorded elsewhere into a dataset."""

import dataclasses
import pathlib
from typing import Annotated

import tyro

from cablecast.cli.options import CableName, LabFile, argument, casts_text, load_lab
from cablecast.cli.streams import say
from cablecast.runs.places import CASTS_FOLDERS, cable_folder


@dataclasses.dataclass(frozen=True, kw_only=True)
class Import:
    """Make a dataset to tune with from a table of casts that were recorded elsewhere.

    A row of the table (CSV or Parquet) is one moment of one cast: cast, time_s, x_m and y_m of the
    cable's end, and the motion as q1_rad, q2_rad, ..., as grip_x_m and grip_y_m, or as an action.
    Cells are empty where something was not measured. With --points, TABLE is a take of OptiTrack
    Motive or Vicon as they export it, or a folder of takes, one cast each. Takes seconds.
    docs/data.md explains every column.
    """

    table: Annotated[tyro.conf.Positional[pathlib.Path], argument("TABLE")]
    """CSV or Parquet file of samples."""
    points: Annotated[pathlib.Path | None, argument("FILE", "TABLE is no take")] = None
    """CSV of measured points in both frames: x_m, y_m, z_m, mocap_x_m, mocap_y_m, mocap_z_m."""
    end: Annotated[str, argument("NAME")] = "end"
    """Marker or rigid body of the take at the cable's free end."""
    grip: Annotated[tuple[str, ...], argument("NAME [NAME]")] = ("grip",)
    """Marker or body on the gripper; and a second one ahead of it, which gives its turn."""
    setup: LabFile = None
    cable: CableName = None
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/tune-data")] = None
    """Folder of the dataset."""

    def run(self) -> None:
        """Import, and print the number of casts."""
        from cablecast.data.mocap import MocapNames
        from cablecast.pipeline.import_casts import import_casts

        setup = load_lab(self.setup, self.cable)
        out = self.out or cable_folder(setup.cable.name) / CASTS_FOLDERS["tune"]
        mocap = None
        if self.points is not None:
            mocap = MocapNames(frame=self.points, end=self.end, grip=self.grip)
        dataset = import_casts(self.table, setup, out=out, report=say, mocap=mocap)
        ends = ", ".join(f"{count} {code}" for code, count in dataset.status_counts.items())
        print(f"{casts_text(len(dataset), setup.cable.name)} in {out} ({ends})")

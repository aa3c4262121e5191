"""Schema of D_tune, D_sim and D_real: one row is one trial.

Every dataset has the columns from `index` to `y_max`. Trials on a rig, and casts of many cables,
add some of `OPTIONAL_COLUMNS`. Unknown columns are read as they are.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import PARAM_UNITS
from cablecast.errors import DatasetError

SCHEMA_VERSION = 2
"""Version of the schema; datasets of other versions are refused."""

CONTROLLER_COLUMNS = ("controller_times", "target_q", "speed_scaling", "safety_bits")
"""Lists of what an arm's controller reported, in the order of `ControllerLog`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a dataset.

    Attributes:
        name: Name of the column.
        kind: Arrow type.
        unit: Unit, "-" for none.
        meaning: Phrase for the dataset card.
    """

    name: str
    kind: str
    unit: str
    meaning: str


COLUMNS = (
    Column(name="index", kind="int64", unit="-", meaning="number of the trial, from 0"),
    Column(
        name="theta1", kind="float64", unit="rad", meaning="angle at which the motion turns back"
    ),
    Column(name="theta2", kind="float64", unit="rad", meaning="angle at which the motion ends"),
    Column(name="r2", kind="float64", unit="m", meaning="radius at which the motion ends"),
    Column(name="psi", kind="float64", unit="rad", meaning="heading of the gripper at the end"),
    Column(
        name="endpoint_x",
        kind="float64",
        unit="m",
        meaning="resting point of the cable's free end, to the right of the robot",
    ),
    Column(
        name="endpoint_y",
        kind="float64",
        unit="m",
        meaning="resting point of the cable's free end, away from the robot",
    ),
    Column(name="status", kind="string", unit="-", meaning="end of the trial"),
    Column(name="duration", kind="float64", unit="s", meaning="duration of the gripper's motion"),
    Column(
        name="x_min",
        kind="float64",
        unit="m",
        meaning="smallest x of the free end during the trial",
    ),
    Column(
        name="x_max", kind="float64", unit="m", meaning="largest x of the free end during the trial"
    ),
    Column(
        name="y_min",
        kind="float64",
        unit="m",
        meaning="smallest y of the free end during the trial",
    ),
    Column(
        name="y_max", kind="float64", unit="m", meaning="largest y of the free end during the trial"
    ),
)

OPTIONAL_COLUMNS = (
    Column(name="repeat", kind="int64", unit="-", meaning="repeat of the same action, from 0"),
    Column(name="times", kind="list", unit="s", meaning="times of the track"),
    Column(name="track_x", kind="list", unit="m", meaning="x of the free end at these times"),
    Column(name="track_y", kind="list", unit="m", meaning="y of the free end at these times"),
    Column(name="joint_times", kind="list", unit="s", meaning="times of the commanded joints"),
    Column(
        name="joint_q",
        kind="list",
        unit="rad",
        meaning="commanded joint angles, six after six, one group per time",
    ),
    Column(name="actual_times", kind="list", unit="s", meaning="times of the reported joints"),
    Column(
        name="actual_q",
        kind="list",
        unit="rad",
        meaning="reported joint angles, six after six, one group per time",
    ),
    Column(
        name="controller_times",
        kind="list",
        unit="s",
        meaning="times of the reported joints by the clock of the arm's controller",
    ),
    Column(
        name="target_q",
        kind="list",
        unit="rad",
        meaning="joint angles that the controller followed at these times, six after six",
    ),
    Column(
        name="speed_scaling",
        kind="list",
        unit="-",
        meaning="speed scaling that the controller reported at these times",
    ),
    Column(
        name="safety_bits",
        kind="list",
        unit="-",
        meaning="safety status bits that the controller reported at these times",
    ),
    Column(
        name="grip_times",
        kind="list",
        unit="s",
        meaning="times of the tracked grip, where no arm moved it",
    ),
    Column(
        name="grip_pose",
        kind="list",
        unit="m, rad",
        meaning="x, y, z, yaw and pitch of the tracked grip, five after five, one group per time",
    ),
    Column(
        name="nodes",
        kind="list",
        unit="m",
        meaning="x, y and z of the cable's nodes from the grip to the free end, time by time",
    ),
    Column(name="attempt", kind="int64", unit="-", meaning="failed attempts before this one"),
    Column(name="rig", kind="string", unit="-", meaning="description of the rig, as JSON"),
    # Where every cast has its own cable.
    *(
        Column(
            name=name,
            kind="float64",
            unit=unit,
            meaning=f"{name.replace('_', ' ')} of the simulated cable",
        )
        for name, unit in PARAM_UNITS.items()
    ),
)

ACTION_COLUMNS = ("theta1", "theta2", "r2", "psi")
ENDPOINT_COLUMNS = ("endpoint_x", "endpoint_y")
EXTENT_COLUMNS = ("x_min", "x_max", "y_min", "y_max")


def arrow_schema(column_names: tuple[str, ...] = ()):
    """Return the Arrow schema of a shard.

    Args:
        column_names: Names of the optional columns that the dataset has.
    """
    import pyarrow as pa

    kinds = {
        "int64": pa.int64(),
        "float64": pa.float64(),
        "string": pa.string(),
        "list": pa.list_(pa.float64()),
    }
    optional = [column for column in OPTIONAL_COLUMNS if column.name in column_names]
    return pa.schema(
        [
            pa.field(column.name, kinds[column.kind], metadata={"unit": column.unit})
            for column in (*COLUMNS, *optional)
        ]
    )


def track_extent(endpoint_xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bounding box of the free end's path.

    Args:
        endpoint_xy: Path of the free end [m], shape [row, step, 2]; NaN where it was not seen.

    Returns:
        Smallest x, largest x, smallest y and largest y [m], shape [row, 4]; NaN in rows where the
        free end was never seen.
    """
    missing = ~np.isfinite(endpoint_xy)
    low = np.where(missing, np.inf, endpoint_xy).min(axis=1)
    high = np.where(missing, -np.inf, endpoint_xy).max(axis=1)
    extent = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=-1)
    return np.where(np.isfinite(extent), extent, np.nan)


def check_columns(columns: Mapping[str, Any]) -> int:
    """Return the number of rows of some columns.

    Raises:
        DatasetError: A column is missing, or two differ in length.
    """
    if missing := [column.name for column in COLUMNS if column.name not in columns]:
        raise DatasetError(f"rows of a dataset lack the columns {missing}")
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DatasetError(f"columns of a dataset differ in length: {lengths}")
    return lengths["index"]

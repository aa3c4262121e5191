"""Trials of a dataset as motions and tracks."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.limits import JOINT_COUNT
from cablecast.datasets.reader import Dataset
from cablecast.datasets.schema import CONTROLLER_COLUMNS
from cablecast.errors import DatasetError, InputError
from cablecast.motion.grip_path import CHANNELS
from cablecast.motion.joint_path import JointPath
from cablecast.track import ControllerLog, EndpointTrack, TrialStatus


def trial_track(dataset: Dataset, row: int) -> EndpointTrack:
    """Return the track that the rig reported for one trial.

    Args:
        dataset: Trials on a rig.
        row: Index of the trial.

    Raises:
        DatasetError: The dataset holds no tracks.
    """
    times, x, y = (_values(dataset, name, row) for name in ("times", "track_x", "track_y"))
    if times is None or x is None or y is None:
        raise DatasetError(f"{dataset.path or 'the dataset'} holds no track of trial {row}")
    return EndpointTrack(
        times=times,
        endpoint_xy=np.stack([x, y], axis=-1),
        status=TrialStatus.from_code(str(dataset.status[row])),
        nodes=_nodes(dataset, row, len(times)),
        joint_path=measured_joints(dataset, row),
        controller_log=controller_log(dataset, row),
    )


def measured_joints(dataset: Dataset, row: int) -> JointPath | None:
    """Return the measured joints of one trial; None if the rig reported none.

    Args:
        dataset: Trials on a rig.
        row: Index of the trial.
    """
    return _joint_path(dataset, "actual_times", "actual_q", row)


def controller_log(dataset: Dataset, row: int) -> ControllerLog | None:
    """Return what the arm's controller reported of one trial; None where it was not recorded.

    Args:
        dataset: Trials on a rig.
        row: Index of the trial.
    """
    values = [_values(dataset, name, row) for name in CONTROLLER_COLUMNS]
    times, target_q, speed_scaling, safety_bits = values
    if times is None or target_q is None or speed_scaling is None or safety_bits is None:
        return None
    try:
        return ControllerLog(
            times=times,
            target_q=target_q.reshape(-1, JOINT_COUNT),
            speed_scaling=speed_scaling,
            safety_bits=safety_bits,
        )
    except (ValueError, InputError) as error:
        raise DatasetError(f"trial {row} of {dataset.path or 'the dataset'}: {error}") from None


def commanded_joints(dataset: Dataset, row: int) -> JointPath | None:
    """Return the commanded joints of one trial; None if the motion had none.

    Args:
        dataset: Trials on a rig.
        row: Index of the trial.
    """
    return _joint_path(dataset, "joint_times", "joint_q", row)


def measured_poses(
    dataset: Dataset, row: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the tracked poses of the grip in one trial; None if it was not tracked.

    Args:
        dataset: Trials that were imported.
        row: Index of the trial.

    Returns:
        Times [s], shape [sample], and x, y, z [m], yaw and pitch [rad], shape [sample, 5].
    """
    times, poses = (_values(dataset, name, row) for name in ("grip_times", "grip_pose"))
    if times is None or poses is None or not len(times):
        return None
    if len(poses) != len(CHANNELS) * len(times):
        raise DatasetError(
            f"trial {row} of {dataset.path or 'the dataset'} has {len(poses)} grip coordinates for "
            f"{len(times)} times: they must be five for each"
        )
    return times, poses.reshape(-1, len(CHANNELS))


def trial_rig(dataset: Dataset, row: int) -> dict[str, Any]:
    """Return the rig's description at one trial.

    Args:
        dataset: Trials on a rig.
        row: Index of the trial.
    """
    texts = dataset.extra.get("rig")
    return dict(dataset.info["settings"]["rig"]) if texts is None else json.loads(texts[row])


def _values(dataset: Dataset, name: str, row: int):
    column = dataset.extra.get(name)
    if column is None or column[row] is None:
        return None
    return np.asarray(column[row], dtype=float)


def _nodes(dataset: Dataset, row: int, sample_count: int):
    """Return the cable's nodes at the samples of a track, where they were stored."""
    nodes = _values(dataset, "nodes", row)
    if nodes is None:
        return None
    if not sample_count or len(nodes) % (3 * sample_count):
        raise DatasetError(
            f"trial {row} of {dataset.path or 'the dataset'} has {len(nodes)} node coordinates "
            f"for {sample_count} times: they must be three for each node"
        )
    return nodes.reshape(sample_count, -1, 3)


def _joint_path(dataset: Dataset, times_name: str, q_name: str, row: int) -> JointPath | None:
    times, q = _values(dataset, times_name, row), _values(dataset, q_name, row)
    if times is None or q is None or not len(times):
        return None
    if not (np.all(np.diff(times) > 0) and np.all(np.isfinite(q))):
        raise DatasetError(
            f"trial {row} of {dataset.path or 'the dataset'} has joints that are not finite or "
            "times that do not rise"
        )
    if len(q) != JOINT_COUNT * len(times):
        raise DatasetError(
            f"trial {row} of {dataset.path or 'the dataset'} has {len(q)} joint angles for "
            f"{len(times)} times: they must be six for each"
        )
    q = q.reshape(-1, JOINT_COUNT)
    # Rates are not stored; any reader can take differences of the angles.
    qd = np.asarray(np.gradient(q, times, axis=0)) if len(times) > 1 else np.zeros_like(q)
    return JointPath(times=times, q=q, qd=qd)

"""One meaning of "off the table" for all that judge how a cast ended."""

import csv

import numpy as np
import pytest

from cablecast.cast import TrialStatus
from cablecast.data.recordings import read_recordings
from cablecast.rigs.engine import status_of
from cablecast.setup import Setup
from cablecast.vision.tracker import trial_status

SETUP = Setup()
EDGE = SETUP.workspace.half_width
TIMES = np.arange(0.0, 2.001, 0.1)
Y = 0.9


def swept(x_max, x_end):
    """Return a path that goes out to x_max and comes to rest at x_end, shape [sample, 2]."""
    x = np.interp(TIMES, [0.0, 0.7, 1.4, 2.0], [0.0, x_max, x_end, x_end])
    return np.stack([x, np.full_like(x, Y)], axis=1)


PATHS = {
    "stays on the table": (swept(0.8 * EDGE, 0.5 * EDGE), TrialStatus.OK),
    "passes over the edge and comes back": (swept(1.2 * EDGE, 0.5 * EDGE), TrialStatus.OK),
    "rests beyond the edge": (swept(1.2 * EDGE, 1.1 * EDGE), TrialStatus.OFF_TABLE),
}


@pytest.mark.parametrize(("path", "status"), PATHS.values(), ids=PATHS)
def test_camera_simulator_and_recordings_judge_a_cast_alike(path, status, tmp_path):
    assert status_of(path, SETUP.workspace) is status
    assert trial_status(TIMES, path, path, SETUP.workspace) is status
    file = tmp_path / "casts.csv"
    with file.open("w", newline="", encoding="utf-8") as opened:
        writer = csv.writer(opened)
        writer.writerow(
            ["cast", "time_s", "x_m", "y_m", "theta1_rad", "theta2_rad", "r2_m", "psi_rad"]
        )
        for time, (x, y) in zip(TIMES, path, strict=True):
            writer.writerow(["a", time, x, y, -0.5, 0.5, 0.6, 0.5])
    assert read_recordings(file, SETUP)[0].cast.status is status


def test_a_cast_that_is_not_seen_again_after_it_left_is_off_the_table():
    path = swept(1.2 * EDGE, 1.1 * EDGE)
    path[TIMES > 0.75] = np.nan
    assert trial_status(TIMES, path, path, SETUP.workspace) is TrialStatus.OFF_TABLE

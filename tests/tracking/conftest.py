"""The camera over the virtual table, which films for the tests of the tracker."""

import pytest

from cablecast.setup import Setup
from cablecast.workspace import Workspace


@pytest.fixture(scope="session")
def workspace() -> Workspace:
    return Workspace()


@pytest.fixture(scope="session")
def sensor_camera():
    """Return the camera that the virtual rig sees with, which is made once in a process."""
    pytest.importorskip("cv2")
    from cablecast.rigs.virtual.sensing import SensorCamera

    return SensorCamera(Setup())


@pytest.fixture(scope="session")
def virtual_camera(sensor_camera):
    """Return the camera over the virtual table."""
    return sensor_camera.camera


@pytest.fixture(scope="session")
def calibration(sensor_camera):
    """Return its calibration, from pictures of a board and of the tags."""
    return sensor_camera.calibration

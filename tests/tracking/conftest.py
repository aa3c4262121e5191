"""The camera over the virtual table, which films for the tests of the tracker."""

import pytest

from cablecast.workspace import Workspace


@pytest.fixture(scope="session")
def workspace() -> Workspace:
    return Workspace()


@pytest.fixture(scope="session")
def virtual_camera():
    """Return the camera over the virtual table."""
    pytest.importorskip("cv2")
    from cablecast.rigs.virtual.camera import VirtualCamera

    return VirtualCamera()


@pytest.fixture(scope="session")
def calibration(virtual_camera):
    """Calibrate that camera from pictures of a board and of the tags."""
    from cablecast.rigs.virtual.camera_calibrate import calibrate_virtual_camera

    return calibrate_virtual_camera(virtual_camera)

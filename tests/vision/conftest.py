"""The table that the tests of the tracker look at."""

import pytest

from cablecast.workspace import Workspace


@pytest.fixture(scope="session")
def workspace() -> Workspace:
    return Workspace()

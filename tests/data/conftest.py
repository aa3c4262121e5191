import pathlib
import sys

import pytest

# Tests are imported without their folder on the path; the engine is also run as a script.
sys.path.insert(0, str(pathlib.Path(__file__).parent))


@pytest.fixture(scope="session")
def unbroken(tmp_path_factory):
    """Simulate a dataset in one go; tests must not change it."""
    from stick_engine import simulate

    path = tmp_path_factory.mktemp("unbroken") / "d_sim"
    simulate(path)
    return path

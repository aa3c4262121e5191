import pytest
from tests.data.stick_engine import simulate


@pytest.fixture(scope="session")
def unbroken(tmp_path_factory):
    """Simulate a dataset in one go; tests must not change it."""
    path = tmp_path_factory.mktemp("unbroken") / "d_sim"
    simulate(path)
    return path

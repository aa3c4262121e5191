import pytest
from tests.data.stick_engine import simulate

from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup


@pytest.fixture(scope="session")
def unbroken(tmp_path_factory):
    """Simulate a dataset in one go; tests must not change it."""
    path = tmp_path_factory.mktemp("unbroken") / "d_sim"
    simulate(path)
    return path


@pytest.fixture(scope="session")
def casts(tmp_path_factory):
    """Collect three casts in a coarse engine; tests must not change them."""
    setup = Setup()
    rig = RigEngine(EngineWarp(segment_count=10, dt=2e-3), setup)
    out = tmp_path_factory.mktemp("casts") / "tune-data"
    return collect_dataset(out, rig, setup, purpose="tune", count=3)

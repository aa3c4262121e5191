import dataclasses
import pathlib

import pytest

from cablecast.setup import Setup, load_setup

TWIN_FILE = pathlib.Path(__file__).parents[4] / "examples" / "twin.yaml"


@pytest.fixture(scope="session")
def twin_setup() -> Setup:
    """Read the lab file of the twin that comes with cablecast, without its camera."""
    return dataclasses.replace(load_setup(TWIN_FILE), camera=None)

import pathlib
import sys

import pytest

# Tests are imported without their folder on the path.
sys.path.insert(0, str(pathlib.Path(__file__).parent))


@pytest.fixture(scope="module")
def one_core():
    """Keep torch to one thread: problems as small as these are slower on several."""
    from cablecast.learning.checkpoint import one_thread

    with one_thread():
        yield

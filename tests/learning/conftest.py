import pytest


@pytest.fixture(scope="module")
def one_core():
    """Keep torch to one thread: problems as small as these are slower on several."""
    from cablecast.learning.checkpoint import one_thread

    with one_thread():
        yield

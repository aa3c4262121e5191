import os
import subprocess
import sys

import pytest

from cablecast.errors import MissingExtraError
from cablecast.learning.checkpoint import import_torch, one_thread

torch = pytest.importorskip("torch")


def test_threads_that_wait_leave_the_processor_to_others():
    # libgomp prints, when loaded, what it has read.
    code = "from cablecast.learning.checkpoint import check_device; check_device('cpu')"
    environment = {k: v for k, v in os.environ.items() if k != "OMP_WAIT_POLICY"}
    done = subprocess.run(
        [sys.executable, "-c", code + "; import os; assert 'OMP_WAIT_POLICY' not in os.environ"],
        env=environment | {"OMP_DISPLAY_ENV": "TRUE"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    if "OMP_WAIT_POLICY" not in done.stderr:
        pytest.skip("torch uses no OpenMP here")
    assert "OMP_WAIT_POLICY = 'PASSIVE'" in done.stderr


def test_torch_has_one_thread_inside_the_block_and_its_own_number_after_it():
    before = torch.get_num_threads()
    with one_thread():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before
    with pytest.raises(RuntimeError, match="inside"), one_thread():
        raise RuntimeError("inside")
    assert torch.get_num_threads() == before


def test_a_missing_torch_is_named_with_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"the Gaussian process needs torch.*\[learn\]"):
        import_torch("the Gaussian process")

import pytest

from cablecast.engines.warp_ import ahead
from cablecast.engines.warp_.features import Features


@pytest.mark.slow
def test_a_process_compiles_a_kernel_while_this_one_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(ahead, "core_count", lambda: 2)
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    process = ahead.compile_ahead(Features(table=False))
    assert process.poll() is None
    assert process.wait(120) == 0
    (compiled,) = tmp_path.rglob("*.o")
    assert compiled.stat().st_size > 10_000


def test_a_single_core_compiles_when_it_comes_to_it(monkeypatch):
    monkeypatch.setattr(ahead, "core_count", lambda: 1)
    assert ahead.compile_ahead(Features()) is None

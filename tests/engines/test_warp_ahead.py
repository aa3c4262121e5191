import pytest

from cablecast.engines.warp_ import rollout as ahead
from cablecast.engines.warp_.world import Features


@pytest.mark.slow
def test_a_process_compiles_a_kernel_while_this_one_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(ahead, "core_count", lambda: 2)
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    # A kernel of one lane is compiled in a quarter of the time, and without optimization sooner.
    one_lane = ahead._COMPILE.replace('LANE_COUNT_CPU["single"]', "1")
    quick = "import warp; warp.config.mode = 'debug'" + one_lane
    monkeypatch.setattr(ahead, "_COMPILE", quick)
    process = ahead.compile_ahead(Features(table=False))
    assert process.poll() is None
    assert process.wait(600) == 0
    (compiled,) = tmp_path.rglob("*.o")
    assert compiled.stat().st_size > 10_000


@pytest.mark.parametrize("change", [("core_count", lambda: 1), ("sys.executable", "/no/python")])
def test_without_another_process_a_kernel_is_compiled_when_it_is_needed(change, monkeypatch):
    monkeypatch.setattr(ahead, "core_count", lambda: 2)
    name, value = change
    monkeypatch.setattr(f"{ahead.__name__}.{name}", value)
    assert ahead.compile_ahead(Features()) is None

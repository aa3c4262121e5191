import pytest

from cablecast.pipeline import check


@pytest.fixture
def few_casts(monkeypatch):
    """Judge a laboratory by few casts of a coarse cable, and few places of polar ones."""
    few = {"CAST_COUNT": 100, "CALM_COUNT": 25, "POLAR_STEP": (0.4, 0.4), "SEGMENT_COUNT": 10}
    for name, value in few.items():
        monkeypatch.setattr(check, f"_{name}", value)
    kept = check._believed, check._polar_landings
    for cache in kept:
        cache.cache_clear()
    yield
    for cache in kept:
        cache.cache_clear()

"""Order and fixtures of all tests."""

import dataclasses
import functools
import os
import signal
import subprocess
import sys

import pytest

# Several tests run at once, so threads of one test would only wait for those of another. Set before
# numpy and torch are imported; processes that the tests start inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """Start one worker more than there are cores: tests of robots and clusters mostly wait."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items):
    """Let the files with slow tests begin, so that no worker is left alone with one of them."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(autouse=True, scope="session")
def interrupts():
    """Let SIGINT raise KeyboardInterrupt: a process that runs tests in parallel ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True, scope="session")
def kernels_compile_sooner():
    """Inline less in the kernels that tests share with no command: they compile in half the time.

    They are a tenth slower, which the few worlds of a test do not show.
    """
    from cablecast.engines.warp_ import rollout

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "INLINE_COST", 20_000)
        yield


@pytest.fixture(scope="session")
def dead_process():
    """Return the number of a process that is gone."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


@pytest.fixture(scope="session")
def make_engines_coarse():
    """Return a function that makes engines coarse by default while a patch lasts.

    A coarse cable takes a twentieth of the time. So are those that calibration casts are chosen
    with, and those of cables that no cast was fitted to.
    """
    from cablecast.engines.warp_.engine import EngineWarp
    from cablecast.tuning.fit import FitConfig

    build = EngineWarp.__init__
    coarse = (10, 2e-3, *build.__defaults__[2:])
    fit = functools.partial(FitConfig, coarse_segment_count=10, coarse_dt=2e-3)

    def apply(patch):
        patch.setattr(build, "__defaults__", coarse)
        for module in ("pipeline.collect", "tuning.tuned"):
            patch.setattr(f"cablecast.{module}.FitConfig", fit)

    return apply


@pytest.fixture
def small_fit():
    """Return settings of a fit of a coarse cable that ends after a step of each kind."""
    from cablecast.tuning.fit import FitConfig

    return FitConfig(
        start_count=2,
        rough_iterations=1,
        kept_start_count=1,
        coarse_iterations=1,
        fine_iterations=1,
        coarse_segment_count=10,
        coarse_dt=2e-3,
        ensemble_iterations=1,
    )


@pytest.fixture
def coarse_engine(make_engines_coarse, monkeypatch):
    """Let engines simulate a coarse cable where they are not told otherwise."""
    make_engines_coarse(monkeypatch)


@pytest.fixture
def few_casts(monkeypatch):
    """Judge a laboratory by few casts of a coarse cable, and few places of polar ones."""
    from cablecast.pipeline import check

    few = {"CAST_COUNT": 100, "CALM_COUNT": 25, "POLAR_STEP": (0.4, 0.4), "SEGMENT_COUNT": 10}
    for name, value in few.items():
        monkeypatch.setattr(check, f"_{name}", value)
    kept = check._believed, check._polar_landings
    for cache in kept:
        cache.cache_clear()
    yield
    for cache in kept:
        cache.cache_clear()


@pytest.fixture
def brief_adaptation(monkeypatch):
    """Let networks take ten passes over real casts instead of hundreds."""
    pytest.importorskip("torch")
    from cablecast.learning.network import FINE_TUNING, REAL_ONLY, fine_tune, train_on_real

    for function, config in ((train_on_real, REAL_ONLY), (fine_tune, FINE_TUNING)):
        brief = dataclasses.replace(config, epochs=10, patience=10)
        name = f"cablecast.pipeline.train.{function.__name__}"
        monkeypatch.setattr(name, functools.partial(function, config=brief))


@pytest.fixture(scope="session")
def leave_figures_blank():
    """Return a function that replaces drawing by blank pictures while a patch lasts."""
    pytest.importorskip("matplotlib")

    def savefig(figure, file, *, format, **_):
        from PIL import Image

        if format == "svg":
            file.write(b'<svg xmlns="http://www.w3.org/2000/svg"/>')
        else:
            Image.new("RGB", (1, 1)).save(file, format=format)

    return lambda patch: patch.setattr("matplotlib.figure.Figure.savefig", savefig)


@pytest.fixture
def blank_figures(leave_figures_blank, monkeypatch):
    """Leave figures blank where nothing is said about their looks."""
    leave_figures_blank(monkeypatch)


@pytest.fixture(scope="session")
def sensor_camera():
    """Return the camera that the virtual rig sees with, which is made once in a process."""
    pytest.importorskip("cv2")
    from cablecast.rigs.virtual.sensing import SensorCamera
    from cablecast.setup import Setup

    return SensorCamera(Setup())


@pytest.fixture(scope="session")
def virtual_camera(sensor_camera):
    """Return the camera over the virtual table."""
    return sensor_camera.camera


@pytest.fixture(scope="session")
def calibration(sensor_camera):
    """Return its calibration, from pictures of a board and of the tags."""
    return sensor_camera.calibration

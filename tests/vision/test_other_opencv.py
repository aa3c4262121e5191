"""Tags and boards under the other major version of OpenCV, which `make install` puts aside."""

import os
import pathlib
import subprocess
import sys

import pytest
from tools.try_opencv import run

OTHER = pathlib.Path(os.environ.get("CABLECAST_OPENCV", pathlib.Path(sys.prefix) / "opencv-4"))
TESTS = ("tests/vision/test_tags.py", "tests/vision/test_lens_fit.py")


@pytest.mark.skipif(not OTHER.is_dir(), reason="`make install` puts OpenCV 4 into .venv/opencv-4")
def test_tags_and_lenses_are_found_with_opencv_4_as_with_5():
    code = "import cv2; print(cv2.__version__)"
    env = {**os.environ, "PYTHONPATH": str(OTHER)}
    said = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert said.stdout.startswith("4.")
    assert run(OTHER, TESTS) == 0

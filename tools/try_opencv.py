"""Run the tests of camera and vision with another version of OpenCV than the one installed.

    python tools/try_opencv.py 4.14.0.94

puts that version next to the environment, into build/opencv-VERSION, where nothing else finds it.
"""

import argparse
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).parents[1]
TESTS = ("tests/camera", "tests/vision", "tests/cli/test_calibrate.py", "tests/cli/test_track.py")


def main(arguments: list[str] | None = None) -> int:
    """Run the tests of camera and vision with another version of OpenCV."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("version", help="version of opencv-python-headless, such as 4.14.0.94")
    parser.add_argument("tests", nargs="*", default=TESTS, help="tests; all of them if not given")
    args = parser.parse_args(arguments)
    folder = ROOT / "build" / f"opencv-{args.version}"
    if not folder.is_dir():
        package = f"opencv-python-headless=={args.version}"
        words = ["install", "--quiet", "--no-deps", "--target", str(folder), package]
        subprocess.run([sys.executable, "-m", "pip", *words], check=True)
    return run(folder, args.tests)


def run(folder: pathlib.Path, tests: list[str] | tuple[str, ...]) -> int:
    """Run tests with the OpenCV in a folder, and return the exit status."""
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
    return subprocess.run(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": path}).returncode


if __name__ == "__main__":
    sys.exit(main())

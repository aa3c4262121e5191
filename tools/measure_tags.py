"""Measure how tags are found on real pictures and on drawn ones.

    python tools/measure_tags.py

prints a row for each way of finding them: tags that are missed, and how far corners are off; and a
row for each size of a tag on the cable's end: how often it is read, at rest and blurred.
"""

import argparse
import json
import pathlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.tags import FAMILY
from cablecast.conventions import Array
from cablecast.vision.tags import detect_tags, load_cv2, tag_cells, tag_picture

PICTURES = pathlib.Path(__file__).parents[1] / "tests/vision/pictures"
SIZES = (20, 30, 45, 70, 110)
"""Sides of the drawn tags [px]."""
SMALL_SIZES = (12, 14, 16, 18)
"""Sides of drawn tags that are hard to read [px]."""

END_SIZES, END_FAMILY = (12, 14, 16, 18, 20, 24, 30), "4X4_50"
"""Sides of the drawn tags on a cable's end [px], and their family."""
BLURS = (0.0, 0.5, 1.0, 1.5)
"""Ways of such a tag during the exposure, in its cells."""

Picture = tuple[NDArray[np.uint8], dict[int, Array]]


def real_pictures() -> dict[str, Picture]:
    """Return the real pictures, and the corners that the AprilTag library finds in each [px]."""
    cv2, found = load_cv2(), json.loads((PICTURES / "tags.json").read_text())
    # That library counts from the corner of the first pixel, OpenCV from its centre.
    return {
        name: (
            cv2.imread(str(PICTURES / name), cv2.IMREAD_GRAYSCALE),
            {int(tag_id): np.array(quad) - 0.5 for tag_id, quad in tags.items()},
        )
        for name, tags in found.items()
    }


def drawn_picture(size: float, seed: int, family: str = FAMILY) -> Picture:
    """Draw a tag of a size [px], turned and tilted, with blur and noise; and its true corners."""
    cv2, rng, width, fine, cell = load_cv2(), np.random.default_rng(seed), 240, 8, 20
    tag_id = int(rng.integers(30))
    picture = tag_picture(tag_id, cell, family).astype(np.float32)
    near, far = cell - 0.5, picture.shape[0] - cell - 0.5
    source = np.array([[near, near], [far, near], [far, far], [near, far]], np.float32)
    turn, tilt, about = rng.uniform(0.0, [2 * np.pi, 0.7, 2 * np.pi])
    R = cv2.Rodrigues(tilt * np.array([np.cos(about), np.sin(about), 0.0]))[0]
    R = R @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    square = size / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    points = square @ R.T + [0.0, 0.0, 1000.0]
    corners = points[:, :2] / points[:, 2:] * 1000.0 + width / 2 + rng.uniform(-1.0, 1.0, 2)
    H = cv2.getPerspectiveTransform(source, ((corners + 0.5) * fine - 0.5).astype(np.float32))
    extent = (width * fine, width * fine)
    tag = cv2.warpPerspective(0.8 * picture + 25.0, H, extent)
    cover = cv2.warpPerspective(np.ones_like(picture), H, extent)
    ground = cv2.GaussianBlur(rng.uniform(120, 200, (width, width)).astype(np.float32), (0, 0), 5)
    mixed = cv2.resize(ground, extent) * (1 - cover) + tag * cover
    image = cv2.GaussianBlur(
        cv2.resize(mixed, (width, width), interpolation=cv2.INTER_AREA), (0, 0), 0.7
    )
    image = np.clip(image + rng.normal(0.0, 3.0, image.shape), 0, 255).astype(np.uint8)
    return image, {tag_id: corners}


def corner_errors(found: Array, truth: Array) -> Array:
    """Return the distances of a tag's corners, whichever it starts with and turns to [px], [4]."""
    orders = [np.roll(found, s, axis=0)[::way] for s in range(4) for way in (1, -1)]
    return min((np.linalg.norm(o - truth, axis=1) for o in orders), key=np.max)


def measure(
    pictures: list[Picture], detect: Callable[[NDArray[np.uint8]], dict[int, Array]]
) -> tuple[int, Array]:
    """Return the number of tags that are missed, and the corners' errors [px]."""
    missed, errors = 0, []
    for image, truth in pictures:
        found = detect(image)
        missed += len(truth.keys() - found.keys())
        errors += [corner_errors(found[i], truth[i]) for i in truth.keys() & found.keys()]
    return missed, np.concatenate(errors)


def _with(**settings: float) -> Callable[[NDArray[np.uint8]], dict[int, Array]]:
    """Return OpenCV's own detection with some of its settings."""
    cv2 = load_cv2()
    parameters = cv2.aruco.DetectorParameters()
    for name, value in settings.items():
        setattr(parameters, name, value)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def detect(image: NDArray[np.uint8]) -> dict[int, Array]:
        quads, ids, _ = detector.detectMarkers(image)
        numbers = [] if ids is None else ids.ravel().tolist()
        return {i: q.reshape(4, 2) for i, q in zip(numbers, quads, strict=True)}

    return detect


def end_tags(size: float) -> tuple[list[float], float]:
    """Return how often a tag of a size [px] is read after each blur [%], and its error [px]."""
    cv2, found, errors = load_cv2(), np.zeros(len(BLURS)), []
    pictures = [drawn_picture(size, seed, END_FAMILY) for seed in range(40)]
    for k, cells in enumerate(BLURS):
        way = cells * size / tag_cells(END_FAMILY)
        for seed, (image, truth) in enumerate(pictures):
            turn = np.random.default_rng(seed).uniform(0.0, np.pi)
            steps = np.linspace(-0.5, 0.5, 9)[:, None] * way * [np.cos(turn), np.sin(turn)]
            moved = [
                cv2.warpAffine(
                    image, np.array([[1, 0, u], [0, 1, v]]), image.shape, borderMode=1
                ).astype(float)
                for u, v in steps
            ]
            seen = detect_tags(np.mean(moved, axis=0).astype(np.uint8), END_FAMILY)
            for tag_id, corners in truth.items():
                if tag_id in seen:
                    found[k] += 1
                    centres = seen[tag_id].mean(axis=0) - corners.mean(axis=0)
                    errors += [float(np.linalg.norm(centres))] if not cells else []
    return (100 * found / len(pictures)).tolist(), float(np.sqrt(np.mean(np.square(errors))))


def main(arguments: list[str] | None = None) -> None:
    """Measure how tags are found on real pictures and on drawn ones."""
    argparse.ArgumentParser(description=main.__doc__).parse_args(arguments)
    fine = {"adaptiveThreshWinSizeStep": 4, "perspectiveRemovePixelPerCell": 5}
    corners = {"cornerRefinementMethod": 1, "cornerRefinementWinSize": 6}
    corners |= {"relativeCornerRefinmentWinSize": 0.6, "cornerRefinementMaxIterations": 60}
    ways = {
        "OpenCV's usual": _with(),
        "corners refined": _with(**corners),
        "finer windows and cells": _with(**corners, **fine),
        "more bits corrected": _with(**corners, errorCorrectionRate=0.9),
        "OpenCV's AprilTag corners": _with(cornerRefinementMethod=3),
        "cablecast: these, and edges": detect_tags,
    }
    real = list(real_pictures().values())
    drawn = [[drawn_picture(size, seed) for seed in range(20)] for size in SIZES]
    print(f"OpenCV {load_cv2().__version__}: corners against the AprilTag library, and the truth")
    small = [drawn_picture(size, seed) for size in SMALL_SIZES for seed in range(20)]
    print(f"| way | missed of 50 | median, 90 % [px] | missed of {len(small)} small | ", end="")
    print(" | ".join(f"{size} px" for size in SIZES) + " |")
    print("|---" * (4 + len(SIZES)) + "|")
    for name, detect in ways.items():
        missed, errors = measure(real, detect)
        row = f"| {name} | {missed} | {np.median(errors):.2f}, {np.quantile(errors, 0.9):.2f} "
        row += f"| {measure(small, detect)[0]} "
        rms = [np.sqrt(np.mean(measure(pictures, detect)[1] ** 2)) for pictures in drawn]
        print(row + "".join(f"| {value:.2f} " for value in rms) + "|")
    print(f"\n| side of a tag of {END_FAMILY} | centre [px] | ", end="")
    print(" | ".join(f"read after {cells:g} cells [%]" for cells in BLURS) + " |")
    print("|---" * (2 + len(BLURS)) + "|")
    for size in END_SIZES:
        shares, error = end_tags(size)
        print(f"| {size} px | {error:.2f} | " + " | ".join(f"{s:.0f}" for s in shares) + " |")


if __name__ == "__main__":
    main()

"""Put the figures of a reproduction into docs/images, scaled to a page and to few colours.

python tools/make_pictures.py runs/reproduce
"""

import argparse
import pathlib

from PIL import Image

IMAGES = pathlib.Path(__file__).parents[1] / "docs" / "images"
WIDTH = 1100
COLORS = 96

SOURCES = {
    "coverage.png": "select/coverage.png",
    "tracks.png": "tune/tracks.png",
    "repeatability.png": "repeat/repeatability.png",
    "landings.png": "evaluate-fine-tuning/landings.png",
}


def main() -> None:
    """Write each picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("run", type=pathlib.Path, help="folder of `cablecast reproduce`")
    parser.add_argument("--cable", default="cable_1")
    arguments = parser.parse_args()
    for name, source in SOURCES.items():
        with Image.open(arguments.run / arguments.cable / source) as picture:
            height = round(picture.height * WIDTH / picture.width)
            scaled = picture.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        path = IMAGES / name
        scaled.quantize(COLORS).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()

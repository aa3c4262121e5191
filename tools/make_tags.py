"""Write pictures of the tags on a table, to print, and their layout as a file to edit.

    python tools/make_tags.py tags

The layout is that of the paper's table, or of the table in a lab file. Measure where you stick each
tag, and put your own places into tags.yaml.
"""

import argparse
import pathlib
import sys

from cablecast.camera.tags import FAMILY, TAG_COUNTS, default_layout
from cablecast.errors import CablecastError
from cablecast.files import write_bytes
from cablecast.setup import load_setup
from cablecast.vision.tags import load_cv2, tag_picture
from cablecast.workspace import Workspace


def main(arguments: list[str] | None = None) -> None:
    """Write pictures of the tags on a table, to print, and their layout as a file to edit."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=pathlib.Path, help="folder to write to")
    parser.add_argument("--setup", type=pathlib.Path, help="lab file; the paper's if not given")
    parser.add_argument(
        "--family", default=FAMILY, help=f"one of {', '.join(TAG_COUNTS)}; {FAMILY} if not given"
    )
    args = parser.parse_args(arguments)
    try:
        workspace = Workspace() if args.setup is None else load_setup(args.setup).workspace
        layout = default_layout(workspace, args.family)
        cv2 = load_cv2()
    except CablecastError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    for tag in layout.tags:
        encoded = cv2.imencode(".png", tag_picture(tag.id, family=layout.family))[1]
        write_bytes(args.out / f"tag-{tag.id:02}.png", encoded.tobytes())
    layout.save(args.out / "tags.yaml")
    print(f"{len(layout.tags)} tags and tags.yaml are in {args.out}: print them so that the black")
    print(
        f"square measures {100 * layout.tags[0].size:.3g} cm, and put your own places in tags.yaml"
    )


if __name__ == "__main__":
    main()

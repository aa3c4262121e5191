"""Words that lie on the table, as small pictures.

A browser that draws in software has them for less than the labels of viser (docs/view.md).
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.view.palette import Color

if TYPE_CHECKING:
    import viser

_PLATE = 190  # Of 255: what lies below shines through a little.
_PIXELS = 48  # Height of a line, which is enough for a window that shows one table.


def text_image(text: str, color: Color, plate: Color | None = None) -> NDArray[np.uint8]:
    """Return a line of text, cut to its width, RGBA, shape [v, u, 4].

    Args:
        text: Text.
        color: Colour of the letters.
        plate: Colour behind the letters; nothing is behind them where None.
    """
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(size=0.8 * _PIXELS)
    width = round(font.getlength(text)) + _PIXELS // 2
    behind = (*color, 0) if plate is None else (*plate, _PLATE)
    image = Image.new("RGBA", (width, _PIXELS), behind)
    ImageDraw.Draw(image).text((width / 2, _PIXELS / 2), text, (*color, 255), font, anchor="mm")
    return np.asarray(image)


def add_text(
    server: "viser.ViserServer",
    name: str,
    text: str,
    position: tuple[float, float, float],
    color: Color,
    height: float = 0.08,
    plate: Color | None = None,
) -> Any:
    """Lay a line of text on the table, to be read from the robot's side.

    Args:
        server: Server of the page.
        name: Name in the tree of the scene.
        text: Text.
        position: Middle of the line [m].
        color: Colour of the letters.
        height: Height of the line [m].
        plate: Colour behind the letters; nothing is behind them where None.
    """
    image = text_image(text, color, plate)
    return server.scene.add_image(
        name,
        image,
        height * image.shape[1] / image.shape[0],
        height,
        format="png",
        # An image lies in its own x-y plane with y down, so it is turned about x.
        wxyz=(0.0, 1.0, 0.0, 0.0),
        position=position,
        cast_shadow=False,
        receive_shadow=False,
    )

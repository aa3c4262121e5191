"""Controls of the camera: its latest picture, where the rig has one."""

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import CablecastError
from cablecast.view.figure import set_changed
from cablecast.view.host import Host

_EVERY = 0.5
"""Time between two looks at the camera [s]."""

WIDTH = 480
"""Largest width of the picture that is sent [pixel]."""


class CameraControls:
    """The picture of the rig's camera; nothing for a rig without one.

    A thread of its own asks the rig, also while the arm moves.

    Args:
        host: Page that the controls act on.
    """

    def __init__(self, host: Host):
        self._source = getattr(host.desk.rig, "picture", None)
        self._last: NDArray[np.uint8] | None = None
        self._ended = threading.Event()
        gui: Any = host.server.gui
        self._folder = gui.add_folder("Camera", visible=False)
        with self._folder:
            empty = np.zeros((9, 16, 3), dtype=np.uint8)
            self._image = gui.add_image(empty, format="jpeg", jpeg_quality=80)
            self._text = gui.add_markdown("", visible=False)
        if self._source is not None:
            threading.Thread(target=self._watch, name="camera", daemon=True).start()

    def close(self) -> None:
        """Look no more."""
        self._ended.set()

    def look(self) -> None:
        """Show the latest picture, or why there is none."""
        if self._source is None:
            return
        try:
            picture, trouble = self._source(), ""
        except CablecastError as error:
            picture, trouble = None, str(error)
        set_changed(self._text, "content", trouble)
        set_changed(self._text, "visible", bool(trouble))
        if picture is not None and picture is not self._last:
            self._last = picture
            self._image.image = shrunk(picture)
        set_changed(self._folder, "visible", self._last is not None or bool(trouble))

    def _watch(self) -> None:
        while not self._ended.wait(_EVERY):
            self.look()


def shrunk(picture: NDArray[np.uint8], width: int = WIDTH) -> NDArray[np.uint8]:
    """Return a picture as RGB, at most so wide.

    Args:
        picture: Picture, BGR, shape [v, u, 3].
        width: Largest width [pixel].
    """
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(picture[..., ::-1]))
    return np.asarray(image.reduce(max(1, -(-image.width // width))))

"""Grabber: the process that reads a camera, so that nothing the others do costs a frame.

Run as `python -m cablecast.filming.grabber`; `LiveCamera` starts it. Pictures go through a block of
shared memory with several slots, a line of JSON about each through one pipe, and the numbers of the
slots that are free again come back through another.
"""

import dataclasses
import json
import mmap
import os
import select
import signal
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CablecastError, CameraError
from cablecast.filming.device import CameraFacts, open_capture
from cablecast.tracking.opencv import load_cv2

SLOT_COUNT = 12
"""Frames that may wait to be looked at."""
WARM_UP_COUNT = 10
"""First frames of a device, which are exposed as before."""

_STAMP_TRIES = 3
"""Frames after which a camera whose stamps are all zero has none."""


class Grabber:
    """Reads frames and passes them on.

    Args:
        settings: Camera to read.
        memory: Descriptor of the memory for frames; it is given its size here.
        reports: Descriptor of the pipe for lines of JSON.
        returns: Descriptor of the pipe of free slots.
    """

    def __init__(self, settings: CameraSettings, memory: int, reports: int, returns: int):
        self.settings = settings
        self._memory = memory
        self._reports = reports
        self._returns = returns
        self._free = list(range(SLOT_COUNT))
        self._dropped = 0

    def run(self) -> None:
        """Read the camera until it ends or nobody listens."""
        try:
            capture, facts = open_capture(self.settings)
            image = self._first(capture, facts)
            height, width = image.shape[:2]
            facts = dataclasses.replace(facts, width=width, height=height)
            os.ftruncate(self._memory, SLOT_COUNT * image.nbytes)
            slots = np.ndarray((SLOT_COUNT, *image.shape), np.uint8, mmap.mmap(self._memory, 0))
            self._say({"facts": dataclasses.asdict(facts)})
            self._loop(capture, facts, slots, image)
        except CablecastError as error:
            self._say({"error": str(error)})

    def _first(self, capture: Any, facts: CameraFacts) -> NDArray[np.uint8]:
        """Return the first picture after those that a device still exposes as before."""
        image = None
        for _ in range(WARM_UP_COUNT if facts.kind == "device" else 1):
            ok, image = capture.read()
            if not ok:
                raise CameraError(f"camera source {self.settings.source} gives no picture")
        return image  # pyright: ignore[reportReturnType]

    def _loop(
        self, capture: Any, facts: CameraFacts, slots: NDArray[np.uint8], first: NDArray[np.uint8]
    ) -> None:
        """Pass on frame after frame.

        Args:
            capture: Open capture.
            facts: Answers of the camera.
            slots: Room for frames, shape [slot, v, u, 3].
            first: Frame that was read already. Every frame of a film counts; that of a stream
                tells its size only, since its time may be older than the viewer.
        """
        stamps, film = _Stamps(self.settings), facts.kind == "file"
        image: NDArray[np.uint8] | None = first if film else None
        while True:
            if image is None:
                ok, image = capture.read()
                if not ok or image is None:
                    self._say({"end": film, "dropped": self._dropped})
                    return
            arrival = time.monotonic()
            stamp = stamps.time(capture, arrival)
            slot = self._slot(wait=film)
            if slot is None or image.shape != slots.shape[1:]:
                self._dropped += 1
            else:
                slots[slot] = image
                report = {"slot": slot, "time": stamp, "arrival": arrival}
                self._say({**report, "dropped": self._dropped})
            image = None

    def _slot(self, wait: bool) -> int | None:
        """Return a free slot; None if there is none and none is waited for."""
        while True:
            patience = None if wait and not self._free else 0.0
            while select.select([self._returns], [], [], patience)[0]:
                returned = os.read(self._returns, SLOT_COUNT)
                if not returned:
                    # Nobody is left to film for.
                    os._exit(0)
                self._free += list(returned)
                patience = 0.0
            if self._free or not wait:
                return self._free.pop(0) if self._free else None

    def _say(self, values: dict[str, Any]) -> None:
        try:
            os.write(self._reports, (json.dumps(values) + "\n").encode())
        except BrokenPipeError:
            os._exit(0)


class _Stamps:
    """Times of frames by the clock that was asked for.

    Args:
        settings: Gives the clock.
    """

    def __init__(self, settings: CameraSettings):
        self._settings = settings
        self._zero_count = 0

    def time(self, capture: Any, arrival: float) -> float:
        """Return the time of the frame that was just read [s].

        Args:
            capture: Capture that read it.
            arrival: Time at which it arrived [s].

        Raises:
            CameraError: The camera gives no time stamps.
        """
        if self._settings.clock == "arrival":
            return arrival
        stamp = float(capture.get(load_cv2().CAP_PROP_POS_MSEC)) / 1e3
        self._zero_count = self._zero_count + 1 if stamp == 0.0 else 0
        if self._zero_count >= _STAMP_TRIES:
            raise CameraError(
                f"camera source {self._settings.source} gives no time stamps: set `clock: arrival` "
                "in the section `camera` of the lab file"
            )
        return stamp


def main(arguments: list[str]) -> None:
    """Read a camera for the process that started this one.

    Args:
        arguments: Settings as JSON, and the descriptors of the memory and of both pipes.
    """
    # Ctrl-C is for the process that started this one; it ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    settings = CameraSettings.from_dict(json.loads(arguments[0]))
    memory, reports, returns = (int(word) for word in arguments[1:4])
    Grabber(settings, memory, reports, returns).run()


if __name__ == "__main__":
    main(sys.argv[1:])

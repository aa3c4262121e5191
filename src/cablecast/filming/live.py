"""LiveCamera: frames of a camera with their times, read by a process of its own."""

import contextlib
import dataclasses
import json
import mmap
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError
from cablecast.filming.device import OPEN_TIMEOUT, CameraFacts
from cablecast.filming.grabber import SLOT_COUNT
from cablecast.tracking.opencv import load_cv2

READ_TIMEOUT = 5.0
"""Time without any frame after which a camera counts as unplugged [s]."""

_START_TIMEOUT = OPEN_TIMEOUT + 20.0
"""Time for the process to start and to open the camera [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Frame:
    """One picture of the table.

    Attributes:
        time: Time of the frame in the camera's clock [s].
        arrival: Time at which it arrived in this computer, in its monotonic clock [s].
        image: Picture, BGR, shape [v, u, 3].
    """

    time: float
    arrival: float
    image: NDArray[np.uint8]


class LiveCamera:
    """A camera that is being read.

    Frames that nobody fetches in time are dropped and counted, except those of a film.

    Args:
        settings: Camera to read.

    Raises:
        CameraError: It cannot be opened; says what to do in one line.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, settings: CameraSettings):
        load_cv2()
        self.settings = settings
        self.dropped_count = 0
        self._last = -np.inf
        self._lines: list[bytes] = []
        self._rest = b""
        self._memory = _memory()
        self._reports, reports = os.pipe()
        returns, self._returns = os.pipe()
        words = [json.dumps(settings.to_dict()), str(self._memory), str(reports), str(returns)]
        self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
            [sys.executable, "-m", "cablecast.filming.grabber", *words],
            pass_fds=(self._memory, reports, returns),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(reports)
        os.close(returns)
        try:
            report = self._report(_START_TIMEOUT)
            if report is None:
                raise CameraError(f"camera source {settings.source} ended before its first frame")
            self.facts = CameraFacts(**report["facts"])
            shape = (SLOT_COUNT, self.facts.height, self.facts.width, 3)
            self._map = mmap.mmap(self._memory, 0, prot=mmap.PROT_READ)
            self._slots = np.ndarray(shape, np.uint8, self._map)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames until the source ends."""
        while (frame := self.read()) is not None:
            yield frame

    def read(self, timeout: float = READ_TIMEOUT) -> Frame | None:
        """Return the next frame; None after the last of a film.

        Args:
            timeout: Time to wait for it [s].

        Raises:
            CameraError: There was none in time, the camera stopped, or its times do not rise.
        """
        report = self._report(timeout)
        if report is None:
            return None
        slot, stamp = int(report["slot"]), float(report["time"])
        image = self._slots[slot].copy()
        with contextlib.suppress(BrokenPipeError):
            # The end of the stream, if that is why nobody reads, is told by the next report.
            os.write(self._returns, bytes([slot]))
        if not stamp > self._last:
            raise CameraError(
                f"camera source {self.settings.source}: the time of a frame does not rise: "
                f"{stamp:.6f} s follows {self._last:.6f} s"
            )
        self._last = stamp
        return Frame(time=stamp, arrival=float(report["arrival"]), image=image)

    def skip(self) -> None:
        """Pass over the frames that wait to be read."""
        while self._lines or select.select([self._reports], [], [], 0.0)[0]:
            if self.read() is None:
                return

    def close(self) -> None:
        """Stop the process; it may be called twice."""
        if self._process is None:
            return
        os.close(self._returns)
        # It may be waiting for a camera that does not answer.
        self._process.kill()
        self._process.wait()
        self._process = None
        os.close(self._reports)
        os.close(self._memory)

    def _report(self, timeout: float) -> dict[str, Any] | None:
        """Return what the process says next; None at the end of a film."""
        if self._process is None:
            raise CameraError("the camera is closed")
        source, deadline = self.settings.source, time.monotonic() + timeout
        while not self._lines:
            left = deadline - time.monotonic()
            if left <= 0.0 or not select.select([self._reports], [], [], left)[0]:
                raise CameraError(
                    f"camera source {source} gave no frame for {timeout:g} s: is it still plugged "
                    "in and switched on?"
                )
            content = os.read(self._reports, 1 << 16)
            if not content:
                raise CameraError(f"the process that reads camera source {source} ended")
            *lines, self._rest = (self._rest + content).split(b"\n")
            self._lines += lines
        report = json.loads(self._lines.pop(0))
        self.dropped_count = report.get("dropped", self.dropped_count)
        if "error" in report:
            raise CameraError(report["error"])
        if "end" not in report:
            return report
        self._lines = [json.dumps(report).encode()]
        if report["end"]:
            return None
        raise CameraError(f"camera source {source} stopped: is it still plugged in?")


def _memory() -> int:
    """Return the descriptor of memory, or of a file without a name, for frames."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("cablecast-frames")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())

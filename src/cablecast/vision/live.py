"""Live cameras: frames with their times, read by a process of its own, and a watch over them.

Thanks to the process, `python -m cablecast.vision.live`, other work costs no frame. Pictures go
through a block of shared memory with many slots, a report on each through a pipe, and the numbers
of the slots that are free again come back. While a trial is filmed every frame is kept until it is
looked at, however busy the computer is, as long as there is memory.
"""

import contextlib
import dataclasses
import mmap
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CablecastError, CameraError
from cablecast.vision.tags import load_cv2

SLOT_COUNT = 12
"""Frames that may wait to be looked at while not all of them count."""
KEPT_COUNT, _KEPT_SIZE = 240, 1 << 30
"""Frames that may wait while all of them count, since reports on some 270 fit into the pipe; and
most memory for them [byte]."""
_OPEN_TIMEOUT = 10.0
"""Time within which a camera or stream must open [s]."""
_START_TIMEOUT = _OPEN_TIMEOUT + 20.0
"""Time for the process to start and to open the camera [s]."""
_READ_TIMEOUT = 5.0
"""Time without any frame after which a camera counts as unplugged [s]."""
_SILENCE_MAX = 60.0
"""Time without data after which a stream is given up for good [s]. Who waits for a frame says much
sooner that none comes, and may try again when they come."""
_WARM_UP_COUNT = 10
"""First frames of a device, which are exposed as before."""
_STREAM_OPTIONS = "rtsp_transport;tcp|fpsprobesize;0"
"""Options of FFmpeg: OpenCV's own, and no wait for frames that would tell the rate of a stream."""
_STAMP_TRIES = 3
"""Frames after which a camera whose stamps are all zero has none."""
_EXPOSURE_UNIT = 1e-4
"""Unit of the exposure time of V4L2 [s]."""
_AUTO_EXPOSURE_ON, _AUTO_EXPOSURE_OFF = 3.0, 1.0
"""V4L2's numbers for automatic and manual exposure."""
_DEVICE = re.compile(r"(?:/dev/video)?(\d+)")
_ADVICE = {
    "device": "is it plugged in, is its number right, and does no other program use it?",
    "stream": "is the camera switched on, and is its address right?",
    "file": "there is no such video, or it cannot be read",
}


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


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraFacts:
    """Answer of a camera to what was asked of it.

    Attributes:
        kind: "device", "file" or "stream".
        backend: Name of OpenCV's backend.
        width: Width of its images [px].
        height: Height of its images [px].
        fourcc: Pixel format; empty where unknown.
        exposure: Exposure [s]; None where it cannot be asked.
        auto_exposure: Whether exposure is automatic; None where it cannot be asked.
        autofocus: Whether focus is automatic; None where it cannot be asked.
        auto_balance: Whether the white balance is automatic; None where it cannot be asked.
    """

    kind: str
    backend: str
    width: int
    height: int
    fourcc: str = ""
    exposure: float | None = None
    auto_exposure: bool | None = None
    autofocus: bool | None = None
    auto_balance: bool | None = None


class LiveCamera:
    """A camera that is being read.

    Frames that are not fetched in time are dropped and counted, except those of a film, and those
    that `keep` asks for as long as there is memory.

    Raises:
        CameraError: It cannot be opened; says what to do in one line.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, settings: CameraSettings):
        load_cv2()
        self.settings = settings
        self.dropped_count = 0
        self._last = -np.inf
        self._end: dict[str, Any] | None = None
        self._memory = _open_memory()
        self._pipe, theirs = multiprocessing.Pipe()
        words = [str(theirs.fileno()), str(self._memory)]
        self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
            [sys.executable, "-m", "cablecast.vision.live", *words],
            pass_fds=(theirs.fileno(), self._memory),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        theirs.close()
        try:
            self._pipe.send(settings)
            report = self._report(_START_TIMEOUT)
            if report is None:
                raise CameraError(f"camera source {settings.source} ended before its first frame")
            self.facts = CameraFacts(**report["facts"])
            self._map = mmap.mmap(self._memory, 0, prot=mmap.PROT_READ)
            shape = (-1, self.facts.height, self.facts.width, 3)
            self._slots = np.frombuffer(self._map, np.uint8).reshape(shape)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        """Return the frames that come until the source ends."""
        return iter(self.read, None)

    def read(self, timeout: float = _READ_TIMEOUT) -> Frame | None:
        """Return the next frame, or wait for it [s]; None after the last of a film."""
        report = self._report(timeout)
        if report is None:
            return None
        slot, stamp = report["slot"], report["time"]
        image = self._slots[slot].copy()
        self._send(slot)
        last, self._last = self._last, stamp
        if not stamp > last:
            raise CameraError(
                f"camera source {self.settings.source}: the time of a frame does not rise: "
                f"{stamp:.6f} s follows {last:.6f} s"
            )
        return Frame(time=stamp, arrival=report["arrival"], image=image)

    def keep(self, every: bool) -> None:
        """Keep every frame from now on until it is read, or no more than a few of them."""
        self._send(every)

    def _send(self, word: int | bool) -> None:
        with contextlib.suppress(OSError):
            # If the process has ended, the next report says why.
            self._pipe.send(word)

    def skip(self) -> None:
        """Pass over the frames that wait to be read."""
        while self._pipe.poll() and self.read() is not None:
            pass

    def close(self) -> None:
        """Stop the process; it may be called twice."""
        if self._process is None:
            return
        # It may be waiting for a camera that does not answer.
        self._process.kill()
        self._process.wait()
        self._process = None
        self._pipe.close()
        os.close(self._memory)

    def _report(self, timeout: float) -> dict[str, Any] | None:
        """Return what the process says next; None at the end of a film."""
        if self._process is None:
            raise CameraError("the camera is closed")
        source, report = self.settings.source, self._end
        if report is None:
            try:
                if not self._pipe.poll(timeout):
                    raise CameraError(
                        f"camera source {source} gave no frame for {timeout:g} s: is it still "
                        "plugged in and switched on?"
                    )
                report = self._pipe.recv()
            except (EOFError, OSError):
                raise CameraError(f"the process that reads camera source {source} ended") from None
        self.dropped_count = report.get("dropped", self.dropped_count)
        if "error" in report:
            raise CameraError(report["error"])
        if "end" not in report:
            return report
        self._end = report
        if report["end"]:
            return None
        raise CameraError(f"camera source {source} stopped: is it still plugged in?")


def _open_memory() -> int:
    """Return the descriptor of memory, or of a file without a name, for frames."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("cablecast-frames")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


_STRIDE = 8
"""Distance of the pixels that are compared [px]."""
_SAME_MAX = 4
"""Most frames in a row that may be equal: a driver may repeat a late one."""
_DARK_MAX = 12.0
"""Mean brightness, of 255, below which a picture shows nothing."""
_LIGHT_CHANGE, _COLOUR_CHANGE = 4.0, 1.6
"""Factors of brightness and of a colour since the calibration beyond which the tracker, which evens
them out, has too little left to go by: lamps that flicker by +-50 % stay within a factor of 3."""
_CLIPPED_MAX = 0.9
"""Share of saturated pixels from which on a picture shows nothing: a white table alone may be."""
_WHITE = 248.0
"""Brightness from which on a pixel is saturated, but for its noise."""
_SHADE = 0.2
"""Share of the pixels that are darker than the one by which brightness is compared: white table may
be saturated, the floor and the tags' ink are not."""

_EDGE_SHARE, _EDGE_MIN, _BLUR_CHANGE = 0.002, 25.0, 0.75
"""Share of the pixels that are the strongest edges, least height of these, of 255, and factor of
their sharpness since the calibration below which the lens has lost its focus."""
SHARPNESS_MIN = 0.36
"""Sharpness of a lens that is focused: a blur by 1 px has that much, and light does not matter."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Brightness:
    """Brightness and sharpness of a picture.

    Attributes:
        mean: Mean of all pixels, of 255.
        colour: Blue, green and red as multiples of their mean [-].
        shade: Brightness of its darker parts, of 255.
        clipped: Share of the pixels that are saturated [-].
        sharpness: Change of brightness over one pixel at the strongest edges, as a share of that
            over four: half at sharp ones, a quarter where all is blurred, and 1 without edges [-].
    """

    mean: float
    colour: tuple[float, float, float]
    shade: float
    clipped: float
    sharpness: float

    @classmethod
    def of(cls, image: NDArray[np.uint8]) -> "Brightness":
        """Return the brightness of a picture, BGR, shape [v, u, 3]."""
        pixels = image[::_STRIDE, ::_STRIDE]
        grey, (blue, green, red) = pixels.mean(axis=-1), pixels.mean(axis=(0, 1)) + 1.0
        third, rows = float(blue + green + red) / 3, image[:: 2 * _STRIDE, :, 1].astype(np.int16)
        slopes = [
            float(np.quantile(np.abs(rows[:, apart:] - rows[:, :-apart]), 1.0 - _EDGE_SHARE))
            for apart in (1, 4)
        ]
        return cls(
            mean=float(grey.mean()),
            colour=(float(blue) / third, float(green) / third, float(red) / third),
            shade=float(np.quantile(grey, _SHADE)),
            clipped=float(np.mean(grey >= _WHITE)),
            sharpness=slopes[0] / slopes[1] if slopes[1] > _EDGE_MIN else 1.0,
        )


class FrameWatch:
    """Looks at each frame for a camera that is frozen, dark, out of focus, or in another light.

    A picture of a real sensor never repeats itself exactly, for its noise is new in every frame.
    `reference` is the brightness at the calibration; it is not compared if None.
    """

    def __init__(self, source: str, reference: Brightness | None = None):
        self._source = source
        self._reference = reference
        self._last: NDArray[np.uint8] | None = None
        self._same_count = 0
        self.now: Brightness | None = None

    def look(self, frame: Frame) -> bool:
        """Look at the next frame, and return whether it is another one than the last.

        Raises:
            CameraError: The camera is one of these; says what to do.
        """
        sampled = frame.image[::_STRIDE, ::_STRIDE]
        same = self._last is not None and np.array_equal(sampled, self._last)
        self._same_count = self._same_count + 1 if same else 0
        self._last = sampled
        where = f"camera source {self._source}"
        if self._same_count >= _SAME_MAX:
            raise CameraError(
                f"{where} is frozen: {self._same_count + 1} frames in a row are equal to the last "
                "bit. Plug it out and in again. The same command resumes"
            )
        now = self.now = Brightness.of(frame.image)
        if now.mean < _DARK_MAX:
            raise CameraError(
                f"{where} is dark: its mean brightness is {now.mean:.0f} of 255. Switch on the "
                "light, take off the lens cap, and repeat the trial"
            )
        if self._reference is None:
            return not same
        change = now.shade / max(self._reference.shade, 1.0)
        if change < 1 / _LIGHT_CHANGE or now.clipped > _CLIPPED_MAX:
            raise CameraError(
                f"{where} is {change:.2f} times as bright as when it was calibrated, and "
                f"{100 * now.clipped:.0f} % of it are white: the light or the exposure has "
                "changed. Switch automatic exposure off, and start anew"
            )
        if now.sharpness < min(_BLUR_CHANGE * self._reference.sharpness, SHARPNESS_MIN):
            share = now.sharpness / self._reference.sharpness
            raise CameraError(
                f"{where} is out of focus: edges are {share:.2f} "
                "times as sharp as when it was calibrated. Switch automatic focus off, and start "
                "anew"
            )
        for name, a, b in zip(
            ("blue", "green", "red"), now.colour, self._reference.colour, strict=True
        ):
            if not 1 / _COLOUR_CHANGE < a / b < _COLOUR_CHANGE:
                raise CameraError(
                    f"{where} sees {a / b:.2f} times as much {name} as when it was calibrated: "
                    "switch automatic white balance off, and start anew"
                )
        return not same


def open_capture(settings: CameraSettings) -> tuple[Any, CameraFacts]:
    """Open a camera, ask it for its settings, and read them back."""
    cv2 = load_cv2()
    source = settings.source.strip()
    device = _DEVICE.fullmatch(source)
    kind = "device" if device else "stream" if "://" in source else "file"
    try:
        if device:
            opened = cv2.VideoCapture(int(device.group(1)), cv2.CAP_V4L2)
        elif kind == "stream":
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, int(1e3 * _OPEN_TIMEOUT)]
            limits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(1e3 * _SILENCE_MAX)]
            opened = cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)
        else:
            opened = cv2.VideoCapture(source, cv2.CAP_FFMPEG)
    except cv2.error as error:
        raise CameraError(f"camera source {source}: {' '.join(str(error).split())}") from None
    if not opened.isOpened():
        raise CameraError(f"camera source {source} cannot be opened: {_ADVICE[kind]}")
    if device:
        _configure(opened, settings)
    return opened, _read_back(opened, kind)


def _configure(capture: Any, settings: CameraSettings) -> None:
    """Ask a device for its settings.

    The order is that of Linux cameras (V4L2): pixel format, size and rate one after another, since
    each bounds the next; automatic exposure is switched through its automatic state, without which
    some drivers ignore the value.
    """
    cv2 = load_cv2()
    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter_fourcc(*settings.fourcc))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height)
    capture.set(cv2.CAP_PROP_FPS, settings.rate)
    capture.set(cv2.CAP_PROP_AUTOFOCUS, 0)
    if settings.focus is not None:
        capture.set(cv2.CAP_PROP_FOCUS, settings.focus)
    capture.set(cv2.CAP_PROP_AUTO_WB, 0)
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _AUTO_EXPOSURE_ON)
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _AUTO_EXPOSURE_OFF)
    capture.set(cv2.CAP_PROP_EXPOSURE, round(settings.exposure / _EXPOSURE_UNIT))


def _read_back(capture: Any, kind: str) -> CameraFacts:
    """Return the settings that a camera reports."""
    cv2 = load_cv2()
    code = max(int(capture.get(cv2.CAP_PROP_FOURCC)), 0)
    facts = CameraFacts(
        kind=kind,
        backend=str(capture.getBackendName()),
        width=int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
        height=int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        fourcc=code.to_bytes(4, "little").decode("ascii", "replace").strip("\0"),
    )
    if kind != "device":
        return facts
    exposure = float(capture.get(cv2.CAP_PROP_EXPOSURE))
    automatic = float(capture.get(cv2.CAP_PROP_AUTO_EXPOSURE))
    autofocus = float(capture.get(cv2.CAP_PROP_AUTOFOCUS))
    balance = float(capture.get(cv2.CAP_PROP_AUTO_WB))
    # What a driver does not know it answers with 0 or -1.
    return dataclasses.replace(
        facts,
        exposure=exposure * _EXPOSURE_UNIT if exposure > 0 else None,
        auto_exposure=automatic == _AUTO_EXPOSURE_ON if automatic > 0 else None,
        autofocus=autofocus > 0 if autofocus >= 0 else None,
        auto_balance=balance > 0 if balance >= 0 else None,
    )


class _Grabber:
    """Reads frames and passes them on, until the camera ends or the reader is gone.

    The reader sends the settings, free slots, and whether every frame is to be kept. The memory is
    given its size here; what no frame was ever put into takes none.
    """

    def __init__(self, pipe: Connection, memory: int):
        self._pipe, self._memory = pipe, memory
        self._settings: CameraSettings = pipe.recv()
        self._free: list[int] = []
        self._slot_count, self._kept_count = 0, SLOT_COUNT
        self._zero_count = 0

    def run(self) -> None:
        """Read the camera."""
        try:
            capture, facts = open_capture(self._settings)
            image = self._first(capture, facts.kind)
            height, width = image.shape[:2]
            count = min(max(_KEPT_SIZE // image.nbytes, SLOT_COUNT), KEPT_COUNT)
            self._slot_count, self._free = count, list(range(count))
            os.ftruncate(self._memory, count * image.nbytes)
            slots = np.ndarray((count, *image.shape), np.uint8, mmap.mmap(self._memory, 0))
            facts = dataclasses.replace(facts, width=width, height=height)
            self._say({"facts": dataclasses.asdict(facts)})
            self._loop(capture, slots, image if facts.kind == "file" else None)
        except CablecastError as error:
            self._say({"error": str(error)})

    def _first(self, capture: Any, kind: str) -> NDArray[np.uint8]:
        """Return the first picture after those that a device still exposes as before."""
        for _ in range(_WARM_UP_COUNT if kind == "device" else 1):
            ok, image = capture.read()
            if not ok:
                raise CameraError(f"camera source {self._settings.source} gives no picture")
        return image

    def _loop(
        self, capture: Any, slots: NDArray[np.uint8], image: NDArray[np.uint8] | None
    ) -> None:
        """Pass on frame after frame into slots, shape [slot, v, u, 3].

        `image` is the first frame of a film, all of whose frames count. That of a stream gives the
        size only, since its time may be older than the viewer.
        """
        film, dropped_count = image is not None, 0
        while True:
            if image is None:
                _, image = capture.read()
            if image is None:
                self._say({"end": film, "dropped": dropped_count})
                return
            arrival = time.monotonic()
            stamp = self._stamp(capture, arrival)
            slot = self._slot(wait=film) if image.shape == slots.shape[1:] else None
            if slot is None:
                dropped_count += 1
            else:
                slots[slot] = image
                report = {"slot": slot, "time": stamp, "arrival": arrival}
                self._say({**report, "dropped": dropped_count})
            image = None

    def _stamp(self, capture: Any, arrival: float) -> float:
        """Return the time of the frame that was just read, by the clock that was asked for [s]."""
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

    def _slot(self, wait: bool) -> int | None:
        """Return a free slot; None if there is none and none is waited for."""
        try:
            while self._pipe.poll(None if wait and not self._has_room else 0.0):
                word = self._pipe.recv()
                if isinstance(word, bool):
                    self._kept_count = self._slot_count if word else SLOT_COUNT
                else:
                    self._free.append(word)
        except (EOFError, OSError):
            # The reader is gone.
            os._exit(0)
        # The one that was used last: others may not have been given memory yet.
        return self._free.pop() if self._has_room else None

    @property
    def _has_room(self) -> bool:
        return self._slot_count - len(self._free) < self._kept_count

    def _say(self, report: dict[str, Any]) -> None:
        try:
            self._pipe.send(report)
        except OSError:
            os._exit(0)


def main(arguments: list[str]) -> None:
    """Read a camera for the process that started this one; arguments are pipe and memory."""
    # Ctrl-C is for the process that started this one; it ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", _STREAM_OPTIONS)
    pipe, memory = (int(word) for word in arguments)
    _Grabber(Connection(pipe), memory).run()


if __name__ == "__main__":
    main(sys.argv[1:])

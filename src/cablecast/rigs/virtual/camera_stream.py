"""CameraStream: the virtual camera as a stream on the loopback address, as OpenCV opens one.

The camera has a clock of its own. Its frames are taken at whole multiples of its frame time in the
laboratory's clock, whatever time it takes to draw them; so `show` waits where the drawing is slower
than the laboratory, and whoever looks at the stream goes by the times of its frames.
"""

import contextlib
import multiprocessing
import threading
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from cablecast.errors import RigError, UnknownNameError, check_number
from cablecast.rigs.virtual.camera_config import CameraConfig
from cablecast.rigs.virtual.camera_live import FAULTS, serve
from cablecast.setup import Setup

_START_TIMEOUT = 60.0
_AHEAD_MAX = 10
"""Instants by which the laboratory may be ahead of its camera."""


class CameraStream:
    """The camera above the virtual table, in a process of its own.

    Args:
        setup: Gives the table, its tags, the cable and the arm.
        config: Settings of the camera; mounted over the table where None.
        seed: Seed of the table's looks, of the light and of the noise.
        clock: Time of the camera's clock when the laboratory's shows zero, not negative [s].
        port: Port of the stream; a free one where 0.
    """

    def __init__(
        self,
        setup: Setup,
        config: CameraConfig | None = None,
        *,
        seed: int = 0,
        clock: float = 0.0,
        port: int = 0,
    ):
        self.config = CameraConfig.over(setup.workspace) if config is None else config
        self.clock = check_number("camera clock", clock, 0.0, 1e9, "s")
        # A fork would copy whatever threads the caller has.
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._lock = threading.Lock()
        self._room = context.Semaphore(_AHEAD_MAX)
        self._process: Any = context.Process(
            target=serve,
            args=(theirs, self._room, setup, self.config, seed, clock, port),
            daemon=True,
        )
        self._process.start()
        theirs.close()
        if not self._pipe.poll(_START_TIMEOUT):
            self.close()
            raise RigError(f"the virtual camera did not start within {_START_TIMEOUT:g} s")
        self.url: str = self._receive()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def show(self, time: float, q: ArrayLike | None, nodes: ArrayLike) -> None:
        """Let the camera see one instant of the laboratory, and wait while it is behind.

        Frames are drawn between instants that are at most 25 ms apart; where they are farther, no
        frame is taken.

        Args:
            time: Time in the laboratory's clock, rising [s].
            q: Joint angles [rad], shape [6]; None for a table without an arm.
            nodes: Cable from grip to endpoint, base frame [m], shape [node, 3].
        """
        joints = None if q is None else np.asarray(q, dtype=float)
        while not self._room.acquire(timeout=1.0):
            if self._process is None or not self._process.is_alive():
                raise RigError("the virtual camera has ended")
        self._send(("state", float(time), joints, np.asarray(nodes, dtype=float)))

    def fault(self, name: str | None) -> None:
        """Let the camera fail from now on, or work again.

        Args:
            name: One of `FAULTS`; None to end all faults.

        Raises:
            UnknownNameError: There is no such fault.
        """
        if name is not None and name not in FAULTS:
            raise UnknownNameError(f"unknown fault {name!r} of a camera: {', '.join(FAULTS)}")
        self._send(("fault", name))
        self.finish()

    def finish(self) -> None:
        """Wait until the camera has filmed all that it was shown."""
        self._send(("finish",))
        self._receive()

    def close(self) -> None:
        """Stop the camera; it may be called twice."""
        if self._process is None:
            return
        with contextlib.suppress(OSError):
            self._pipe.send(("stop",))
        self._pipe.close()
        self._process.join(2.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process = None

    def _send(self, message: tuple[Any, ...]) -> None:
        try:
            with self._lock:
                self._pipe.send(message)
        except OSError:
            raise RigError("the virtual camera has ended") from None

    def _receive(self) -> Any:
        try:
            return self._pipe.recv()
        except (EOFError, OSError):
            raise RigError("the virtual camera has ended") from None

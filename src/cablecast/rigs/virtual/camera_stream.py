"""CameraStream: the virtual camera as a stream on the loopback address, as OpenCV opens one.

A process of its own draws what it is shown, frame by frame, and broadcasts it.

The camera has a clock of its own. Its frames are taken at whole multiples of its frame time in the
laboratory's clock, whatever time it takes to draw them; so `show` waits where the drawing is slower
than the laboratory, and whoever looks at the stream goes by the times of its frames.
"""

import contextlib
import dataclasses
import multiprocessing
import signal
import threading
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.camera.tags import TagLayout
from cablecast.conventions import Array
from cablecast.errors import RigError, UnknownNameError, check_number
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.virtual.camera import TrialFilm, VirtualCamera
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.rigs.virtual.drawing import FilmedTrial, draw_background
from cablecast.setup import Setup
from cablecast.vision.broadcast import Broadcast
from cablecast.vision.video import encode_jpeg

FAULTS = ("frozen", "black", "unplugged", "exposed", "moved_tag")
"""Faults of the camera: the same picture again and again, darkness, no stream at all, an exposure
that is not what was set, and a tag that was moved."""

MOVED_TAG = 2
"""Place in the layout of the tag that the fault moves."""

_GAP_MAX = 0.025
"""Longest time between two instants between which frames are drawn [s]."""
_STILL = 1e-7
"""Largest change of a joint or a node of a scene that stands still [rad or m]."""
_STILL_COUNT = 4
"""Pictures of a still scene, each with noise of its own, that are sent in turn."""
_MOVE = (0.06, -0.04)
"""Way by which the fault moves a tag [m]."""
_EXPOSED = 6.0
"""Brightness of a picture after the exposure was changed, as a multiple of that before."""
_DARK = 2.0
_START_TIMEOUT = 60.0
_AHEAD_MAX = 10
"""Instants by which the laboratory may be ahead of its camera."""

_State = tuple[float, Array | None, Array]


class LiveFilm(TrialFilm):
    """A film of what is shown instant by instant."""

    LEAD = 0

    def __init__(self, camera: VirtualCamera, setup: Setup, seed: int):
        self._setup = setup
        self._states: deque[_State] = deque()
        self.gain = 1.0
        super().__init__(camera, self._trial([(0.0, None, np.zeros((2, 3)))]), seed)
        config = camera.config
        # Half an exposure on both sides of a frame, and half the time to read all of its rows.
        self.reach = (config.exposure + config.row_time * config.height) / 2
        self._next: int | None = None

    def show(self, state: _State) -> None:
        """Add an instant."""
        if self._states and not 0.0 < state[0] - self._states[-1][0] <= _GAP_MAX:
            self._states.clear()
            self._next = None
        self._states.append(state)
        if self._next is None:
            self._next = int(np.ceil((state[0] + self.reach) / self.frame_dt - 1e-9))

    def due(self) -> int | None:
        """Return the number of the next frame if all of it was shown, and make it ready."""
        if self._next is None or not self._states:
            return None
        frame = self._next
        if self._states[-1][0] < self.time(frame) + self.reach:
            return None
        self._next += 1
        start = self.time(frame) - self.reach
        # One instant before the exposure, and its neighbour for a smooth curve.
        while len(self._states) > 3 and self._states[2][0] <= start:
            self._states.popleft()
        self.trial = self._trial(list(self._states))
        self._drawn = (-1, {})
        return frame

    @property
    def still(self) -> Array | None:
        """Scene of the frame that is due, as one row of numbers; None if anything moves."""
        first, last = _scene(self._states[0]), _scene(self._states[-1])
        return last if _same(first, last) else None

    def _trial(self, states: list[_State]) -> FilmedTrial:
        times = np.array([time for time, _, _ in states])
        q = [joints for _, joints, _ in states if joints is not None]
        path = None
        if len(q) == len(states):
            angles = np.array(q)
            path = JointPath(times=times, q=angles, qd=np.zeros_like(angles))
        nodes = np.array([nodes for _, _, nodes in states])
        return FilmedTrial.of(self._setup, times, nodes, path)

    def _gains(self, time: float) -> Array:
        return self.gain * super()._gains(time)


class Studio:
    """The camera, its faults and its broadcast; see `CameraStream`."""

    def __init__(self, setup: Setup, config: CameraConfig, seed: int, clock: float, port: int):
        self.camera = VirtualCamera.of(setup, config, seed)
        self.film = LiveFilm(self.camera, setup, seed)
        self.broadcast = Broadcast(config.width, config.height, config.frame_rate, port)
        self.broadcast.latest = encode_jpeg(self.camera.empty_frame(seed))
        self.clock = clock
        self._seed = seed
        self._fault: str | None = None
        self._still: list[bytes] = []
        self._still_scene = np.empty(0)
        self._table = self.camera.background

    def show(self, state: _State) -> None:
        """Add an instant, and send the frames that are due."""
        self.film.show(state)
        while (frame := self.film.due()) is not None:
            if self.broadcast.viewers and not self.film.is_dropped(frame):
                self.broadcast.send(self._picture(frame), self.clock + self.film.time(frame))

    def fault(self, name: str | None) -> None:
        """Start a fault, or end all."""
        self._fault, self._still = name, []
        self.film.gain = _EXPOSED if name == "exposed" else 1.0
        self.camera.background = self._moved() if name == "moved_tag" else self._table
        if name == "unplugged":
            self.broadcast.unplug()
        else:
            self.broadcast.plug()

    def _picture(self, frame: int) -> bytes:
        """Return a frame as JPEG."""
        latest = self.broadcast.latest
        if self._fault == "frozen" and latest is not None:
            return latest
        config = self.camera.config
        if self._fault == "black":
            noise = np.random.default_rng([self._seed, frame, 9])
            size = (config.height, config.width, 3)
            return encode_jpeg((_DARK * noise.random(size)).astype(np.uint8))
        scene, light = self.film.still, config.light
        if scene is None or light.lamp_flicker or light.balance != (1.0, 1.0, 1.0):
            return encode_jpeg(self.film.frame(frame))
        if not _same(scene, self._still_scene):
            self._still, self._still_scene = [], scene
        if len(self._still) < _STILL_COUNT:
            self._still.append(encode_jpeg(self.film.frame(frame)))
            return self._still[-1]
        # Never the one that was sent last: equal frames in a row are a camera's fault.
        self._still.append(self._still.pop(0))
        return self._still[-1]

    def _moved(self) -> NDArray[np.uint8]:
        """Return the picture of the table with one tag moved."""
        camera = self.camera
        tags = list(camera.layout.tags)
        place = min(MOVED_TAG, len(tags) - 1)
        tag = tags[place]
        tags[place] = dataclasses.replace(tag, x=tag.x + _MOVE[0], y=tag.y + _MOVE[1])
        scene = (camera.view, camera.config, camera.workspace, TagLayout(tags=tuple(tags)))
        return draw_background(*scene, self._seed)[0]


def _scene(state: _State) -> Array:
    """Return an instant as one row of numbers."""
    _, joints, nodes = state
    return np.concatenate([np.empty(0) if joints is None else joints, nodes.ravel()])


def _same(a: Array, b: Array) -> bool:
    """Return whether two scenes are equal but for what no picture shows."""
    return a.shape == b.shape and float(np.max(np.abs(b - a))) < _STILL


def _serve(
    pipe: Any, room: Any, setup: Setup, config: CameraConfig, seed: int, clock: float, port: int
) -> None:
    """Film what comes through a pipe until it ends, and release the room of each instant."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    studio = Studio(setup, config, seed, clock, port)
    pipe.send(studio.broadcast.url)
    while True:
        try:
            kind, *content = pipe.recv()
        except (EOFError, OSError):
            return
        if kind == "state":
            studio.show((content[0], content[1], content[2]))
            room.release()
        elif kind == "fault":
            studio.fault(content[0])
        elif kind == "clock":
            studio.clock = content[0]
        elif kind == "finish":
            pipe.send(True)
        else:
            return


class CameraStream(contextlib.AbstractContextManager):
    """The camera above the virtual table, in a process of its own.

    Args:
        setup: Gives the table, its tags, the cable and the arm.
        config: Settings of the camera; mounted over the table if None.
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
            target=_serve,
            args=(theirs, self._room, setup, self.config, seed, clock, port),
            daemon=True,
        )
        self._process.start()
        theirs.close()
        if not self._pipe.poll(_START_TIMEOUT):
            self.close()
            raise RigError(f"the virtual camera did not start within {_START_TIMEOUT:g} s")
        self.url: str = self._receive()

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
        """
        if name is not None and name not in FAULTS:
            raise UnknownNameError(f"unknown fault {name!r} of a camera: {', '.join(FAULTS)}")
        self._send(("fault", name))
        self.finish()

    def set_clock(self, clock: float) -> None:
        """Let the camera's clock show a time when the laboratory's shows zero [s]."""
        self._send(("clock", float(clock)))
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

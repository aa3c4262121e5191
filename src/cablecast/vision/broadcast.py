"""Broadcast: a web server on the loopback address that sends one camera's pictures to its viewers.

`/camera.nut` carries times: JPEG pictures in a NUT stream. OpenCV counts the times of a stream from
its first picture, so that one is sent with time zero, and those that follow have the times of the
camera's clock. `/camera.mjpg` is the stream of the usual network camera, without any times.
"""

import contextlib
import http.server
import queue
import socket
import threading
from typing import Any

from cablecast.vision.video import JpegMuxer

HOST = "127.0.0.1"

_QUEUE_LENGTH = 2
"""Pictures that wait for a viewer."""
_SEND_BUFFER = 1 << 16
"""Bytes that the system keeps for a viewer: little, for what waits there is old when it arrives."""
_PATIENCE = 60.0
"""Time for which a viewer that takes no picture is waited for [s]."""
_TYPES = {"/camera.nut": "video/x-nut", "/camera.mjpg": "multipart/x-mixed-replace; boundary=next"}

_Picture = tuple[bytes, float]


class Broadcast:
    """Server of one stream.

    Args:
        width: Width of the pictures [px].
        height: Height of the pictures [px].
        rate: Pictures per second [1/s].
        port: Port on the loopback address; a free one where 0.
    """

    def __init__(self, width: int, height: int, rate: float, port: int = 0):
        self.format = width, height, rate
        self.latest: bytes | None = None
        self.port = port
        self.viewers: list[_Viewer] = []
        self._server: _Server | None = None
        self.plug()

    @property
    def url(self) -> str:
        """Address of the stream that carries times."""
        return f"http://{HOST}:{self.port}/camera.nut"

    @property
    def viewer_count(self) -> int:
        """Number of viewers."""
        return len(self.viewers)

    def plug(self) -> None:
        """Let viewers connect."""
        if self._server is None:
            self._server = _Server(self)
            self.port = self._server.server_port
            threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def unplug(self) -> None:
        """Cut off all viewers, and let none connect."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None
        for viewer in list(self.viewers):
            viewer.leave()

    def send(self, jpeg: bytes, time: float) -> None:
        """Send a picture to all viewers, and wait for those that are behind.

        Args:
            jpeg: Picture as JPEG.
            time: Its time in the camera's clock [s].
        """
        self.latest = jpeg
        for viewer in list(self.viewers):
            viewer.put((jpeg, time))


class _Viewer:
    """Pictures that wait for one viewer."""

    def __init__(self, broadcast: Broadcast):
        self._viewers = broadcast.viewers
        self._queue: queue.Queue[_Picture] = queue.Queue(_QUEUE_LENGTH)
        self._gone = threading.Event()
        self._viewers.append(self)

    def put(self, picture: _Picture) -> None:
        """Add a picture; a viewer that takes none for long is dropped."""
        if not self._gone.is_set():
            try:
                self._queue.put(picture, timeout=_PATIENCE)
            except queue.Full:
                self.leave()

    def get(self) -> _Picture | None:
        """Return the next picture; None at the end."""
        while not self._gone.is_set():
            with contextlib.suppress(queue.Empty):
                return self._queue.get(timeout=0.1)
        return None

    def leave(self) -> None:
        """End the stream of this viewer."""
        self._gone.set()
        with contextlib.suppress(ValueError):
            self._viewers.remove(self)
        # Whoever waits for room in the queue must not wait on.
        with contextlib.suppress(queue.Empty):
            while True:
                self._queue.get_nowait()


class _Server(http.server.ThreadingHTTPServer):
    """HTTP server that knows its broadcast."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, broadcast: Broadcast):
        self.broadcast = broadcast
        super().__init__((HOST, broadcast.port), _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a viewer may leave at any time."""


class _Handler(http.server.BaseHTTPRequestHandler):
    """One viewer's connection."""

    server: _Server

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing on the terminal."""

    def do_GET(self) -> None:
        """Send the stream until the viewer leaves."""
        if self.path not in _TYPES:
            self.send_error(404)
            return
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self.send_response(200)
        self.send_header("Content-Type", _TYPES[self.path])
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        viewer = _Viewer(self.server.broadcast)
        try:
            self._send_timed(viewer) if self.path.endswith(".nut") else self._send_plain(viewer)
        except OSError:
            pass
        finally:
            viewer.leave()

    def _send_timed(self, viewer: _Viewer) -> None:
        broadcast = self.server.broadcast
        muxer = JpegMuxer(self.wfile, "nut", *broadcast.format)
        if broadcast.latest is not None:
            muxer.write(broadcast.latest, 0.0)
        while (picture := viewer.get()) is not None:
            muxer.write(*picture)

    def _send_plain(self, viewer: _Viewer) -> None:
        while (picture := viewer.get()) is not None:
            jpeg = picture[0]
            head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            self.wfile.write(head.encode() + jpeg + b"\r\n")

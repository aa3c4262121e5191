"""Broadcast: a web server on the loopback address that sends one camera's pictures to its viewers.

`/camera.nut` carries times: JPEG pictures in a NUT stream. OpenCV counts the times of a stream from
its first picture, so that one is sent with time zero, and those that follow have the times of the
camera's clock. `/camera.mjpg` is the stream of a common network camera, without any times.
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

_Viewer = queue.Queue[tuple[bytes, float] | None]
"""Pictures that wait for one viewer, and their times; None ends its stream."""


class Broadcast:
    """Server of one stream of pictures of a size [px] and a rate [1/s]; port 0 is a free one."""

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
            self.part(viewer)

    def send(self, jpeg: bytes, time: float) -> None:
        """Send a picture of a time [s] to all viewers, and wait for those that are behind."""
        self.latest = jpeg
        for viewer in list(self.viewers):
            try:
                viewer.put((jpeg, time), timeout=_PATIENCE)
            except queue.Full:
                self.part(viewer)

    def part(self, viewer: _Viewer) -> None:
        """End the stream of a viewer."""
        with contextlib.suppress(ValueError):
            self.viewers.remove(viewer)
        # A sender that waits for room in the queue must go on.
        with contextlib.suppress(queue.Empty):
            while True:
                viewer.get_nowait()
        with contextlib.suppress(queue.Full):
            viewer.put_nowait(None)


class _Server(http.server.ThreadingHTTPServer):
    """HTTP server that knows its broadcast."""

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
        broadcast, viewer = self.server.broadcast, _Viewer(_QUEUE_LENGTH)
        broadcast.viewers.append(viewer)
        try:
            if self.path.endswith(".nut"):
                muxer = JpegMuxer(self.wfile, "nut", *broadcast.format)
                if broadcast.latest is not None:
                    muxer.write(broadcast.latest, 0.0)
                for picture in iter(viewer.get, None):
                    muxer.write(*picture)
            else:
                for jpeg, _ in iter(viewer.get, None):
                    head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}"
                    self.wfile.write(head.encode() + b"\r\n\r\n" + jpeg + b"\r\n")
        finally:
            broadcast.part(viewer)

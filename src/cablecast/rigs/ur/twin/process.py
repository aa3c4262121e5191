"""A twin in a process of its own, and the client that tests and people command it with.

Its clock must not stand still while a rig in the same process thinks.
"""

import atexit
import contextlib
import json
import multiprocessing
import multiprocessing.connection
import os
import signal
import socket
from typing import Any, Self

from cablecast.errors import CablecastError, InputError, RigError
from cablecast.rigs.ur.twin.laboratory import ADMIN_PORT, TwinConfig, TwinLaboratory
from cablecast.setup import Setup

_START_TIME_MAX = 180.0
_STOP_TIME_MAX = 5.0
_ANSWER_TIME_MAX = 30.0


class TwinProcess:
    """A running twin; as a context manager it stops at the end.

    Args:
        setup: Lab file of the twin, with a robot section.
        config: Where it listens, and how it behaves.

    Attributes:
        camera_url: Address of the camera's stream; None without a camera.
        admin: Client that commands the twin.

    Raises:
        InputError: A port is not free, or the set-up has no robot.
        RigError: The process did not start.
    """

    def __init__(self, setup: Setup, config: TwinConfig):
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe(duplex=False)
        # No daemon: it has a process of its own for the camera.
        self._process = context.Process(target=_serve, args=(setup, config, there))
        self._process.start()
        there.close()
        try:
            if not here.poll(_START_TIME_MAX):
                self._process.kill()
                raise RigError(f"the twin did not start within {_START_TIME_MAX:g} s")
            answer = here.recv()
        except EOFError:
            raise RigError("the twin's process ended while it started") from None
        finally:
            here.close()
        if "error" in answer:
            self._process.join(_STOP_TIME_MAX)
            raise InputError(answer["error"])
        self.camera_url: str | None = answer["camera"]
        self.admin = TwinClient(config.address)
        atexit.register(self.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the process ends."""
        self._process.join(timeout)

    def close(self) -> None:
        """Stop the process; it may be called twice."""
        atexit.unregister(self.close)
        self.admin.close()
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(_STOP_TIME_MAX)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(_STOP_TIME_MAX)


class TwinClient:
    """Commands a twin: makes faults, clears them, and asks what is true.

    Args:
        address: Address of the twin.

    Raises:
        RigError: No twin answers.
    """

    def __init__(self, address: str):
        try:
            self._socket = socket.create_connection((address, ADMIN_PORT), _ANSWER_TIME_MAX)
        except OSError as error:
            raise RigError(
                f"no twin answers at {address}:{ADMIN_PORT} ({error.strerror or error}): "
                "start `cablecast twin`"
            ) from None
        self._stream = self._socket.makefile("rw", encoding="utf-8")

    def close(self) -> None:
        """Close the connection; it may be called twice."""
        with contextlib.suppress(OSError):
            self._stream.close()
        self._socket.close()

    def fault(self, name: str, phase: str = "now", after: float = 0.0) -> None:
        """Let a fault come, see `Fault`."""
        self._ask("fault", name=name, phase=phase, after=after)

    def clear(self) -> None:
        """Do what a person does after a stop, and forget faults that still wait."""
        self._ask("clear")

    def state(self) -> dict[str, Any]:
        """Return what the twin does now."""
        return self._ask("state")

    def events(self) -> list[dict[str, Any]]:
        """Return what happened, each with its time by the twin's clock."""
        return self._ask("events")["events"]

    def truth(self, since: float, until: float) -> dict[str, Any]:
        """Return the true way of the endpoint [m], and the speed of the fastest joint [rad/s].

        Args:
            since: Start by the twin's clock [s].
            until: End by the twin's clock [s].
        """
        return self._ask("truth", since=since, until=until)

    def _ask(self, do: str, **values: Any) -> dict[str, Any]:
        try:
            self._stream.write(json.dumps({"do": do, **values}) + "\n")
            self._stream.flush()
            line = self._stream.readline()
            if not line:
                raise OSError("it closed the connection")
        except (OSError, ValueError) as error:
            raise RigError(f"the twin does not answer: {error}") from None
        answer = json.loads(line)
        if "error" in answer:
            raise InputError(f"the twin refuses {do}: {answer['error']}")
        return answer


def _serve(setup: Setup, config: TwinConfig, there: multiprocessing.connection.Connection) -> None:
    """Run a twin in this process until it is terminated."""
    try:
        laboratory = TwinLaboratory(setup, config)
    except CablecastError as error:
        there.send({"error": str(error)})
        return
    # Ctrl-C reaches all processes of a terminal: the twin stops with the one that started it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))
    url = None if laboratory.camera is None else laboratory.camera.url
    there.send({"camera": url})
    there.close()
    parent = os.getppid()
    try:
        # A twin whose starter was killed would hold its ports for ever.
        laboratory.run(lambda: not ended and os.getppid() == parent)
    finally:
        laboratory.close()

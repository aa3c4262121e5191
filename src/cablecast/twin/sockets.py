"""Sockets of the twin: all in one thread, on the loopback address only."""

import contextlib
import ipaddress
import selectors
import socket
from collections.abc import Callable

from cablecast.errors import InputError

_RECEIVE_SIZE = 1 << 16
_SEND_MAX = 1 << 22
"""Most bytes that wait for a client who does not read; then it is dropped, as a controller does."""


def check_loopback(address: str) -> str:
    """Return an address of this computer that nobody else can reach.

    Raises:
        InputError: It is another address.
    """
    try:
        if ipaddress.ip_address(address).is_loopback:
            return address
    except ValueError:
        pass
    raise InputError(f"the twin listens on a loopback address such as 127.0.0.1, not on {address}")


class Client:
    """One connection of a client.

    Attributes:
        kind: Name of the server that it came to.
        state: Whatever the server keeps about it.
    """

    def __init__(self, connection: socket.socket, kind: str):
        self.connection = connection
        self.kind = kind
        self.state: dict = {}
        self.open = True
        self._waiting = b""

    def send(self, data: bytes) -> None:
        """Send now what goes, and the rest later."""
        self._waiting += data
        self.flush()

    def flush(self) -> None:
        """Send what waits."""
        if not self.open:
            return
        try:
            while self._waiting:
                self._waiting = self._waiting[self.connection.send(self._waiting) :]
        except BlockingIOError:
            if len(self._waiting) > _SEND_MAX:
                self.open = False
        except OSError:
            self.open = False


class Servers:
    """Listening sockets and their clients.

    Args:
        address: Loopback address.
        ports: Port by the name of the server; 0 for any free one.

    Raises:
        InputError: The address is not of this computer, or a port is taken.
    """

    def __init__(self, address: str, ports: dict[str, int]):
        self.address = check_loopback(address)
        self.ports = dict(ports)
        self.clients: list[Client] = []
        self.muted = False
        self._selector = selectors.DefaultSelector()
        self._listening: dict[str, socket.socket] = {}
        try:
            for name in ports:
                self.listen(name)
        except InputError:
            self.close()
            raise

    def listen(self, name: str) -> None:
        """Open a server's port."""
        server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind((self.address, self.ports[name]))
        except OSError as error:
            server.close()
            raise InputError(
                f"port {self.ports[name]} of {self.address} is not free ({error.strerror}): is "
                "another twin running?"
            ) from None
        self.ports[name] = server.getsockname()[1]
        server.listen()
        server.setblocking(False)
        self._listening[name] = server
        self._selector.register(server, selectors.EVENT_READ, name)

    def drop(self, names: set[str]) -> None:
        """Close servers and their clients, as a controller without power does."""
        for name in names & set(self._listening):
            self._selector.unregister(self._listening[name])
            self._listening.pop(name).close()
        for client in self.clients:
            if client.kind in names:
                client.open = False
        self._forget_closed()

    def of(self, kind: str) -> list[Client]:
        """Return the clients of a server."""
        return [client for client in self.clients if client.kind == kind and client.open]

    def poll(
        self,
        timeout: float,
        accepted: Callable[[Client], None],
        received: Callable[[Client, bytes], None],
    ) -> None:
        """Wait for what clients send, and hand it on.

        Args:
            timeout: Longest time to wait [s].
            accepted: Called with every new client.
            received: Called with a client and what it sent.
        """
        for key, _ in self._selector.select(max(timeout, 0.0)):
            if isinstance(key.data, str):
                self._accept(key.fileobj, key.data, accepted)  # pyright: ignore
                continue
            client: Client = key.data
            try:
                data = client.connection.recv(_RECEIVE_SIZE)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if not data:
                client.open = False
            else:
                received(client, data)
        for client in self.clients:
            client.flush()
        self._forget_closed()

    def _accept(self, server: socket.socket, name: str, accepted: Callable[[Client], None]) -> None:
        with contextlib.suppress(OSError):
            connection, _ = server.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = Client(connection, name)
            self.clients.append(client)
            self._selector.register(connection, selectors.EVENT_READ, client)
            accepted(client)

    def _forget_closed(self) -> None:
        for client in [client for client in self.clients if not client.open]:
            self.clients.remove(client)
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(client.connection)
            client.connection.close()

    def close(self) -> None:
        """Close everything."""
        self.drop(set(self._listening) | {client.kind for client in self.clients})
        self._selector.close()

"""A server of the page, started without a banner."""

import contextlib
import io
from typing import TYPE_CHECKING

from cablecast.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    import viser


def start_server(host: str, port: int) -> "viser.ViserServer":
    """Start a server of the page.

    Args:
        host: Address to listen on.
        port: Port to listen on; the next free one if it is taken.

    Raises:
        MissingExtraError: viser is not installed.
        InputError: The address cannot be listened on.
    """
    try:
        import viser
    except ImportError:
        raise MissingExtraError("viser", "view", "the page") from None
    try:
        # It prints a table of addresses whatever it is told; ours is printed by the command.
        with contextlib.redirect_stdout(io.StringIO()):
            return viser.ViserServer(host=host, port=port, label="cablecast", verbose=False)
    except OSError as error:
        raise InputError(f"host {host!r}, port {port} cannot be listened on: {error}") from None


def stop_server(server: "viser.ViserServer") -> None:
    """Stop a server, as quietly as it was started."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()

"""Host: what the controls may ask of the page that they stand on."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from cablecast.view.desk import Desk
from cablecast.view.player import Player
from cablecast.view.worker import Worker

if TYPE_CHECKING:
    import viser


class Host(Protocol):
    """Page with a desk, a worker and a player; `Page` answers it.

    Attributes:
        server: Server of the page.
        desk: State of the table.
        worker: Thread for casts and long work.
        player: Player of the figures.
    """

    server: "viser.ViserServer"
    desk: Desk
    worker: Worker
    player: Player

    @property
    def rig_is_real(self) -> bool:
        """True for a rig that moves something, so that a person is asked twice."""
        ...

    def aim_polar(self, r: float, theta_deg: float) -> None:
        """Choose a target by its distance [m] and its angle [deg]."""
        ...

    def cast(self) -> None:
        """Cast as planned."""
        ...

    def correct(self) -> None:
        """Plan again against the last miss, and cast."""
        ...

    def undo(self) -> None:
        """Take the last try back."""
        ...

    def stop(self) -> None:
        """Stop the work under way."""
        ...

    def prepare(self) -> None:
        """Get ready for the first target: casts, fit, simulation, training."""
        ...

    def refit(self) -> None:
        """Fit the simulator to all casts of the session, and learn anew from it."""
        ...

    def replay(self, number: int) -> None:
        """Show a cast of the session again, by its number."""
        ...

    def set_dark(self, dark: bool) -> None:
        """Make the page dark or light."""
        ...

    def show_map(self, visible: bool) -> None:
        """Show or hide how far casts are expected to miss."""
        ...

    def guard(self, action: Callable[[], Any]) -> None:
        """Do something, and show the sentence of an error in every tab."""
        ...

    def clear_stage(self) -> None:
        """Hide the figures and the marks of plan and cast."""
        ...

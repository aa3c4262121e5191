"""Controls below the tabs: the time that is shown, and how the scene looks."""

from typing import Any

from cablecast.view.figure import set_changed
from cablecast.view.host import Host
from cablecast.view.shapes import MAP_COLORS, MAP_FULL_SHARE, MissMap

_SPEEDS = {"1": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1}
_SHOWN_EVERY = 0.2
"""Least change of the time that moves the slider [s]: every move is sent to every tab."""


class PlaybackControls:
    """Time slider, pause and speed of what is played, the map of expected misses, dark colours.

    They stand below the tabs, since plans, tries and looked-at casts are all played.

    Args:
        page: Page that the controls act on.
        dark: True for a page that begins dark.
    """

    def __init__(self, page: Host, dark: bool = False):
        self._page = page
        gui: Any = page.server.gui
        with gui.add_folder("Playback"):
            self._time = gui.add_slider("time [s]", 0.0, 5.0, 0.02, 0.0)
            self._time.on_update(self._seek)
            self._speed = gui.add_dropdown("speed", tuple(_SPEEDS), initial_value="1")
            self._speed.on_update(lambda _: self._set_speed())
            self._play = gui.add_button("Play or pause", color="gray", icon="player-play")
            self._play.on_click(lambda _: page.player.toggle())
        with gui.add_folder("View", expand_by_default=False):
            self._map = gui.add_checkbox("Where it can land", False, disabled=True)
            self._map.on_update(lambda _: page.guard(lambda: page.show_map(self._map.value)))
            self._legend = gui.add_markdown("", visible=False)
            self._dark = gui.add_checkbox("Dark", dark)
            self._dark.on_update(lambda _: page.set_dark(self._dark.value))
        self._shown_time = -1.0

    def refresh(self) -> None:
        """Offer the map where there is a model to draw it from."""
        set_changed(self._map, "disabled", self._page.desk.session is None)

    def show_time(self, time: float, duration: float) -> None:
        """Move the time slider, at most five times a second."""
        if abs(time - self._shown_time) < _SHOWN_EVERY and 0.0 < time < duration:
            return
        self._shown_time = time
        if duration > 0 and abs(self._time.max - duration) > 1e-6:
            self._time.max = round(duration, 2)
        set_changed(self._time, "value", round(min(time, duration), 2))

    def explain_map(self, shown: MissMap | None) -> None:
        """Say what the colours of the map mean; nothing where it is hidden."""
        set_changed(self._legend, "visible", shown is not None)
        if shown is not None:
            set_changed(self._legend, "content", legend_text(shown))

    def _seek(self, event: Any) -> None:
        # Setting the value from here comes without a client.
        if event.client is not None:
            self._page.player.seek(float(self._time.value))

    def _set_speed(self) -> None:
        self._page.player.speed = _SPEEDS[str(self._speed.value)]


def legend_text(shown: MissMap) -> str:
    """Return what the colours of a map mean, in Markdown."""
    swatches = []
    for place, (red, green, blue) in enumerate(MAP_COLORS.astype(int)):
        share = 100.0 * MAP_FULL_SHARE * place / (len(MAP_COLORS) - 1)
        more = " and more" if place == len(MAP_COLORS) - 1 else ""
        swatches.append(
            f'<span style="color: rgb({red},{green},{blue})">■</span> {share:.3g}{more}'
        )
    what = (
        "with the scatter of real casts"
        if shown.is_measured
        else "with what an action that is off by 1° and 1 cm adds"
    )
    return f"Expected miss of a first cast, {what}, in % of the cable's length: " + ", ".join(
        swatches
    )

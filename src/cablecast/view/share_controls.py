"""Controls to share casts of the session: one HTML file, an MP4 or a GIF, sent to the browser."""

import pathlib
import tempfile
from typing import Any

from cablecast.errors import InputError
from cablecast.pipeline.aim_session import AimTrial
from cablecast.runs.progress import ProgressCallback
from cablecast.track import TrialStatus
from cablecast.view.film import KINDS, FilmConfig, write_film
from cablecast.view.host import Host
from cablecast.view.picture import Shot

_SIZES = {"640 x 360": (640, 360), "960 x 540": (960, 540), "1280 x 720": (1280, 720)}


class ShareControls:
    """Casts, kind and size of a film.

    Args:
        host: Page that the controls act on.
    """

    def __init__(self, host: Host):
        self._host = host
        gui: Any = host.server.gui
        gui.add_markdown("A film of the session, to keep or to send.")
        self._what = gui.add_dropdown("Casts", ("the last try", "this target", "all tries"))
        self._kind = gui.add_dropdown("Kind", tuple(kind[1:].upper() for kind in KINDS))
        self._size = gui.add_dropdown("Size", tuple(_SIZES), initial_value="960 x 540")
        gui.add_button("Film", color="blue", icon="movie").on_click(
            lambda _: host.guard(lambda: host.worker.submit("a film", self._film))
        )
        gui.add_markdown("`cablecast film` does the same without a page.")

    def _film(self, report: ProgressCallback) -> None:
        desk = self._host.desk
        shots = [self._shot(trial) for trial in self._trials()]
        width, height = _SIZES[str(self._size.value)]
        name = f"casts.{str(self._kind.value).lower()}"
        with tempfile.TemporaryDirectory(prefix="cablecast-") as folder:
            path = pathlib.Path(folder) / name
            write_film(path, desk.setup, shots, FilmConfig(width=width, height=height), report)
            self._host.server.send_file_download(name, path.read_bytes())

    def _trials(self) -> list[AimTrial]:
        desk = self._host.desk
        if desk.last is None:
            raise InputError("there is nothing to film yet: cast first")
        if self._what.value == "the last try":
            return [desk.last]
        if self._what.value == "this target":
            return desk.tries_at(desk.last.target_xy)
        return [trial for trial in desk.tries if not desk.is_undone(trial)]

    def _shot(self, trial: AimTrial) -> Shot:
        landed = trial.status is TrialStatus.OK
        miss = f"{trial.miss_pct:.1f} % of the cable's length off"
        return Shot(
            cast=self._host.desk.shown(trial),
            target_xy=trial.target_xy,
            caption=f"try {trial.try_number}",
            result=f"try {trial.try_number}: {miss if landed else trial.status.value}",
        )

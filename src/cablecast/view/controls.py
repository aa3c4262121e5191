"""Host: what the controls may ask of the page that they stand on.

Texts of the page: the state of the table, a plan, and the tries.

Controls of the page: the tabs beside the scene. They hold no state of their own.

Controls below the tabs: the time that is shown, and how the scene looks.

Controls of the camera: its latest picture, where the rig has one.

Controls to look at casts of a folder: measured and simulated side by side, with sliders.

Controls to share casts of the session: one HTML file, an MP4 or a GIF, sent to the browser.

Controls of long work: start it, see how far it is, stop it, go on.
"""

import dataclasses
import math
import pathlib
import tempfile
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur import JOINT_NAMES
from cablecast.cable import PARAMS, CableParams
from cablecast.cast import TrialStatus
from cablecast.conventions import xy_to_polar
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import CablecastError, InputError
from cablecast.pipeline.aim_session import AimTrial
from cablecast.runs.progress import ProgressCallback, duration_text
from cablecast.view.desk import Desk, Phase, Preview
from cablecast.view.film import KINDS, FilmConfig, write_film
from cablecast.view.look import Collection, Player, Shot, ShownCast, open_collection
from cablecast.view.scene import EXPECTED_SHARE, Figure, set_changed
from cablecast.view.shapes import (
    BLUE,
    GREEN,
    MAP_COLORS,
    MAP_FULL_SHARE,
    PURPLE,
    VERMILLION,
    Color,
    MissMap,
)
from cablecast.view.worker import WORKS, Worker, WorkState, long_work

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


_ROWS = 5
"""Number of tries in the table; the others can be chosen from the list below it."""

_WORTH_SAYING = 0.1
"""Chance of a cast without a landing that is worth a line."""


_TOUR = (
    "**Cast a few times.** The rig casts, and it is seen where the cable goes.",
    "**Fit.** The simulated cable is changed until it moves as yours did.",
    "**Simulate.** It casts in every way that the arm can move.",
    "**Learn.** A model keeps where those casts landed.",
    "**Point.** Choose a target with a click: a ghost shows the planned cast.",
    "**Cast.** Watch the cable, and read how far it missed. Then correct, and cast again.",
)
"""Steps of a newcomer up to the first cast; the first four are those of `prepare_aim`."""

_PREPARED_COUNT = 4


def tour_text(desk: Desk, state: WorkState) -> str:
    """Return the steps up to the first cast, with where one is; nothing after that cast."""
    if desk.tries:
        return ""
    if desk.session is None:
        now = max(state.step, 1) if state.name else 0
    else:
        now = _PREPARED_COUNT + (1 if desk.preview is None else 2)
    lines = []
    for number, what in enumerate(_TOUR, start=1):
        mark = "✓" if number < now else "▶" if number == now else "○"
        lines.append(f"{mark} {what}")
    return "\n\n".join(lines)


def plan_text(preview: Preview, desk: Desk) -> str:
    """Return what to expect of a plan, as a table in Markdown."""
    proposal = preview.proposal
    length = proposal.cable_length
    r, theta = xy_to_polar(proposal.target_xy)
    offset = float(np.linalg.norm(proposal.expected_xy - proposal.target_xy))
    major, minor, _ = (100.0 / length * value for value in proposal.ellipse(EXPECTED_SHARE))
    shares = 100.0 * preview.limit_shares
    fastest, hardest = (int(np.argmax(row)) for row in shares)
    rows = [
        ("target", f"{r:.3f} m, {math.degrees(theta):.1f}°, try {proposal.try_number}"),
        ("expected", f"{100 * offset:.1f} cm ({100 * offset / length:.1f} %) beside it"),
        (f"{100 * EXPECTED_SHARE:.0f} % land", f"within {major:.0f} by {minor:.0f} %"),
        ("duration", f"{proposal.trajectory.duration:.2f} s"),
        ("joint speed", f"{shares[0, fastest]:.0f} % of its limit ({JOINT_NAMES[fastest]})"),
        ("joint accel.", f"{shares[1, hardest]:.0f} % of its limit ({JOINT_NAMES[hardest]})"),
        ("table's edge", f"{100 * preview.margin:.0f} cm away"),
    ]
    if proposal.failure > _WORTH_SAYING:
        rows.append(("may fail", f"{100 * proposal.failure:.0f} % hidden or off the table"))
    lines = ["| plan | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)]
    if not proposal.inside_coverage:
        lines.append("\nNo simulated cast lands here: this is the nearest.")
    return "\n".join(lines)


def tries_text(desk: Desk) -> str:
    """Return the last tries as a table in Markdown."""
    lines = ["| try | target | miss |", "|---|---|---|"]
    for one in desk.tries[-_ROWS:]:
        r, theta = xy_to_polar(one.target_xy)
        miss = one.status.code.replace("_", " ")
        if math.isfinite(one.miss_pct):
            miss = f"{one.miss_pct * desk.setup.cable.length:.1f} cm, {one.miss_pct:.1f} %"
        if desk.is_undone(one):
            miss = f"~~{miss}~~"
        lines.append(
            f"| {one.try_number} | {r:.2f} m, {math.degrees(theta):.0f}° | "
            f"{'**' + miss + '**' if one.hit else miss} |"
        )
    return "\n".join(lines)


def status_text(desk: Desk, state: WorkState) -> str:
    """Return the state of the table, and what to do next."""
    if state.name:
        text = f"**{state.name[:1].upper()}{state.name[1:]} is under way.**"
        if state.progress is not None:
            progress = state.progress
            text += f"\n\n{progress.task}"
            if progress.total:
                text += f": {progress.done} of {progress.total} {progress.unit}"
            if state.seconds_left is not None:
                text += f", about {duration_text(state.seconds_left)} left"
        return text
    news = state.message or desk.message
    last = desk.last
    head = desk.phase.value
    if desk.phase is Phase.LANDED and last is not None and math.isfinite(last.miss_pct):
        verdict = "Hit" if last.hit else "Landed"
        centimetres = last.miss_pct * desk.setup.cable.length
        head = f"{verdict}: {centimetres:.1f} cm ({last.miss_pct:.1f} %) from the target. {head}"
    return f"**{head}**" + (f"\n\n{news[:1].upper()}{news[1:]}" if news else "")


def try_name(one: AimTrial) -> str:
    """Return the name of a try in a list."""
    r, theta = xy_to_polar(one.target_xy)
    return f"{one.number}: {r:.2f} m, {math.degrees(theta):.0f}°, try {one.try_number}"


class CastControls:
    """Target, plan, cast, correct, undo, and the tries so far.

    Args:
        page: Page that the controls act on.
    """

    def __init__(self, page: Host):
        self._page = page
        gui: Any = page.server.gui
        self._status = gui.add_markdown("")
        self._make = gui.add_button("Get ready", color="blue", icon="wand")
        self._make.on_click(lambda _: page.prepare())
        self._cast = gui.add_button("Cast", color="blue", icon="player-play-filled")
        self._cast.on_click(lambda _: self._ask() if page.rig_is_real else page.cast())
        self._correct = gui.add_button("Correct and cast again", color="blue", icon="target-arrow")
        self._correct.on_click(lambda _: self._ask(True) if page.rig_is_real else page.correct())
        self._stop = gui.add_button("Stop", color="red", icon="hand-stop")
        self._stop.on_click(lambda _: page.stop())
        self._bar = gui.add_progress_bar(0.0, animated=True)
        self._plan = gui.add_markdown("")
        self._tour = gui.add_markdown("", visible=False)
        with gui.add_folder("Target", expand_by_default=False):
            reach = page.desk.setup.workspace.reach(page.desk.setup.cable.length)
            self._r = gui.add_number("r [m]", 1.1, min=0.0, max=round(reach, 3), step=0.01)
            self._theta = gui.add_number("theta [deg]", 0.0, min=-90.0, max=90.0, step=0.5)
            gui.add_button("Plan", color="gray").on_click(
                lambda _: page.aim_polar(self._r.value, self._theta.value)
            )
        self._tries_folder = gui.add_folder("Tries")
        with self._tries_folder:
            self._table = gui.add_markdown("")
            self._number = gui.add_dropdown("Try", ("-",))
            self._replay = gui.add_button("Replay", color="gray", icon="repeat")
            self._replay.on_click(lambda _: self._replay_chosen())
            self._undo = gui.add_button("Undo the last try", color="gray", icon="arrow-back-up")
            self._undo.on_click(lambda _: page.undo())
            self._due = gui.add_markdown("", visible=False)
            self._refit = gui.add_button("Fit to all casts", color="gray", icon="refresh")
            self._refit.on_click(lambda _: page.refit())

    def refresh(self) -> None:
        """Show the state of desk and worker."""
        desk, state = self._page.desk, self._page.worker.state
        phase, busy = desk.phase, bool(state.name)
        set_changed(self._status, "content", status_text(desk, state))
        set_changed(self._make, "visible", phase is Phase.NO_MODEL)
        set_changed(self._make, "disabled", busy)
        set_changed(self._cast, "visible", phase in (Phase.READY, Phase.PLANNED, Phase.CASTING))
        set_changed(self._cast, "disabled", busy or desk.preview is None)
        set_changed(self._correct, "visible", phase is Phase.LANDED)
        set_changed(self._correct, "disabled", busy)
        set_changed(self._stop, "visible", busy)
        set_changed(self._bar, "visible", busy)
        progress = state.progress
        if progress is not None and progress.total:
            set_changed(self._bar, "value", round(100.0 * progress.done / progress.total, 1))
        elif busy:
            set_changed(self._bar, "value", 100.0)
        set_changed(
            self._plan, "content", "" if desk.preview is None else plan_text(desk.preview, desk)
        )
        tour = tour_text(desk, state)
        set_changed(self._tour, "visible", bool(tour))
        set_changed(self._tour, "content", tour)
        set_changed(self._tries_folder, "visible", bool(desk.tries))
        set_changed(self._table, "content", tries_text(desk))
        names = tuple(try_name(one) for one in desk.tries) or ("-",)
        if tuple(self._number.options) != names:
            self._number.options = names
            self._number.value = names[-1]
        set_changed(self._undo, "disabled", busy or desk.last is None)
        due = desk.refit_reason
        set_changed(self._due, "visible", bool(due))
        set_changed(self._due, "content", f"A new fit is worth it: {due}.")
        set_changed(self._refit, "color", "blue" if due else "gray")
        set_changed(self._refit, "disabled", busy)

    def _replay_chosen(self) -> None:
        for one in self._page.desk.tries:
            if try_name(one) == self._number.value:
                self._page.guard(lambda number=one.number: self._page.replay(number))

    def _ask(self, corrected: bool = False) -> None:
        """Ask before a real arm moves."""
        gui: Any = self._page.server.gui
        with gui.add_modal("The arm will move") as modal:
            gui.add_markdown("Is everybody out of its reach, and the emergency stop at hand?")
            yes = gui.add_button("Yes, cast", color="red")
            no = gui.add_button("No")

        def answer(go: bool) -> None:
            modal.close()
            if go:
                (self._page.correct if corrected else self._page.cast)()

        yes.on_click(lambda _: answer(True))
        no.on_click(lambda _: answer(False))


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
    return (
        "Expected miss of a first cast, with what an action that is off by 1° and 1 cm adds, in % "
        f"of the cable's length: {', '.join(swatches)}"
    )


_EVERY = 0.5
"""Time between two looks at the camera [s]."""

WIDTH = 480
"""Largest width of the picture that is sent [pixel]."""


class CameraControls:
    """The picture of the rig's camera; nothing for a rig without one.

    A thread of its own asks the rig, also while the arm moves.

    Args:
        host: Page that the controls act on.
    """

    def __init__(self, host: Host):
        self._source = getattr(host.desk.rig, "picture", None)
        self._last: NDArray[np.uint8] | None = None
        self._ended = threading.Event()
        gui: Any = host.server.gui
        self._folder = gui.add_folder("Camera", visible=False)
        with self._folder:
            empty = np.zeros((9, 16, 3), dtype=np.uint8)
            self._image = gui.add_image(empty, format="jpeg", jpeg_quality=80)
            self._text = gui.add_markdown("", visible=False)
        if self._source is not None:
            threading.Thread(target=self._watch, name="camera", daemon=True).start()

    def close(self) -> None:
        """Look no more."""
        self._ended.set()

    def look(self) -> None:
        """Show the latest picture, or why there is none."""
        if self._source is None:
            return
        try:
            picture, trouble = self._source(), ""
        except CablecastError as error:
            picture, trouble = None, str(error)
        set_changed(self._text, "content", trouble)
        set_changed(self._text, "visible", bool(trouble))
        if picture is not None and picture is not self._last:
            self._last = picture
            self._image.image = shrunk(picture)
        set_changed(self._folder, "visible", self._last is not None or bool(trouble))

    def _watch(self) -> None:
        while not self._ended.wait(_EVERY):
            self.look()


def shrunk(picture: NDArray[np.uint8], width: int = WIDTH) -> NDArray[np.uint8]:
    """Return a picture as RGB, at most so wide.

    Args:
        picture: Picture, BGR, shape [v, u, 3].
        width: Largest width [pixel].
    """
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(picture[..., ::-1]))
    return np.asarray(image.reduce(max(1, -(-image.width // width))))


SLIDERS = (
    "bend_stiffness",
    "twist_stiffness",
    "mass",
    "endpoint_mass",
    "worksurface_friction",
    "rolling_friction",
    "linear_damping",
)
"""Parameters that have a slider; of both frictions the product alone counts."""

FACTOR_MAX = 10.0
"""Sliders multiply a parameter by up to this factor, or divide it."""

_COLORS: dict[str, Color] = {
    "measured": BLUE,
    "believed": VERMILLION,
    "tuned": GREEN,
    "sliders": PURPLE,
    "MuJoCo": (230, 159, 0),
}


def slid_params(base: CableParams, exponents: dict[str, float]) -> CableParams:
    """Return parameters multiplied by powers of ten, within their bounds.

    Args:
        base: Parameters where all sliders are at zero.
        exponents: Powers of ten by the name of the parameter, from -1 to 1.

    Raises:
        InputError: A name or a power is out of bounds: nothing from a browser is trusted.
    """
    changes = {}
    for name, exponent in exponents.items():
        if name not in PARAMS or not abs(exponent) <= np.log10(FACTOR_MAX) + 1e-9:
            raise InputError(f"slider {name} = {exponent:g} is outside [-1, 1]")
        low, high = PARAMS[name].bounds
        value = float(np.asarray(getattr(base, name))) * 10.0**exponent
        changes[name] = float(np.clip(value, low, high))
    return dataclasses.replace(base, **changes)


class LookControls:
    """Folder, cast, kinds of motion that are shown, and sliders of the cable's parameters.

    Args:
        host: Page that the controls act on.
        folder: Folder that is suggested.
    """

    def __init__(self, host: Host, folder: pathlib.Path | None = None):
        self._host = host
        self._collection: Collection | None = None
        self._index = 0
        self._figures: dict[str, Figure] = {}
        self._shown: dict[str, ShownCast] = {}
        gui: Any = host.server.gui
        gui.add_markdown("Casts of `collect`, `tune`, `evaluate`, `simulate` or `aim`.")
        self._folder = gui.add_text("Folder", "" if folder is None else str(folder))
        gui.add_button("Open", color="blue", icon="folder-open").on_click(lambda _: self._open())
        self._cast = gui.add_dropdown("Cast", ("-",))
        self._cast.on_update(lambda _: self._choose())
        self._boxes = {
            name: gui.add_checkbox(name, name == "measured", disabled=True)
            for name in ("measured", "believed", "tuned", "sliders")
        }
        for name, box in self._boxes.items():
            box.on_update(lambda _, name=name: host.guard(lambda: self._show_kind(name)))
        self._mujoco = gui.add_button("Compare with MuJoCo", color="gray", disabled=True)
        self._mujoco.on_click(lambda _: host.guard(lambda: self._compare()))
        self._text = gui.add_markdown("")
        with gui.add_folder("Parameters of the cable (powers of ten)"):
            self._sliders = {
                name: gui.add_slider(name.replace("_", " "), -1.0, 1.0, 0.05, 0.0, disabled=True)
                for name in SLIDERS
            }
        for slider in self._sliders.values():
            slider.on_update(lambda event: self._slide() if event.client is not None else None)
        self._wake = threading.Event()
        threading.Thread(target=self._follow_sliders, name="sliders", daemon=True).start()

    def hide(self) -> None:
        """Clear the stage for a plan or a cast."""
        for figure in self._figures.values():
            figure.visible = False
        self._shown = {}

    def open(self, folder: str) -> None:
        """Show the casts of a folder.

        Raises:
            DatasetError: It holds none.
        """
        collection = open_collection(pathlib.Path(folder.strip()).expanduser())
        if not len(collection):
            raise InputError(f"{folder} holds no cast yet")
        if collection.setup.workspace != self._host.desk.setup.workspace:
            raise InputError("these casts were made on another table than the page shows")
        self._collection = collection
        self._cast.options = tuple(one.label for one in collection.casts)
        for slider in self._sliders.values():
            slider.disabled = False
        for name, box in self._boxes.items():
            box.disabled = name == "tuned" and collection.tuned is None
        self._mujoco.disabled = False
        self.show(0)

    def show(self, index: int) -> None:
        """Show a cast of the open folder in all kinds that are ticked."""
        self._host.clear_stage()
        self.hide()
        self._index = index
        kinds = [name for name, box in self._boxes.items() if box.value and not box.disabled]
        if self._need().casts[index].measured is None and "believed" not in kinds:
            self._boxes["believed"].value = True
            kinds.append("believed")
        for kind in kinds:
            self._make(kind)
        self._play()

    def _open(self) -> None:
        self._host.guard(lambda: self.open(str(self._folder.value)))

    def _choose(self) -> None:
        collection = self._collection
        if collection is None:
            return
        labels = [one.label for one in collection.casts]
        if self._cast.value in labels:
            index = labels.index(str(self._cast.value))
            self._host.guard(lambda: self.show(index))

    def _show_kind(self, kind: str) -> None:
        if self._collection is None:
            return
        if self._boxes[kind].value:
            self._make(kind)
        else:
            self._shown.pop(kind, None)
            if kind in self._figures:
                self._figures[kind].visible = False
        self._play()

    def _make(self, kind: str) -> None:
        """Compute what one kind of motion looks like."""
        collection, engine = self._need(), self._host.desk.engine
        if kind == "measured":
            measured = collection.casts[self._index].measured
            if measured is not None:
                self._shown[kind] = measured()
        elif kind == "believed":
            self._shown[kind] = collection.simulated(self._index, engine)
        elif kind == "tuned":
            self._shown[kind] = collection.simulated(self._index, engine, collection.tuned)
        else:
            self._shown[kind] = collection.simulated(self._index, engine, self._slid())

    def _compare(self) -> None:
        from cablecast.engines.mujoco_ import EngineMujoco

        engine: Engine = EngineMujoco()
        collection = self._need()
        # MuJoCo's cable has no material beside the ten parameters.
        found = collection.tuned or collection.believed
        plain = found.with_params(found.params.without_material())
        self._shown["MuJoCo"] = collection.simulated(self._index, engine, plain)
        self._play()

    def _slide(self) -> None:
        self._boxes["sliders"].value = True
        self._wake.set()

    def _follow_sliders(self) -> None:
        """Simulate for the latest place of the sliders; places that were passed are left out."""
        while True:
            self._wake.wait()
            self._wake.clear()
            if self._collection is not None:
                self._host.guard(self._resimulate)

    def _resimulate(self) -> None:
        self._make("sliders")
        player = self._host.player
        self._stage(player.time if not player.playing else self._shown["sliders"].duration)

    def _slid(self) -> Dynamics:
        base = self._need().tuned or self._need().believed
        factors = {name: float(slider.value) for name, slider in self._sliders.items()}
        return base.with_params(slid_params(base.params, factors))

    def _play(self) -> None:
        self._host.player.play(self._acts())
        self._describe()

    def _stage(self, time: float) -> None:
        self._host.player.show(self._acts(), time)
        self._describe()

    def _acts(self) -> list[tuple[Figure, ShownCast]]:
        acts = []
        for kind, cast in self._shown.items():
            if kind not in self._figures:
                self._figures[kind] = Figure(
                    self._host.server,
                    f"/look/{kind}",
                    self._need().setup,
                    _COLORS[kind],
                    with_arm=not acts,
                )
            self._figures[kind].visible = True
            acts.append((self._figures[kind], cast))
        return acts

    def _describe(self) -> None:
        """Say which colour is which, and how far each ends from the measured cast."""
        length = self._need().setup.cable.length
        ends = {kind: cast.endpoint_xy[-1] for kind, cast in self._shown.items()}
        lines = ["| motion | ends at | from measured |", "|---|---|---|"]
        for kind, end in ends.items():
            red, green, blue = _COLORS[kind]
            swatch = f'<span style="color: rgb({red},{green},{blue})">■</span> {kind}'
            apart = ""
            if "measured" in ends and kind != "measured":
                apart = f"{100 * float(np.linalg.norm(end - ends['measured'])) / length:.1f} %"
            lines.append(f"| {swatch} | {end[0]:.2f}, {end[1]:.2f} m | {apart} |")
        text = "\n".join(lines)
        if self._text.content != text:
            self._text.content = text

    def _need(self) -> Collection:
        if self._collection is None:
            raise InputError("no folder is open: name one, and open it")
        return self._collection


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


class WorkControls:
    """Kind and amount of some work, its progress, and a stop.

    Args:
        host: Page that the controls act on.
        home: Folder of the cable's results, e.g. runs/cable_1.
    """

    def __init__(self, host: Host, home: pathlib.Path):
        self._host, self._home = host, home
        gui: Any = host.server.gui
        gui.add_markdown(
            f"The steps of the pipeline, in `{home}`. What was stopped goes on when it is started "
            "again, here or by its verb on the command line."
        )
        self._kind = gui.add_dropdown("Work", tuple(WORKS))
        self._kind.on_update(lambda _: self._suggest())
        self._amount = gui.add_number("casts", WORKS["collect"].amount, min=1, step=1)
        self._says = gui.add_markdown("")
        self._start = gui.add_button("Start, or go on", color="blue", icon="player-play-filled")
        self._start.on_click(lambda _: host.guard(self._begin))
        self._stop = gui.add_button("Stop the work", color="red", icon="hand-stop")
        self._stop.on_click(lambda _: host.stop())
        self._bar = gui.add_progress_bar(0.0)
        self._status = gui.add_markdown("")
        self._suggest()

    def refresh(self) -> None:
        """Show the state of the worker."""
        state = self._host.worker.state
        busy = bool(state.name)
        set_changed(self._start, "disabled", busy)
        set_changed(self._stop, "visible", busy)
        set_changed(self._bar, "visible", busy)
        text = status_text(self._host.desk, state) if busy else state.message
        set_changed(self._status, "content", text)
        progress = state.progress
        if progress is not None and progress.total:
            set_changed(self._bar, "value", round(100.0 * progress.done / progress.total, 1))

    def _suggest(self) -> None:
        known = WORKS[str(self._kind.value)]
        self._amount.visible = bool(known.unit)
        self._amount.label = known.unit or "amount"
        self._amount.value = known.amount
        self._says.content = f"`{self._kind.value}`: {known.says}, into `{known.folder}`."

    def _begin(self) -> None:
        kind, host = str(self._kind.value), self._host
        work = long_work(kind, host.desk.rig, self._home, int(self._amount.value))
        host.worker.submit(kind, work)

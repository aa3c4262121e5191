"""The page: the scene and the controls of a desk, for any number of tabs that see the same."""

import collections
import dataclasses
import functools
import pathlib
import tempfile
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.config import AimConfig
from cablecast.cable import PARAMS, CableParams
from cablecast.cast import Cast, EndpointTrack
from cablecast.errors import CablecastError, InputError
from cablecast.motion.trajectory import Trajectory
from cablecast.pipeline.aim import SESSION_FOLDER
from cablecast.report.words import refit_text
from cablecast.rigs.base import error_line
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.progress import ProgressCallback, ignore
from cablecast.view.arm_meshes import ArmMeshes
from cablecast.view.desk import Desk, Phase
from cablecast.view.film import FilmConfig
from cablecast.view.look import Collection, ShownCast, open_collection
from cablecast.view.scene import Stage, start_server, stop_server, update
from cablecast.view.shapes import BLUE, SLATE, viewpoint
from cablecast.view.tasks import Preview
from cablecast.view.words import (
    colors_text,
    literal,
    motions_text,
    plan_text,
    status_text,
    tour_text,
    tries_text,
    try_name,
)
from cablecast.view.worker import Work, Worker

if TYPE_CHECKING:
    import viser

WIDE = 1.3
"""Pictures of the scene at least this wide for their height are seen from one place."""

SIMULATED_RIGS = ("virtual", "engine", "twin")
"""Kinds of rigs that move nothing: any other is asked for twice."""

PHONE_STYLE = """<style>
@media (max-width: 36em) {
  [style*="width: 20em"] { width: 100% !important; }
  button.mantine-Button-root, button.mantine-Tabs-tab, input.mantine-Input-input {
    min-height: 44px !important; height: 44px !important;
  }
}
</style>"""
"""Lets viser's panel fill a phone's width: its own has 20 em there, which leaves a part empty.
What a finger touches is 44 pixels high."""

_RESHAPED = 0.02  # Change of the picture's shape that moves the camera.
_ROUNDS = 3  # Times that a ghost plays: a page that always moves keeps a fan busy.
_SPEEDS = {"1": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1}
_SIZES = {"640 x 360": (640, 360), "960 x 540": (960, 540), "1280 x 720": (1280, 720)}
_TIME_STEP = 0.2  # Least change that moves the time slider [s]: each is sent to every tab.
_CAMERA_EVERY = 0.5  # Time between two looks at the camera [s].
_CAMERA_WIDTH = 480  # Largest width of the picture that is sent [pixel].


class Page:
    """Draws a desk and a worker, and hands clicks to them.

    The worker calls `prepare` to get the desk ready for the first target. `folder` holds the
    session. The arm is drawn as rods without meshes.
    """

    def __init__(
        self,
        desk: Desk,
        worker: Worker,
        prepare: Work,
        folder: pathlib.Path,
        *,
        host: str = "127.0.0.1",
        port: int,
        meshes: ArmMeshes | None = None,
    ):
        self.desk, self.worker, self._prepare = desk, worker, prepare
        self._folder = folder
        self._lock = threading.RLock()
        self.server = start_server(host, port)
        gui: Any = self.server.gui
        gui.add_html(PHONE_STYLE)
        gui.set_panel_label("cablecast")
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BLUE)
        gui.main_panel.dock_right()
        self.stage = Stage(self.server, desk.setup, meshes)
        camera = self.server.initial_camera
        camera.position, camera.look_at, camera.fov = viewpoint(desk.setup, WIDE, panel=True)
        self._refreshers: list[Callable[[], None]] = []
        self._unseen: collections.deque[ShownCast] = collections.deque()
        self._ended = threading.Event()
        tabs = gui.add_tab_group()
        with tabs.add_tab(desk.task.verb):
            self._add_cast_tab(gui)
        with tabs.add_tab("Look"):
            self.look = LookTab(self, gui, folder)
        with tabs.add_tab("Share"):
            self._add_share_tab(gui)
        self._add_playback(gui)
        self._add_view(gui)
        if desk.rig.picture is not None:
            self._add_camera(gui, desk.rig.picture)
        self._map_is_shown = False
        # Not the scene's own clicks: those leave out taps of a finger.
        self.stage.table.on_click(self._clicked)
        desk.rig.watch = self._watch
        self.server.on_client_connect(self._welcome)
        worker.notify = self.refresh
        self.show_rest()
        self.refresh()

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    @property
    def rig_is_real(self) -> bool:
        """True for a rig that moves something, so that a person is asked twice."""
        what = self.desk.rig.description
        return what.get("rig") not in SIMULATED_RIGS and what.get("is_twin") is not True

    def close(self) -> None:
        """Stop serving."""
        self._ended.set()
        self.stage.player.close()
        stop_server(self.server)

    # Actions of a person. Each shows an error of cablecast as its sentence.

    def aim(self, target: ArrayLike) -> None:
        """Choose a target [m], shape [2] or [3], and show its plan."""
        self.worker.forget()

        def plan(report: ProgressCallback) -> None:
            try:
                self._show_plan(self.desk.aim(target))
            finally:
                if self.desk.phase is Phase.READY:
                    # Nothing of the target before stands for one that was refused.
                    self.show_rest()
                    self.stage.table.clear()

        if self.desk.task.plans_long:
            self._submit("a plan", plan)
        else:
            self.guard(lambda: plan(ignore))

    def cast(self, planned: Preview | None = None) -> None:
        """Cast as planned; the plan that a person saw when pressing the button, and no other."""
        planned = planned or self.desk.preview
        self._submit(f"a {self.desk.task.verb.lower()}", lambda report: self._cast(planned))

    def correct(self, missed: Cast | None = None) -> None:
        """Plan again against the last miss, the one that a person saw, and cast."""
        missed = missed or self.desk.last

        def work(report: ProgressCallback) -> None:
            if missed is not self.desk.last:
                raise InputError("there was another cast meanwhile: look at it, then correct")
            planned = self.desk.correct()
            self._show_plan(planned)
            self._cast(planned)

        self._submit(f"a corrected {self.desk.task.verb.lower()}", work)

    def undo(self) -> None:
        """Discard the last try."""
        self.worker.forget()
        self.guard(self.desk.undo)
        self.show_rest()
        self.refresh()

    def prepare(self) -> None:
        """Get ready for the first target: casts, fit, simulation, training."""
        self._submit("getting ready", self._prepare)

    def refit(self) -> None:
        """Fit the simulator to all casts of the session, and plan with its model."""

        def work(report: ProgressCallback) -> None:
            self.desk.refit(report)
            # The plan of before, and where casts could land, are those of the old model.
            if self.desk.preview is None:
                self.show_rest()
            self.show_map(self._map_is_shown)

        self._submit("a fit to all casts", work)

    def replay(self, name: str) -> None:
        """Show a try again, by its name in the list."""
        for one in self.desk.tries:
            if try_name(one, self.desk) == name:
                self.stage.table.clear()
                self._mark(one.target_xy)
                self.stage.play({"measured": ShownCast.of_cast(one)})

    def show_map(self, visible: bool) -> None:
        """Show or hide where casts can come, and how far they are expected to miss."""
        picture = None
        if visible:
            if self.desk.session is None:
                raise InputError("no model predicts yet where casts come: get ready first")
            picture = self.desk.task.map(self.desk.session)
        self.stage.table.show_map(picture)
        self._map_is_shown = visible

    # How it is shown.

    def guard(self, action: Callable[[], Any]) -> None:
        """Do something, and show the sentence of an error in every tab."""
        try:
            action()
        except CablecastError as error:
            self.say(str(error))
        except Exception as error:
            self.say(error_line(error))
        self.refresh()

    def _submit(self, name: str, work: Work) -> None:
        """Hand work to the worker, which may be busy; a person reads its name."""
        self.guard(lambda: self.worker.submit(name, work))

    def say(self, text: str) -> None:
        """Show a sentence in every tab."""
        self.desk.message = text
        for client in self.server.get_clients().values():
            client.add_notification("", text, auto_close_seconds=8.0, color="orange")

    def refresh(self) -> None:
        """Bring the controls up to date with the desk and the worker."""
        with self._lock:
            session = self.desk.session
            self.stage.table.set_sight(None if session is None else session.sight)
            for refresh in self._refreshers:
                refresh()

    def show_rest(self) -> None:
        """Show the arm and the cable as they are before a cast."""
        last, preview = self.desk.last, self.desk.preview
        self.stage.table.clear()
        if last is not None:
            self._mark(last.target_xy)
            shown = ShownCast.of_cast(last)
            self.stage.show({"measured": shown}, shown.duration)
        elif preview is not None:
            self.stage.show({"measured": preview.cast}, 0.0)
        elif self._resting is not None:
            self.stage.show({"measured": self._resting}, 0.0)

    def _mark(self, target_xy: NDArray[np.float64]) -> None:
        """Draw a target and the landings of the tries at it."""
        tries, session = self.desk.tries_at(target_xy), self.desk.session
        within_pct = 0.0 if session is None else session.config.within_pct
        within = within_pct / 100.0 * self.desk.setup.cable.length
        is_hit = any(one.hit for one in tries)
        self.stage.table.target(target_xy, within, is_hit=is_hit)
        self.stage.table.landings(tries)

    @functools.cached_property
    def _resting(self) -> ShownCast | None:
        """The arm and the cable after a reset; None where they are not known."""
        return self.desk.task.resting()

    def _show_plan(self, preview: Preview) -> None:
        self._mark(preview.proposal.goal.value)
        # The fields follow a click: a person may move the target a little from there.
        flat = self.stage.table.surface.flat(preview.proposal.goal.value)
        typed = self.desk.task.to_typed(flat)
        for field, value in zip(self._target_fields, typed, strict=True):
            update(field, value=value)
        self.stage.table.expectation(preview.proposal)
        casts = {"plan": preview.cast, "measured": preview.cast.start}
        self.stage.play(casts, rounds=_ROUNDS)
        self.refresh()

    def _cast(self, planned: Preview | None) -> None:
        self.refresh()
        one = self.desk.cast(planned)
        casts = {"measured": ShownCast.of_cast(one)}
        if self.desk.preview is not None:
            casts["plan"] = self.desk.preview.cast
        tries = self.desk.tries_at(one.target_xy)
        self.stage.table.landings(tries[:-1])

        def landed() -> None:
            self._mark(one.target_xy)
            self.stage.hide("plan")

        self.stage.play(casts, done=landed)
        self.desk.look_ahead()

    def _watch(self, motion: Trajectory, track: EndpointTrack | None) -> None:
        """Play what the rig is made to do, and what it saw, one after another, before any plan."""
        if self.desk.session is None:
            shown = ShownCast.of_motion(motion)
            if track is not None:
                shown = ShownCast.of_track(track, motion.joint_path)
            self._unseen.append(shown)
            if not self.stage.player.playing:
                self._play_unseen()

    def _play_unseen(self) -> None:
        if self._unseen and self.desk.session is None:
            self.stage.play({"measured": self._unseen.popleft()}, done=self._play_unseen)

    def _clicked(self, event: "viser.SceneNodePointerEvent[Any]") -> None:
        """Aim where the ray through the pointer meets the surface of the targets."""
        place = self.stage.table.surface.pick(event.ray_origin, event.ray_direction)
        if place is not None:
            self.aim(place)

    def _welcome(self, client: "viser.ClientHandle") -> None:
        """Step back where the picture is narrow, so that the whole table is seen.

        The picture takes its final shape once the panel is docked, and another one with the window.
        """
        placed = WIDE

        def place(camera: "viser.CameraHandle") -> None:
            nonlocal placed
            aspect = min(camera.aspect, WIDE)
            if abs(aspect / placed - 1.0) > _RESHAPED:
                placed = aspect
                camera.position, camera.look_at = viewpoint(self.desk.setup, aspect, panel=True)[:2]

        place(client.camera)
        client.camera.on_update(place)

    # Controls. Each knows how to bring itself up to date, and holds no other state.

    def _add_cast_tab(self, gui: Any) -> None:
        """Add target, plan, cast, correct, undo, and the tries so far."""
        desk, worker, task = self.desk, self.worker, self.desk.task
        status = gui.add_markdown("")

        def cast_seen(event: Any) -> None:
            self._confirm(event, functools.partial(self.cast, desk.preview))

        def correct_seen(event: Any) -> None:
            self._confirm(event, functools.partial(self.correct, desk.last))

        make = gui.add_button("Get ready", color="blue", icon="wand")
        make.on_click(
            lambda event: self._confirm(event, self.prepare) if task.moves_first else self.prepare()
        )
        cast = gui.add_button(task.verb, color="blue", icon="player-play-filled")
        cast.on_click(cast_seen)
        again = f"Correct and {task.verb.lower()} again"
        correct = gui.add_button(again, color="blue", icon="target-arrow")
        correct.on_click(correct_seen)
        other = gui.add_button("Another target", color="blue", icon="target")
        other.on_click(lambda _: self.guard(lambda: self.aim(desk.other_target())))
        forced = gui.add_button(f"{task.verb} all the same", color=SLATE)
        forced.on_click(
            lambda event: (cast_seen if desk.phase is Phase.PLANNED else correct_seen)(event)
        )
        stop = gui.add_button("Stop", color="red", icon="hand-stop")
        stop.on_click(lambda _: worker.stop())
        bar = gui.add_progress_bar(0.0, animated=True)
        plan = gui.add_markdown("")
        colors = gui.add_html(colors_text(), visible=False)
        tour = gui.add_markdown("", visible=False)
        with gui.add_folder("Target"):
            first, second = (
                gui.add_number(label, value, min=low, max=high, step=step)
                for label, value, low, high, step in task.fields()
            )
            gui.add_button("Plan", color=SLATE).on_click(
                lambda _: self.aim(task.from_typed(first.value, second.value))
            )
        self._target_fields = first, second
        tries = gui.add_folder("Tries")
        with tries:
            table = gui.add_markdown("")
            chosen = gui.add_dropdown("Try", ("-",))
            replay = gui.add_button("Replay", color=SLATE, icon="repeat")
            replay.on_click(lambda _: self.guard(lambda: self.replay(str(chosen.value))))
            undo = gui.add_button("Undo the last try", color=SLATE, icon="arrow-back-up")
            undo.on_click(lambda _: self.undo())
            due = gui.add_markdown("", visible=False)
            refit = gui.add_button(
                "Fit to all casts", color=SLATE, icon="refresh", visible=task.moves_first
            )
            refit.on_click(lambda _: self.refit())

        def refresh() -> None:
            phase, state, preview = desk.phase, worker.state, desk.preview
            busy = state.busy
            # The plan is there before the page asks to look at it.
            update(plan, content="" if preview is None else plan_text(preview, desk))
            update(status, content=status_text(desk, state))
            update(colors, visible=preview is not None)
            update(make, visible=phase is Phase.NO_MODEL, disabled=busy)
            stopped = phase in (Phase.PLANNED, Phase.DONE) and bool(desk.stop)
            can_cast = phase in (Phase.READY, Phase.PLANNED, Phase.CASTING) and not stopped
            update(cast, visible=can_cast, disabled=busy or preview is None)
            update(correct, visible=phase is Phase.LANDED, disabled=busy)
            update(other, visible=phase is Phase.DONE or stopped, disabled=busy)
            update(forced, visible=stopped, disabled=busy)
            update(stop, visible=busy)
            # A full bar where the work does not say how far it is.
            work = state.progress
            share = 1.0 if work is None or not work.total else work.done / work.total
            update(bar, visible=busy, value=round(100.0 * share, 1))
            steps = tour_text(desk, state)
            update(tour, visible=bool(steps), content=steps)
            update(tries, visible=bool(desk.tries))
            update(table, content=tries_text(desk))
            names = tuple(try_name(one, desk) for one in desk.tries) or ("-",)
            if tuple(chosen.options) != names:
                chosen.options, chosen.value = names, names[-1]
            update(undo, disabled=busy or desk.last is None)
            refit_due = None if desk.session is None else desk.session.refit_due
            reason = "" if refit_due is None else refit_text(refit_due)
            update(due, visible=bool(reason), content=f"A new fit is worth it: {reason}.")
            update(refit, color="blue" if reason else SLATE, disabled=busy)

        self._refreshers.append(refresh)

    def _confirm(self, event: Any, action: Callable[[], None]) -> None:
        """Do something, after asking where a real arm moves; the person who clicked, no other."""
        if not self.rig_is_real:
            action()
            return
        gui: Any = self.server.gui if event.client is None else event.client.gui
        with gui.add_modal("The arm will move") as modal:
            gui.add_markdown(self.desk.task.danger(self.desk.session))
            yes = gui.add_button("Yes, it may move", color="red")
            no = gui.add_button("No")
        no.on_click(lambda _: modal.close())

        @yes.on_click
        def _(event: Any) -> None:
            modal.close()
            action()

    def _add_share_tab(self, gui: Any) -> None:
        """Add casts, kind and size of a film, which is sent to the browser."""
        desk = self.desk
        gui.add_markdown("A film of the session, to keep or to send.")
        what = gui.add_dropdown("Casts", ("the last try", "this target", "all tries"))
        kinds = desk.task.film_kinds
        kind = gui.add_dropdown("Kind", tuple(kind[1:].upper() for kind in kinds))
        size = gui.add_dropdown("Size", tuple(_SIZES), initial_value="960 x 540")
        button = gui.add_button("Film", color="blue", icon="movie")
        gui.add_markdown("`cablecast film` does the same without a page.")

        def film(report: ProgressCallback) -> None:
            if desk.last is None:
                raise InputError("there is nothing to film yet: cast first")
            trials = {
                "the last try": [desk.last],
                "this target": desk.tries_at(desk.last.target_xy),
                "all tries": [one for one in desk.tries if not desk.is_undone(one)],
            }[str(what.value)]
            width, height = _SIZES[str(size.value)]
            name = f"casts.{str(kind.value).lower()}"
            with tempfile.TemporaryDirectory(prefix="cablecast-") as folder:
                path = pathlib.Path(folder) / name
                config = FilmConfig(width=width, height=height)
                desk.task.film(self._folder, trials)(path, config, report)
                self.server.send_file_download(name, path.read_bytes())

        button.on_click(lambda _: self._submit("a film", film))

    def _add_playback(self, gui: Any) -> None:
        """Add the time slider, pause and speed of plans, tries and casts of a folder."""
        player, shown_time = self.stage.player, -1.0
        with gui.add_folder("Playback"):
            slider = gui.add_slider("time [s]", 0.0, 5.0, 0.02, 0.0)
            speed = gui.add_dropdown("speed", tuple(_SPEEDS), initial_value="1")
            play = gui.add_button("Play or pause", color=SLATE, icon="player-play")
        play.on_click(lambda _: player.toggle())

        @slider.on_update
        def _(event: Any) -> None:
            # Setting the value from here comes without a client.
            if event.client is not None:
                player.seek(float(slider.value))

        @speed.on_update
        def _(event: Any) -> None:
            player.speed = _SPEEDS[str(speed.value)]

        def show_time(time: float) -> None:
            nonlocal shown_time
            duration = player.duration
            if abs(time - shown_time) < _TIME_STEP and 0.0 < time < duration:
                return
            shown_time = time
            if duration > 0 and abs(slider.max - duration) > 1e-6:
                slider.max = round(duration, 2)
            update(slider, value=round(min(time, duration), 2))

        player.on_frame = show_time

    def _add_view(self, gui: Any) -> None:
        """Add the map of where casts can come."""
        task = self.desk.task
        with gui.add_folder("View", expand_by_default=False):
            box = gui.add_checkbox(task.map_name, task.shows_map, disabled=True)
            legend = gui.add_html(
                f'<div style="margin: 0 1em 0.8em; font-size: 0.85em">{task.legend()}</div>',
                visible=task.shows_map,
            )

        def show_map() -> None:
            self.show_map(box.value)
            update(legend, visible=box.value)

        def refresh() -> None:
            update(box, disabled=self.desk.session is None)
            if box.value and not self._map_is_shown and not box.disabled:
                self.show_map(True)

        box.on_update(lambda _: self.guard(show_map))
        self._refreshers.append(refresh)

    def _add_camera(self, gui: Any, take: Callable[[], NDArray[np.uint8] | None]) -> None:
        """Add the latest picture of the rig's camera; a thread takes it, also in mid-cast."""
        folder = gui.add_folder("Camera", visible=False)
        with folder:
            image = gui.add_image(
                np.zeros((9, 16, 3), dtype=np.uint8), format="jpeg", jpeg_quality=80
            )
            trouble = gui.add_markdown("", visible=False)

        def watch() -> None:
            last = None
            while not self._ended.wait(_CAMERA_EVERY):
                picture, words = None, ""
                try:
                    picture = take()
                except CablecastError as error:
                    words = literal(str(error))
                update(trouble, content=words, visible=bool(words))
                if picture is not None and picture is not last:
                    last = picture
                    image.image = shrunk(picture)
                update(folder, visible=last is not None or bool(words))

        threading.Thread(target=watch, name="camera", daemon=True).start()


def shrunk(picture: NDArray[np.uint8], width: int = _CAMERA_WIDTH) -> NDArray[np.uint8]:
    """Return a picture, BGR, shape [v, u, 3], as RGB of at most some width [pixel]."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(picture[..., ::-1]))
    return np.asarray(image.reduce(max(1, -(-image.width // width))))


def slid_params(base: CableParams, exponents: dict[str, float]) -> CableParams:
    """Return parameters multiplied by powers of ten from -1 to 1, within their bounds."""
    changes = {}
    for name, exponent in exponents.items():
        if name not in PARAMS or not abs(exponent) <= 1.0 + 1e-9:
            raise InputError(f"slider {name} = {exponent:g} is outside [-1, 1]")
        low, high = PARAMS[name].bounds
        value = float(np.asarray(getattr(base, name))) * 10.0**exponent
        changes[name] = float(np.clip(value, low, high))
    return dataclasses.replace(base, **changes)


class LookTab:
    """Casts of a folder, measured and simulated side by side, with sliders of the parameters."""

    def __init__(self, page: Page, gui: Any, folder: pathlib.Path):
        # Motions of the chosen cast, by the names of their figures.
        self.shown: dict[str, ShownCast] = {}
        self._page = page
        self._collection: Collection | None = None
        self._index = 0
        gui.add_markdown("Casts of `collect`, `tune`, `evaluate`, `simulate` or `aim`.")
        place = gui.add_text("Folder", str(folder))
        gui.add_button("Open", color="blue", icon="folder-open").on_click(
            lambda _: page.guard(lambda: self.open(str(place.value)))
        )
        self._cast = gui.add_dropdown("Cast", ("-",))
        self._cast.on_update(self._by_hand(lambda: self._choose(str(self._cast.value))))
        self._boxes = {
            kind: gui.add_checkbox(kind, kind == "measured", disabled=True)
            for kind in ("measured", "believed", "tuned", "sliders")
        }
        for kind, box in self._boxes.items():
            box.on_update(self._by_hand(lambda kind=kind, box=box: self.tick(kind, box.value)))
        on_table = page.desk.setup.strike is None
        self._mujoco = gui.add_button(
            "Compare with MuJoCo", color=SLATE, disabled=True, visible=on_table
        )
        self._mujoco.on_click(lambda _: page.guard(lambda: self.tick("MuJoCo", True)))
        self._text = gui.add_markdown("")
        with gui.add_folder("Parameters of the cable (powers of ten)"):
            self._sliders = {
                name: gui.add_slider(name.replace("_", " "), -1.0, 1.0, 0.05, 0.0, disabled=True)
                for name in page.desk.task.sliders
            }
        # Clicks come in threads of their own; what is simulated belongs to the cast that is shown.
        self._lock = threading.RLock()
        self._slid = threading.Event()
        for slider in self._sliders.values():
            slider.on_update(self._by_hand(self._slide))
        threading.Thread(target=self._follow_sliders, name="sliders", daemon=True).start()

    def open(self, folder: str) -> None:
        """Show the first cast of a folder.

        Raises:
            DatasetError: It holds none.
        """
        collection = open_collection(pathlib.Path(folder.strip()).expanduser())
        theirs, ours = collection.setup, self._page.desk.setup
        if theirs.workspace != ours.workspace:
            raise InputError("these casts were made on another table than the page shows")
        if theirs.strike != ours.strike:
            raise InputError("these casts were made with another strike section than the page's")
        if theirs.arm.joint_count != ours.arm.joint_count:
            raise InputError(
                f"these casts were made with an arm of {theirs.arm.joint_count} joints, and the "
                f"page shows one of {ours.arm.joint_count}"
            )
        with self._lock:
            self._collection = collection
            self._cast.options = collection.labels
            self._cast.value = collection.labels[0]
            for handle in (*self._boxes.values(), *self._sliders.values(), self._mujoco):
                handle.disabled = False
            self._boxes["tuned"].disabled = collection.tuned is None
            self.show(0)

    def show(self, index: int) -> None:
        """Show a cast of the open folder in all kinds that are ticked."""
        with self._lock:
            self._index, self.shown = index, {}
            for kind, box in self._boxes.items():
                if box.value and not box.disabled:
                    self._make(kind)
            if not self.shown:
                # Nobody saw it.
                self._boxes["believed"].value = True
                self._make("believed")
            self._play()

    def tick(self, kind: str, on: bool) -> None:
        """Show one kind of motion of the cast, or hide it."""
        with self._lock:
            self.shown.pop(kind, None)
            if on:
                self._make(kind)
            self._play()

    def _by_hand(self, action: Callable[[], None]) -> Callable[[Any], None]:
        """Return an answer to changes that a person made: those from here have no client."""
        return lambda event: self._page.guard(action) if event.client is not None else None

    def _choose(self, label: str) -> None:
        if self._collection is not None and label in self._collection.labels:
            self.show(self._collection.labels.index(label))

    def _make(self, kind: str) -> None:
        """Compute one kind of motion of the cast; nothing where it was not seen."""
        collection, engine = self._need(), self._page.desk.engine
        dynamics = collection.believed if kind == "believed" else collection.fitted
        if kind == "sliders":
            exponents = {name: float(slider.value) for name, slider in self._sliders.items()}
            dynamics = dynamics.with_params(slid_params(dynamics.params, exponents))
        elif kind == "MuJoCo":
            from cablecast.engines.mujoco_ import EngineMujoco

            engine = EngineMujoco()
            # MuJoCo's cable has no material besides the ten parameters.
            dynamics = dynamics.with_params(dynamics.params.without_material())
        if kind == "measured":
            cast = collection.measured(self._index)
        else:
            cast = collection.simulated(self._index, engine, dynamics)
        if cast is not None:
            self.shown[kind] = cast

    def _slide(self) -> None:
        self._boxes["sliders"].value = True
        self._slid.set()

    def _follow_sliders(self) -> None:
        """Simulate for the latest place of the sliders; places that were passed are left out."""
        while True:
            self._slid.wait()
            self._slid.clear()
            self._page.guard(self.slide)

    def slide(self) -> None:
        """Show the cast with the parameters of the sliders, at rest."""
        with self._lock:
            self._make("sliders")
            player = self._page.stage.player
            self._mark()
            end = self.shown["sliders"].duration
            self._page.stage.show(self.shown, end if player.playing else player.time)
            self._describe()

    def _mark(self) -> None:
        table, target = self._page.stage.table, self._need().target_xy[self._index]
        table.clear()
        if np.all(np.isfinite(target)):
            table.target(target)

    def _play(self) -> None:
        self._mark()
        self._page.stage.play(self.shown)
        self._describe()

    def _describe(self) -> None:
        collection = self._need()
        target = collection.target_xy[self._index]
        words = motions_text(self.shown, collection.setup.cable.length, target)
        update(self._text, content=words)

    def _need(self) -> Collection:
        if self._collection is None:
            raise InputError("no folder is open: name one, and open it")
        return self._collection


def serve(
    rig: CheckedRig,
    folder: pathlib.Path,
    *,
    config: AimConfig,
    host: str,
    port: int,
    meshes: ArmMeshes | None,
    ready: Callable[[str], None],
) -> None:
    """Serve the page of a rig until Ctrl-C, with the session in the folder of `cablecast aim`.

    If the port is taken, it is the next free one; `ready` is told the address once the page can be
    opened. The arm is drawn as rods without meshes.

    Raises:
        MissingExtraError: A library of the page is not installed.
    """
    desk, worker = Desk(rig), Worker()

    def prepare(report: ProgressCallback) -> None:
        desk.open_session(desk.task.prepare(rig, config, out=folder, progress=report), report)

    page = Page(desk, worker, prepare, folder, host=host, port=port, meshes=meshes)
    try:
        ready(page.address)
        # A real arm may have casts to make, and moves at a click alone.
        is_known = (folder / SESSION_FOLDER).exists() and not page.rig_is_real
        if is_known or not desk.task.moves_first:
            page.prepare()
        worker.run()
    finally:
        page.close()

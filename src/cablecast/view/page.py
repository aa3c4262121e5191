"""Player: moves figures through their casts in time, 25 times a second.

A server of the page, started without a banner.

The page: the scene and the controls of a desk, for any number of tabs that see the same.

serve: a rig, a session and a page together, until somebody ends them.
"""

import dataclasses
import os
import pathlib
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.conventions import polar_to_xy
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import CablecastError, InputError
from cablecast.pipeline.aim import CALIBRATION_COUNT, SIMULATED_COUNT, prepare_aim
from cablecast.pipeline.aim_session import AimSession
from cablecast.pipeline.places import require
from cablecast.rigs.base import error_line
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import METRICS_FILE, Parts
from cablecast.runs.places import MODEL_FOLDER
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.view.controls import (
    CameraControls,
    CastControls,
    LookControls,
    PlaybackControls,
    ShareControls,
    WorkControls,
)
from cablecast.view.desk import Desk
from cablecast.view.look import ALBUM_FOLDER, Album, Player, ShownCast
from cablecast.view.scene import ArmMeshes, Figure, Marks, Room, start_server, stop_server
from cablecast.view.shapes import BLUE, DARK, LIGHT, PURPLE, map_image, miss_map, viewpoint
from cablecast.view.worker import Work, Worker

if TYPE_CHECKING:
    import viser


HOST = "127.0.0.1"
PORT = 8080

WIDE = 1.3
"""Pictures of the scene at least this wide for their height see the table from one place."""

_RESHAPED = 0.02
"""Change of the picture's shape that moves the camera."""

_ROUNDS = 3
"""Number of times that a ghost plays before it rests: a page that always moves keeps a fan busy."""

SIMULATED_RIGS = ("virtual", "engine", "twin")
"""Kinds of rigs that move nothing: any other is asked for twice."""


class Page:
    """Draws a desk and a worker, and hands clicks to them.

    Args:
        desk: State of the table.
        worker: Thread for casts and long work.
        prepare: Gets the desk ready for the first target; called by the worker.
        host: Address to listen on; only this computer by default.
        port: Port to listen on; the next free one if it is taken.
        dark: True for a page that begins dark.
        suggestion: Folder that is suggested to look at.
        home: Folder of the cable's results, e.g. runs/cable_1.
        meshes: Meshes of the arm; drawn as rods where None.
    """

    def __init__(
        self,
        desk: Desk,
        worker: Worker,
        prepare: Work,
        *,
        host: str = HOST,
        port: int = PORT,
        dark: bool = False,
        suggestion: pathlib.Path | None = None,
        home: pathlib.Path | None = None,
        meshes: ArmMeshes | None = None,
    ):
        self.desk, self.worker, self._prepare = desk, worker, prepare
        self._lock = threading.RLock()
        self.server = start_server(host, port)
        self.server.gui.set_panel_label("cablecast")
        self.server.gui.main_panel.dock_right()
        self._room = Room(self.server, desk.setup, LIGHT)
        self._marks = Marks(self.server, desk.setup)
        self.solid = Figure(self.server, "/solid", desk.setup, BLUE, meshes=meshes)
        self.ghost = Figure(self.server, "/ghost", desk.setup, PURPLE, opacity=0.5)
        self.player = Player(self._on_frame)
        self._place_camera()
        tabs = self.server.gui.add_tab_group()
        with tabs.add_tab("Cast"):
            self.cast_controls = CastControls(self)
        with tabs.add_tab("Look"):
            self.look_controls = LookControls(self, suggestion)
        with tabs.add_tab("Work"):
            self.work_controls = WorkControls(self, home or pathlib.Path("runs"))
        with tabs.add_tab("Share"):
            self.share_controls = ShareControls(self)
        self.playback = PlaybackControls(self, dark)
        self.camera_controls = CameraControls(self)
        self.set_dark(dark)
        self._rest: ShownCast | None = None
        self._map: Any = None
        self.server.scene.on_click()(self._clicked)
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
        self.camera_controls.close()
        self.player.close()
        stop_server(self.server)

    # What a person can do. Each answers an error of cablecast with its sentence.

    def aim(self, xy: Any) -> None:
        """Choose a target and show its plan."""
        self.guard(lambda: self._show_plan(lambda: self.desk.aim(xy)))

    def aim_polar(self, r: float, theta_deg: float) -> None:
        """Choose a target by its distance [m] and its angle [deg]."""
        self.aim(polar_to_xy([r, np.radians(theta_deg)]))

    def cast(self) -> None:
        """Cast as planned."""
        self.guard(lambda: self.worker.submit("a cast", lambda report: self._cast()))

    def correct(self) -> None:
        """Plan again against the last miss, and cast."""

        def work(report: Any) -> None:
            self._show_plan(self.desk.correct)
            self._cast()

        self.guard(lambda: self.worker.submit("a corrected cast", work))

    def undo(self) -> None:
        """Take the last try back."""
        self.guard(self.desk.undo)
        self.show_rest()
        self.refresh()

    def stop(self) -> None:
        """Stop the work under way."""
        self.worker.stop()

    def prepare(self) -> None:
        """Get ready for the first target: casts, fit, simulation, training."""
        self.guard(lambda: self.worker.submit("getting ready", self._prepare))

    def refit(self) -> None:
        """Fit the simulator to all casts of the session, and learn anew from it."""
        self.guard(lambda: self.worker.submit("a fit to all casts", self.desk.refit))

    def replay(self, number: int) -> None:
        """Show a cast of the session again.

        Args:
            number: Number of the cast in its session, from 0.
        """
        one = next((trial for trial in self.desk.tries if trial.number == number), None)
        if one is None:
            return
        self.look_controls.hide()
        self.ghost.visible = False
        self.solid.visible = True
        self._marks.target(one.target_xy)
        self._marks.landings(self.desk.tries_at(one.target_xy))
        self.player.play([(self.solid, self.desk.shown(one))])

    def set_dark(self, dark: bool) -> None:
        """Make the page dark or light."""
        paint = DARK if dark else LIGHT
        self.server.gui.configure_theme(
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
            brand_color=BLUE,
            control_width="medium",
        )
        self._room.draw(paint)
        self.solid.repaint(paint)
        self.solid.recolor(paint.cable)
        self._marks.repaint(paint)

    def show_map(self, visible: bool) -> None:
        """Show or hide how far casts are expected to miss.

        Raises:
            InputError: There is no model yet that could tell.
        """
        session = self.desk.session
        if not visible:
            if self._map is not None:
                self._map.visible = False
            self.playback.explain_map(None)
            return
        if session is None:
            raise InputError("there is no model yet that knows where casts land: get ready first")
        shown, table = miss_map(session.aimer.policy), self.desk.setup.workspace
        self.playback.explain_map(shown)
        # An image lies in its own x-y plane with y down, so it is turned about x.
        self._map = self.server.scene.add_image(
            "/map",
            map_image(shown, self.desk.setup.cable.length),
            2 * table.half_width,
            table.y_max - table.y_min,
            format="png",
            wxyz=(0.0, 1.0, 0.0, 0.0),
            position=(0.0, (table.y_min + table.y_max) / 2, 0.001),
            cast_shadow=False,
            receive_shadow=False,
        )

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

    def say(self, text: str) -> None:
        """Show a sentence in every tab."""
        self.desk.message = text
        for client in self.server.get_clients().values():
            client.add_notification("", text, auto_close_seconds=8.0, color="orange")

    def refresh(self) -> None:
        """Bring the controls up to date with the desk and the worker."""
        with self._lock:
            session = self.desk.session
            self._room.set_sight(None if session is None else session.sight)
            self.cast_controls.refresh()
            self.work_controls.refresh()
            self.playback.refresh()

    def clear_stage(self) -> None:
        """Hide the figures and the marks of plan and cast."""
        self.solid.visible = self.ghost.visible = False
        self._marks.clear()

    def show_rest(self) -> None:
        """Show the arm and the cable as they are before a cast."""
        last = self.desk.last
        preview = self.desk.preview
        self.ghost.visible = False
        if last is not None:
            self._marks.target(last.target_xy)
            self._marks.landings(self.desk.tries_at(last.target_xy))
            shown = self.desk.shown(last)
            self.player.show([(self.solid, shown)], shown.duration)
        elif preview is not None:
            self.player.show([(self.solid, preview.cast)], 0.0)
        elif (rest := self._resting()) is not None:
            self.player.show([(self.solid, rest)], 0.0)

    def _resting(self) -> ShownCast | None:
        """Return the arm and the cable after a reset."""
        from cablecast.motion.action import Action
        from cablecast.motion.trajectory import plan_trajectory

        if self._rest is None:
            action = Action(theta1=np.radians(-30), theta2=np.radians(20), r2=0.6)
            try:
                self._rest = self.desk.simulate(plan_trajectory(action, self.desk.setup))
            except CablecastError:
                return None
        return self._rest

    def _show_plan(self, plan: Callable[[], Any]) -> None:
        preview = plan()
        self.look_controls.hide()
        self.ghost.visible = True
        self._marks.target(preview.target_xy)
        self._marks.expectation(preview.proposal)
        self._marks.landings(self.desk.tries_at(preview.target_xy))
        self.solid.visible = True
        self.player.play(
            [(self.ghost, preview.cast), (self.solid, _still(preview.cast))], rounds=_ROUNDS
        )
        self.refresh()

    def _cast(self) -> None:
        self.refresh()
        one = self.desk.cast()
        preview = self.desk.preview
        acts: list[tuple[Any, ShownCast]] = [(self.solid, self.desk.shown(one))]
        if preview is not None:
            acts.append((self.ghost, preview.cast))
        landings = self.desk.tries_at(one.target_xy)
        self._marks.landings(landings[:-1])
        self.player.play(acts, done=lambda: self._landed(one.target_xy))

    def _landed(self, target_xy: Any) -> None:
        self._marks.landings(self.desk.tries_at(target_xy))
        self.ghost.visible = False

    def _clicked(self, event: "viser.SceneClickEvent") -> None:
        """Aim where the ray through the pointer meets the table."""
        origin, direction = np.array(event.ray_origin), np.array(event.ray_direction)
        if direction[2] >= -1e-6:
            return
        self.aim((origin - direction * origin[2] / direction[2])[:2])

    def _on_frame(self, time: float) -> None:
        controls = getattr(self, "playback", None)
        if controls is not None:
            controls.show_time(time, self.player.duration)

    def _place_camera(self) -> None:
        camera = self.server.initial_camera
        seen = viewpoint(self.desk.setup, WIDE)
        camera.position, camera.look_at, camera.fov = seen

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
                camera.position, camera.look_at = viewpoint(self.desk.setup, aspect)[:2]

        place(client.camera)
        client.camera.on_update(place)


def _still(cast: ShownCast) -> ShownCast:
    """Return the first instant of a cast."""
    joints = cast.joint_path
    if joints is not None:
        first = {name: getattr(joints, name)[:1] for name in ("times", "q", "qd")}
        joints = dataclasses.replace(joints, **first)
    return dataclasses.replace(
        cast,
        joint_path=joints,
        times=cast.times[:1],
        endpoint_xy=cast.endpoint_xy[:1],
        nodes=None if cast.nodes is None else cast.nodes[:1],
    )


SEGMENT_COUNT, STEP = 30, 1e-3
"""Resolution of previews: a cast in a fraction of the time, with a landing some per cent of the
cable's length from that of the full resolution (docs/view.md)."""


def make_desk(rig: CheckedRig, folder: pathlib.Path | None = None) -> Desk:
    """Return the desk of a session, still without a model.

    Args:
        rig: Rig that `make_rig` returned.
        folder: Folder of the session; nothing is kept where None.
    """
    album = Album(None if folder is None else Parts(folder / ALBUM_FOLDER))
    return Desk(rig, EngineWarp(segment_count=SEGMENT_COUNT, dt=STEP), album)


def preparation(
    desk: Desk,
    folder: pathlib.Path | None,
    *,
    calibration_count: int,
    count: int,
    seed: int,
) -> Work:
    """Return the work that gets a desk ready: casts, fit, simulation, training.

    Args:
        desk: Desk to hand the session to.
        folder: Folder of the session; what is done there is not done again.
        calibration_count: Casts that the rig makes.
        count: Simulated casts that the model learns from.
        seed: Seed of everything that is drawn by chance.
    """

    def work(report: ProgressCallback) -> None:
        session = prepare_aim(
            desk.rig,
            calibration_count=calibration_count,
            count=count,
            seed=seed,
            out=folder,
            progress=report,
        )
        open_session(desk, session, report)

    return work


def open_session(desk: Desk, session: AimSession, report: ProgressCallback = ignore) -> None:
    """Hand a session to a desk, once its first plan will be as quick as the others.

    Args:
        desk: Desk to hand the session to.
        session: Session that `prepare_aim` returned.
        report: Told what is done.
    """
    report(Progress(task="A plan to begin with"))
    desk.rehearse(session)
    desk.set_session(session)


def serve(
    rig: CheckedRig,
    folder: str | os.PathLike[str],
    *,
    calibration_count: int = CALIBRATION_COUNT,
    count: int = SIMULATED_COUNT,
    seed: int = 0,
    host: str,
    port: int,
    dark: bool = False,
    arm_meshes: str | os.PathLike[str] | None = None,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve the page of a rig until Ctrl-C.

    Args:
        rig: Rig that `make_rig` returned.
        folder: Folder of the session, the same as that of `cablecast aim`.
        calibration_count: Casts that the rig makes to begin with.
        count: Simulated casts that the model learns from.
        seed: Seed of everything that is drawn by chance.
        host: Address to listen on.
        port: Port to listen on; the next free one if it is taken.
        dark: True for a page that begins dark.
        arm_meshes: MJCF or URDF file whose meshes draw the arm; it is drawn as rods where None.
        ready: Told the address once the page can be opened.

    Raises:
        MissingExtraError: A library of the page is not installed.
        InputError: The file of meshes shows another arm.
    """
    require("the page", "viser", "trimesh", "torch", "safetensors")
    meshes = None if arm_meshes is None else ArmMeshes(arm_meshes, rig.setup.arm)
    folder = pathlib.Path(folder)
    desk, worker = make_desk(rig, folder), Worker()
    prepare = preparation(
        desk,
        folder,
        calibration_count=calibration_count,
        count=count,
        seed=seed,
    )
    page = Page(
        desk,
        worker,
        prepare,
        host=host,
        port=port,
        dark=dark,
        suggestion=folder,
        home=folder.parent,
        meshes=meshes,
    )
    try:
        if ready is not None:
            ready(page.address)
        if (folder / MODEL_FOLDER / METRICS_FILE).exists():
            page.prepare()
        worker.run()
    finally:
        page.close()

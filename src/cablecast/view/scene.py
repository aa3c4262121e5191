"""Table, scale, target and landings in the browser."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.sight import CameraSight
from cablecast.pipeline.aim import ellipse_points
from cablecast.pipeline.aim_session import AimProposal, AimTrial
from cablecast.setup import Setup
from cablecast.view.figure import LIFT
from cablecast.view.lettering import add_text
from cablecast.view.palette import GREEN, LIGHT, VERMILLION, Paint
from cablecast.view.shapes import (
    circle,
    hatched_circle,
    level,
    polyline,
    reach_arc,
    table_lines,
)

if TYPE_CHECKING:
    import viser

EXPECTED_SHARE = 0.9
"""Share of the landings that the ellipse of a plan holds."""

_EARLIER = (123, 135, 148)  # Colour of the landings before the last.
_TEXT_HEIGHT = 0.07  # Of the text at a landing [m].
_TEXT_AWAY = 0.1  # Distance of that text from the landing [m].
_TEXT_ROOM = np.array([0.22, 0.08])  # Nearer to the last text, an earlier number is left out [m].
_TEXT_LIFT = 0.03  # Height of that text, above any cable on the table [m].
_THICKNESS = 0.04  # Of the table's top [m].
_AXIS = 0.28  # Length of the base frame's axes, which end beyond the arm's foot [m].


class Room:
    """Table, scale and base frame, which do not move.

    Args:
        server: Server of the page.
        setup: Set-up with table and cable.
        paint: Colours.
    """

    def __init__(self, server: "viser.ViserServer", setup: Setup, paint: Paint = LIGHT):
        self._server, self._setup = server, setup
        self.paint = paint
        self._blind: tuple[tuple[float, float, float], ...] = ()
        self._light()
        self.draw(paint)

    def _light(self) -> None:
        """Light the scene without a picture of surroundings and without shadows.

        Both, and a picture in the background, cost a browser that draws in software most of its
        frames (docs/view.md).
        """
        scene = self._server.scene
        scene.configure_environment_map(hdri=None)
        scene.configure_default_lights(enabled=False, cast_shadow=False)
        scene.world_axes.visible = False
        scene.add_light_hemisphere(
            "/light/sky", sky_color=(255, 255, 255), ground_color=(150, 145, 140), intensity=1.9
        )
        scene.add_light_directional(
            "/light/lamp", color=(255, 250, 240), intensity=1.6, position=(-1.0, -1.5, 3.0)
        )

    def draw(self, paint: Paint) -> None:
        """Draw everything in given colours, over what was there."""
        self.paint = paint
        scene, table = self._server.scene, self._setup.workspace
        width, depth = 2 * table.half_width, table.y_max - table.y_min
        middle = (table.y_min + table.y_max) / 2
        scene.add_box(
            "/room/top",
            paint.table,
            (width, depth, _THICKNESS),
            position=(0.0, middle, -_THICKNESS / 2),
            cast_shadow=False,
            receive_shadow=True,
        )
        scene.add_box(
            "/room/frame",
            paint.side,
            (width + 0.03, depth + 0.03, 0.03),
            position=(0.0, middle, -_THICKNESS - 0.004),
            cast_shadow=False,
            receive_shadow=False,
        )
        scene.add_line_segments(
            "/room/lines",
            table_lines(self._setup, 0.25, LIFT / 2).astype(np.float32),
            paint.line,
            thickness=1.0,
            thickness_units="screen",
        )
        scene.add_line_segments(
            "/room/reach",
            reach_arc(self._setup, LIFT).astype(np.float32),
            paint.reach,
            thickness=2.0,
            thickness_units="screen",
        )
        edge = table.y_min - 0.07
        for x in np.arange(np.ceil(2 * -table.half_width) / 2, table.half_width + 1e-6, 0.5):
            self._label(f"x/{x:g}".replace("-", "m").replace(".", "_"), f"{x:g} m", (x, edge, 0.0))
        for y in np.arange(0.5 * max(1, np.ceil(2 * table.y_min)), table.y_max + 1e-6, 0.5):
            place = (-table.half_width - 0.13, float(y), 0.0)
            self._label(f"y/{y:g}".replace(".", "_"), f"{y:g} m", place)
        scene.add_frame(
            "/room/base", axes_length=_AXIS, axes_radius=0.006, position=(0.0, 0.0, 0.004)
        )
        self._label("axis_x", "x", (_AXIS + 0.05, 0.03, LIFT))
        self._label("axis_y", "y", (0.03, _AXIS + 0.03, LIFT))
        self._draw_blind()

    def set_sight(self, sight: CameraSight | None) -> None:
        """Mark the places on the table that the camera is blind at, where they are known."""
        blind = () if sight is None else sight.blind
        if blind != self._blind:
            self._blind = blind
            self._draw_blind()

    def _draw_blind(self) -> None:
        """Hatch the blind places, over what was there."""
        self._server.scene.remove_by_name("/room/blind")
        for number, (x, y, radius) in enumerate(self._blind):
            name = f"/room/blind/{number}"
            self._server.scene.add_line_segments(
                f"{name}/hatch",
                hatched_circle((x, y), radius, LIFT).astype(np.float32),
                self.paint.reach,
                thickness=1.0,
                thickness_units="screen",
            )
            # On the near side, where it hides no target in the place.
            below = (x, y - radius - _TEXT_HEIGHT / 2, LIFT)
            color = self.paint.text
            add_text(self._server, f"{name}/label", "not seen", below, color, _TEXT_HEIGHT)

    def _label(self, name: str, text: str, position: tuple[float, float, float]) -> None:
        add_text(self._server, f"/room/scale/{name}", text, position, self.paint.text)


class Marks:
    """Target, expectation and landings on the table.

    Args:
        server: Server of the page.
        setup: Set-up with the cable.
    """

    def __init__(self, server: "viser.ViserServer", setup: Setup):
        self._server, self._setup = server, setup
        self._paint = LIGHT
        self._tries: list[AimTrial] = []

    def repaint(self, paint: Paint) -> None:
        """Take the colours of a light or dark scene."""
        self._paint = paint
        self.landings(self._tries)

    def clear(self) -> None:
        """Take all marks away."""
        self._tries = []
        for name in ("target", "expected", "tries"):
            self._server.scene.remove_by_name(f"/marks/{name}")

    def target(self, xy: NDArray[np.float64]) -> None:
        """Draw the target as two rings and a cross."""
        x, y = float(xy[0]), float(xy[1])
        cross = np.array(
            [
                [[x - 0.06, y, 2 * LIFT], [x + 0.06, y, 2 * LIFT]],
                [[x, y - 0.06, 2 * LIFT], [x, y + 0.06, 2 * LIFT]],
            ]
        )
        lines = [circle(xy, 0.02, 2 * LIFT), circle(xy, 0.045, 2 * LIFT), cross]
        self._server.scene.add_line_segments(
            "/marks/target",
            np.concatenate(lines).astype(np.float32),
            VERMILLION,
            thickness=3.0,
            thickness_units="screen",
        )

    def expectation(self, proposal: AimProposal) -> None:
        """Draw the expected landing, and the ellipse that nine of ten landings lie in."""
        outline = ellipse_points(proposal, EXPECTED_SHARE)
        lines = [circle(proposal.expected_xy, 0.012, 2 * LIFT), polyline(level(outline, 2 * LIFT))]
        self._server.scene.add_line_segments(
            "/marks/expected",
            np.concatenate(lines).astype(np.float32),
            GREEN,
            thickness=2.5,
            thickness_units="screen",
        )

    def landings(self, trials: list[AimTrial]) -> None:
        """Draw the landings of tries at one target, numbered, each with a line to the target."""
        scene = self._server.scene
        scene.remove_by_name("/marks/tries")
        self._tries = trials
        length = self._setup.cable.length
        for one in trials:
            if not np.all(np.isfinite(one.final_xy)):
                continue
            name, is_last = f"/marks/tries/{one.number}", one is trials[-1]
            x, y = map(float, one.final_xy)
            color = self._paint.text if is_last else _EARLIER
            scene.add_icosphere(
                f"{name}/ball", 0.014, color, position=(x, y, 0.012), cast_shadow=False
            )
            ends = level(np.stack([one.target_xy, one.final_xy]), 3 * LIFT)
            scene.add_line_segments(
                f"{name}/miss",
                ends[None].astype(np.float32),
                color,
                thickness=2.5 if is_last else 1.0,
                thickness_units="screen",
            )
            text = f"{one.try_number}"
            if is_last:
                text += f":  {one.miss_pct * length:.1f} cm, {one.miss_pct:.1f} %"
            if is_last or np.any(np.abs(_text_xy(one) - _text_xy(trials[-1])) > _TEXT_ROOM):
                x, y = _text_xy(one)
                place = (float(x), float(y), _TEXT_LIFT)
                plate = self._paint.page
                add_text(self._server, f"{name}/label", text, place, color, _TEXT_HEIGHT, plate)


def _text_xy(one: AimTrial) -> NDArray[np.float64]:
    """Return where the text of a landing lies: on its far side, where it hides no target."""
    beside = _TEXT_AWAY if one.final_xy[1] >= one.target_xy[1] else -_TEXT_AWAY
    return one.final_xy + [0.0, beside]

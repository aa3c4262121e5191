"""SeenPlane: the plane in which a camera sees the free end, and that of the tags behind it.

On a table both are one: the tags lie on it, and the end slides over it. A swing in the air is seen
from the side; the tags hang on a wall behind it, upright and parallel to its plane. To the tracker
that wall is a table over which the end moves at a constant height.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from cablecast.camera.lens import CameraView
from cablecast.camera.tags import TagLayout, default_layout
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.conventions import Array
from cablecast.errors import CameraError
from cablecast.motion.joint_move import JointMoves, SwingPlane
from cablecast.setup import Setup
from cablecast.vision.tracker import EndpointTracker
from cablecast.workspace import Workspace

_WALL = Workspace(table_width=10.0, table_depth=10.0, table_near_y=-5.0)
"""A wall that ends nowhere."""
_SEEN_MIN = 3
"""Fewest frames of a swing that show the tip."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SeenPlane:
    """The plane in which a camera sees the free end.

    Its coordinates are those of the tags: x to the right and y up, as the camera sees them.

    Attributes:
        tags: Tags in these coordinates.
        area: Part of the tags' plane that counts as grey, and on which an end may lie.
        height: Distance of the end's plane from that of the tags, towards the camera [m].
        start: Place of the end before a motion [m], shape [2].
        origin: Origin of the tags' coordinates in the base frame [m], shape [3].
        axes: Their x, y and z in the base frame, as rows, shape [3, 3].
        in_air: Whether it is the plane of swings; else the table.
        lines: Lines to draw into a picture, in the tags' coordinates [m], shape [point, 3] each.
    """

    tags: TagLayout
    area: Workspace
    height: float
    start: Array
    origin: Array
    axes: Array
    in_air: bool
    lines: tuple[Array, ...]

    @classmethod
    def of(cls, setup: Setup) -> "SeenPlane":
        """Return what the camera of a set-up sees: the table, or the plane of its swings (`wall`).

        Raises:
            CameraError: It is beside the swings of a set-up without a strike section.
            InputError: Its joints swing the cable in no plane.
        """
        camera = setup.camera
        if camera is not None and camera.wall is not None and camera.tags is not None:
            return _of_swings(setup, camera.wall, camera.side, camera.tags)
        table = setup.workspace
        layout = None if camera is None else camera.tags
        family = TagLayout.family if camera is None else camera.tag_family
        side, near, far, reset = table.half_width, table.y_min, table.y_max, table.reset_y
        edge = [(-side, near), (side, near), (side, far), (-side, far), (-side, near)]
        lines = edge, [(0.0, near), (0.0, far)], [(-side, reset), (side, reset)]
        return cls(
            tags=layout or default_layout(table, family),
            area=table,
            height=setup.cable.radius,
            start=np.array([0.0, reset + setup.cable.length]),
            origin=np.zeros(3),
            axes=np.eye(3),
            in_air=False,
            lines=tuple(np.pad(line, ((0, 0), (0, 1))) for line in lines),
        )

    def points(self, places: ArrayLike) -> Array:
        """Return points of the end's plane by their places [m], shape [..., 2].

        In the base frame [m]: shape [..., 2] on a table, and [..., 3] in the air.
        """
        places = np.asarray(places, dtype=float)
        if not self.in_air:
            return places
        height = np.full((*places.shape[:-1], 1), self.height)
        return np.concatenate([places, height], axis=-1) @ self.axes + self.origin

    def base_view(self, view: CameraView) -> CameraView:
        """Return a camera, which the tags placed in their coordinates, in the base frame."""
        rotation = np.asarray(view.rotation) @ self.axes
        position = np.asarray(view.position) @ self.axes + self.origin
        rows = tuple(tuple(row) for row in rotation.tolist())
        return CameraView(lens=view.lens, rotation=rows, position=tuple(position.tolist()))

    def track(self, tracker: EndpointTracker, duration: float, start: float) -> EndpointTrack:
        """Return the track of a trial [s] that began at a time of the frames' clock [s].

        On a table it has a sample every 100 ms, in the air one for each frame that shows the tip,
        after one at the start: there the cable hangs at rest.
        """
        if not self.in_air:
            return tracker.track(duration, start)
        times, places = tracker.frames
        times, seen = times - start, np.isfinite(places).all(axis=1)
        rest, used = seen & (times <= 0.0), seen & (times > 0.0) & (times <= duration)
        if not rest.any() or used.sum() < _SEEN_MIN:
            return EndpointTrack.unseen(TrialStatus.OCCLUDED)
        hung = np.median(places[rest], axis=0)
        points = self.points(np.vstack([hung, places[used]]))
        return EndpointTrack(
            times=np.append(0.0, times[used]),
            endpoint_xy=points[:, :2],
            endpoint_z=points[:, 2],
            status=TrialStatus.OK,
        )


def _of_swings(setup: Setup, wall: float, side: str | None, layout: TagLayout) -> SeenPlane:
    if setup.strike is None:
        raise CameraError(
            "the camera of the lab file is one of swings (wall), which need a section `strike`"
        )
    moves = JointMoves.of(setup)
    plane = SwingPlane.of(moves)
    # Who looks at the robot's right side sees what is ahead of it to the right.
    sign = 1.0 if side == "right" else -1.0
    x, y, z = sign * plane.ahead, np.array([0.0, 0.0, 1.0]), sign * plane.right
    root = moves.stick.root(moves.arm.frames(np.array(moves.start))[-1])
    top = np.array([sign * float(plane.ahead @ root), root[2]])
    hung = top - [0.0, setup.cable.length]
    tags = tuple(dataclasses.replace(tag, x=sign * tag.x) for tag in layout.tags)
    return SeenPlane(
        tags=dataclasses.replace(layout, tags=tags),
        area=_WALL,
        height=wall,
        start=hung,
        origin=plane.aside * plane.right - wall * z,
        axes=np.stack([x, y, z]),
        in_air=True,
        lines=(np.array([[*hung, wall], [*top, wall]]),),
    )

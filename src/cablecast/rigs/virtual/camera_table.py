"""Things that stand still before the virtual camera: floor, table, foam boards, tags, clutter."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.lens import CameraView
from cablecast.camera.tags import Tag, TagLayout
from cablecast.rigs.virtual.camera_config import CameraConfig, clutter_place
from cablecast.vision.tags import load_cv2, tag_picture
from cablecast.workspace import Workspace

Image = NDArray[np.uint8]
Points = Sequence[tuple[float, float]]

_TEXEL = 0.001
"""Size of a pixel of the table's texture [m]."""
_BOARD = (0.92, 0.61)
"""Size of a foam board along x and y [m]."""
_FOAM_BGR = (222, 228, 226)
_SEAM_BGR = (150, 156, 158)
_FLOOR_BGR = (92, 98, 108)
_EDGE_BGR = (60, 78, 104)
_PLATE_BGR = (128, 124, 120)
_FLOOR_Z = -0.75


def draw_background(
    view: CameraView, config: CameraConfig, workspace: Workspace, layout: TagLayout, seed: int
) -> tuple[Image, NDArray[np.bool_], NDArray[np.float32]]:
    """Draw the empty scene under even light.

    Args:
        view: True camera.
        config: Settings of the camera.
        workspace: Gives the table's size and place.
        layout: Places of the tags on the table.
        seed: Seed of tints, scuffs and the places of the clutter.

    Returns:
        The picture, BGR, shape [v, u, 3]; which pixels show the table's surface, shape [v, u]; and
        the share of the light that reaches each [-], same shape.
    """
    cv2 = load_cv2()
    rng = np.random.default_rng([seed, 17])
    texture, origin = _table_texture(workspace, layout, config, rng)
    v, u = np.ogrid[0.0 : config.height, 0.0 : config.width]
    # Undistorting two million pixels is slow; the maps are smooth, so a coarse grid will do.
    table_xy = _smooth_map(view, 0.0, config)
    floor_xy = _smooth_map(view, _FLOOR_Z, config)
    map_x = (table_xy[..., 0] - origin[0]) / _TEXEL
    map_y = (origin[1] - table_xy[..., 1]) / _TEXEL
    table = cv2.remap(
        texture,
        map_x.astype(np.float32),
        map_y.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    on_table = workspace.on_table(table_xy)
    image = table
    image[~on_table] = _floor(floor_xy, ~on_table, rng)
    centre = np.array([config.width, config.height]) / 2
    radius = np.linalg.norm(centre)
    far2 = ((u - centre[0]) / radius) ** 2 + ((v - centre[1]) / radius) ** 2
    # A lamp above the left half of the table, and the lens's own vignetting.
    lamp = (u / config.width - 0.35) ** 2 + (v / config.height - 0.45) ** 2
    shade = 1.0 - config.light.falloff * (0.55 * far2 + 0.75 * lamp)
    shade = shade.astype(np.float32)
    shaded = image * shade[..., None]
    return np.clip(shaded, 0, 255, out=shaded).astype(np.uint8), on_table, shade


def _smooth_map(view: CameraView, z: float, config: CameraConfig) -> NDArray[np.float64]:
    """Return the points of a level plane under every pixel [m], shape [v, u, 2]."""
    from scipy.interpolate import RectBivariateSpline

    us = np.linspace(-1.0, config.width, 61)
    vs = np.linspace(-1.0, config.height, 41)
    grid = view.to_table(np.stack(np.meshgrid(us, vs), axis=-1), z)
    u, v = np.arange(config.width), np.arange(config.height)
    return np.stack(
        [RectBivariateSpline(vs, us, grid[..., axis])(v, u) for axis in (0, 1)], axis=-1
    )


def _floor(
    xy: NDArray[np.float64], seen: NDArray[np.bool_], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Draw grey floor tiles where the floor is seen.

    Args:
        xy: Points of the floor under every pixel [m], shape [v, u, 2].
        seen: Pixels that show the floor, shape [v, u].
        rng: Draws the stains.

    Returns:
        Colours of these pixels, BGR, shape [pixel, 3].
    """
    cv2 = load_cv2()
    place = xy[seen] / 0.5
    tile = np.floor(place).astype(int)
    checker = ((tile[:, 0] * 7 + tile[:, 1] * 13) % 5) * 2.5
    near = np.abs(place - np.round(place)) < 0.012
    grout = near[:, 0] | near[:, 1]
    stains = cv2.resize(
        rng.normal(0, 4, (9, 16)).astype(np.float32),
        (xy.shape[1], xy.shape[0]),
        interpolation=cv2.INTER_CUBIC,
    )[seen]
    image = np.array(_FLOOR_BGR) + (checker + stains - 22.0 * grout)[:, None]
    return np.clip(image, 0, 255).astype(np.uint8)


def _table_texture(
    workspace: Workspace, layout: TagLayout, config: CameraConfig, rng: np.random.Generator
) -> tuple[Image, tuple[float, float]]:
    """Draw the table from straight above.

    Returns:
        The texture, BGR, and the place of its upper left pixel (x, y) [m].
    """
    cv2 = load_cv2()
    columns = round(2 * workspace.half_width / _TEXEL)
    rows = round((workspace.y_max - workspace.y_min) / _TEXEL)
    origin = (-workspace.half_width + _TEXEL / 2, workspace.y_max - _TEXEL / 2)

    def px(x: float, y: float) -> tuple[int, int]:
        return round((x - origin[0]) / _TEXEL), round((origin[1] - y) / _TEXEL)

    texture = _foam(columns, rows, rng)
    cv2.rectangle(texture, (0, 0), (columns - 1, rows - 1), _EDGE_BGR, 9)
    # The robot's mounting plate, as far as it is on this table.
    cv2.rectangle(texture, px(-0.2, 0.2), px(0.2, -0.2), _PLATE_BGR, -1)
    if config.distractors:
        _draw_clutter(texture, px, workspace, rng)
    for tag in layout.tags:
        # Nobody sticks a tag exactly where the plan has it.
        x, y = rng.normal([tag.x, tag.y], config.tag_error)
        _paste_tag(texture, origin, dataclasses.replace(tag, x=float(x), y=float(y)))
    # As fine as a camera pixel sees it.
    return cv2.GaussianBlur(texture, (0, 0), 0.7), origin


def _foam(columns: int, rows: int, rng: np.random.Generator) -> Image:
    """Draw foam boards of slightly different age, laid from the far left corner on."""
    cv2 = load_cv2()
    texture = np.empty((rows, columns, 3), np.uint8)
    step_x, step_y = round(_BOARD[0] / _TEXEL), round(_BOARD[1] / _TEXEL)
    for top in range(0, rows, step_y):
        for left in range(0, columns, step_x):
            tint = np.array(_FOAM_BGR) + rng.normal(0, 3.0) + rng.normal(0, 1.2, 3)
            texture[top : top + step_y, left : left + step_x] = np.clip(tint, 0, 255)
    grain = rng.normal(0, 1.5, (rows // 4 + 1, columns // 4 + 1)).astype(np.float32)
    grain = cv2.resize(grain, (columns, rows), interpolation=cv2.INTER_CUBIC)
    grained = texture + grain[..., None]
    texture = np.clip(grained, 0, 255, out=grained).astype(np.uint8)
    for _ in range(40):
        start = rng.uniform([0, 0], [columns, rows])
        end = start + rng.normal(0, 120, 2)
        shade = np.array(_FOAM_BGR) - rng.uniform(6, 22)
        cv2.line(
            texture,
            tuple(np.round(start).astype(int).tolist()),
            tuple(np.round(end).astype(int).tolist()),
            shade.tolist(),
            int(rng.integers(1, 4)),
            cv2.LINE_AA,
        )
    for top in range(step_y, rows, step_y):
        cv2.line(texture, (0, top), (columns, top), _SEAM_BGR, 3, cv2.LINE_AA)
    for left in range(step_x, columns, step_x):
        cv2.line(texture, (left, 0), (left, rows), _SEAM_BGR, 3, cv2.LINE_AA)
    return texture


def _paste_tag(texture: Image, origin: tuple[float, float], tag: Tag) -> None:
    """Stick a printed tag on the table."""
    cv2 = load_cv2()
    cell = 12
    picture = tag_picture(tag.id, cell)
    # Within a white rim of one cell. A square's side lies half a pixel beside its pixels' centres.
    near, far = cell - 0.5, 9 * cell - 0.5
    source = np.array([[near, near], [far, near], [far, far], [near, far]])
    corners = tag.corners[:, :2]
    place = np.stack([corners[:, 0] - origin[0], origin[1] - corners[:, 1]], axis=1) / _TEXEL
    # The rim reaches an eighth of the square's side beyond it; more than that need not be warped.
    reach = 0.25 * tag.size / _TEXEL
    left, top = np.maximum(np.floor(place.min(axis=0) - reach), 0).astype(int)
    right, bottom = np.ceil(place.max(axis=0) + reach).astype(int)
    region = texture[top:bottom, left:right]
    if region.size == 0:
        return
    local = (place - [left, top]).astype(np.float32)
    H = cv2.getPerspectiveTransform(source.astype(np.float32), local)
    shape = (region.shape[1], region.shape[0])
    inside = cv2.warpPerspective(np.full_like(picture, 255), H, shape) > 127
    warped = cv2.warpPerspective(picture, H, shape, borderMode=cv2.BORDER_REPLICATE)
    # Ink is not black and paper not as white as the foam.
    ink = np.clip(warped.astype(np.float32) * 0.82 + 28.0, 0, 255).astype(np.uint8)
    region[inside] = ink[inside, None]


def _draw_clutter(
    texture: Image,
    px: Callable[[float, float], tuple[int, int]],
    workspace: Workspace,
    rng: np.random.Generator,
) -> None:
    """Draw a green cloth, a screwdriver with a green handle, a bottle cap, and a blue box."""
    cv2 = load_cv2()

    def polygon(points: Points, colour: tuple[int, int, int]) -> None:
        corners = np.array([px(x, y) for x, y in points], dtype=np.int32)
        cv2.fillPoly(texture, [corners], colour, cv2.LINE_AA)

    def turned(place: tuple[float, float], angle: float, points: Points) -> Points:
        (x, y), c, s = place, np.cos(angle), np.sin(angle)
        return [(x + c * a - s * b, y + s * a + c * b) for a, b in points]

    shake = rng.uniform(-0.02, 0.02, 6)
    places = [
        clutter_place(x, y, workspace)
        for x, y in ((-1.08, 0.42), (-1.06, 0.44), (1.16, 0.45), (-0.95, 1.18), (1.05, 1.12))
    ]
    cloth_at, fold_at, driver_at, cap_at, box_at = places
    if not (cloth_at and fold_at and driver_at and cap_at and box_at):
        return
    # A folded cloth at the left edge.
    angle = 0.35 + shake[0]
    cloth = [(-0.11, -0.08), (0.10, -0.09), (0.12, 0.07), (0.02, 0.10), (-0.12, 0.06)]
    polygon(turned(cloth_at, angle, cloth), (96, 148, 84))
    fold = [(-0.07, -0.02), (0.09, -0.07), (0.11, 0.05)]
    polygon(turned(fold_at, angle, fold), (82, 130, 72))
    for offset in (-0.05, 0.0, 0.05):
        ends = turned(cloth_at, angle, [(-0.1, offset), (0.1, offset * 0.6)])
        cv2.line(texture, px(*ends[0]), px(*ends[1]), (74, 122, 66), 2, cv2.LINE_AA)
    # A screwdriver at the right edge.
    angle = 1.1 + shake[1]
    blade = [(0.05, -0.003), (0.17, -0.003), (0.17, 0.003), (0.05, 0.003)]
    polygon(turned(driver_at, angle, blade), (150, 148, 146))
    handle = [(-0.05, -0.010), (-0.03, -0.014), (0.05, -0.009), (0.05, 0.009), (-0.03, 0.014)]
    polygon(turned(driver_at, angle, [*handle, (-0.05, 0.010)]), (40, 168, 120))
    stripe = [(-0.03, -0.003), (0.04, -0.003), (0.04, 0.003), (-0.03, 0.003)]
    polygon(turned(driver_at, angle, stripe), (30, 30, 30))
    # A bottle cap as large as the marker, and a box of another colour.
    cap = px(cap_at[0], cap_at[1] + shake[2])
    cv2.circle(texture, cap, 13, (70, 150, 40), -1, cv2.LINE_AA)
    cv2.circle(texture, cap, 9, (84, 166, 52), 1, cv2.LINE_AA)
    box = [(-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (-0.05, 0.03)]
    polygon(turned(box_at, 0.2 + shake[3], box), (168, 96, 48))

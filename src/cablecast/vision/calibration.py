"""Calibration: from pictures of a board and of the tags on the table to a CameraView.

A board held at several angles gives the lens (`calibrate_lens`), tags at measured places give the
camera's pose (`calibrate_view`). Without a board, the tags alone give the distortion too, given the
angle of view from the camera's data sheet. Seen from straight above, a wrong focal length is then
made up for by a wrong height, and only points above the table's plane notice.
"""

import dataclasses
import pathlib
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.lens import CameraView, Lens
from cablecast.camera.tags import FAMILY, TAG_COUNTS, TagLayout, tag_family
from cablecast.errors import CameraError, InputError, check_count, check_number
from cablecast.files import read_json, write_json
from cablecast.vision.tags import detect_tags, dictionary_of, family_seen, load_cv2, to_grey

TAG_COUNT_MIN = 4
"""Fewest tags that determine the lens and the camera's pose."""
VIEW_COUNT_MIN = 5
"""Fewest pictures of a board that determine the lens."""
_OUTLIER_PX = 3.0
"""Largest miss of a tag's corners [px]: one that misses by more was moved, or half covered."""
_FEW_WIDTH = 1280
"""Width of the pictures in which the tags of another board are looked for [px]."""
_TAG_MOVE_MAX = 3.0
"""Longest way of a tag's centre since the calibration that is no move, but noise [px]."""
_VIEW_MOVE_MAX = 1.0
"""Longest way that most tags have gone together [px]."""
_TAGS_SEEN_MIN = 0.5
"""Smallest share of the tags of the calibration that are still seen."""
_TURN_OFF = 0.2
"""Largest miss of tags by a picture that is turned, as a share of its width."""
_BOARD_SPREAD_MIN = 0.35
"""Smallest share of the image's width over which all pictures together must show the board."""
_BOARD_MOVE_MIN = 0.005
"""Way of the board's corners, as a share of the width, from which on its pose is another one."""
BOARD_CORNERS_MIN = 12
"""Fewest corners of a board by which a picture counts."""
FOCAL_SD_MAX = 0.01
"""Largest standard deviation of the focal length that is a fit, as a share of it."""
CENTRE_SD_MAX = 0.003
"""Largest standard deviation of the centre, as a share of the width. Sets of pictures below both
bounds put points on the table, and to 5 cm above it, within 1 mm; see test_lens_fit.py."""
EDGE_SD_MAX = 3 / 1280
"""Largest standard deviation of a place on the table by the lens, anywhere in the picture, as a
share of the width. The free end is then off by less than 1 mm (rms) where casts end on the paper's
table, and by up to 4 mm at its rim, in 98 of 100 sets; at twice the bound by 2 and 10 mm. See
test_lens_fit.py. Boards that were never near the edges leave a hundred times the bound."""
_TILT_ADVICE = (
    "take pictures with the board tilted by 20 to 40 degrees, to the left, right, front and back, "
    "and with it in the corners of the picture, where a part of it may be cut off"
)


FoundTags = Mapping[int, NDArray[np.float64]]
"""Corners of the tags in a picture by their numbers [px], from `detect_tags`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Board:
    """A ChArUco board for calibrating a lens.

    Attributes:
        column_count: Number of squares across.
        row_count: Number of squares down.
        square: Side of a square [m].
        tag: Side of a tag in it [m].
        family: Family of the tags, a key of `cablecast.camera.tags.TAG_COUNTS`.
        legacy: True for the pattern of OpenCV before 4.6, which starts with a white square where
            the number of rows is even.
    """

    column_count: int = 11
    row_count: int = 8
    square: float = 0.06
    tag: float = 0.045
    family: str = "4X4_100"
    legacy: bool = False

    def __post_init__(self):
        object.__setattr__(self, "family", tag_family(self.family))
        for name in ("column_count", "row_count"):
            check_count(f"board {name}", getattr(self, name), 2, 100)
        check_number("board square", self.square, 0.001, 1.0, "m")
        check_number("board tag", self.tag, 0.0005, 1.0, "m")
        if self.tag >= self.square:
            raise InputError(
                f"board tag = {self.tag:g} m must be smaller than its squares of {self.square:g} m"
            )
        needed, known = self.column_count * self.row_count // 2, TAG_COUNTS[self.family]
        if needed > known:
            raise InputError(f"the board has {needed} tags, and {self.family} only {known}")

    def to_opencv(self) -> Any:
        """Return the board as OpenCV knows it."""
        cv2 = load_cv2()
        dictionary = dictionary_of(self.family)
        size = (self.column_count, self.row_count)
        board = cv2.aruco.CharucoBoard(size, self.square, self.tag, dictionary)
        board.setLegacyPattern(self.legacy)
        return board

    def picture(self, square_px: int = 60) -> NDArray[np.uint8]:
        """Draw the board to print or to render, without a rim, its squares of a side [px]."""
        size = (self.column_count * square_px, self.row_count * square_px)
        return self.to_opencv().generateImage(size, marginSize=0, borderBits=1)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LensFit:
    """A lens, and the quality of its calibration.

    Attributes:
        lens: Lens.
        rms_px: Root mean square distance of the board's corners from where the lens puts them [px].
        picture_count: Number of pictures that show enough of the board.
        board: Board that they show; `legacy` marks the older pattern.
        focal_sd: Standard deviation of the focal lengths, the larger [px].
        centre_sd: Standard deviation of the centre along u and v, the larger [px].
        distortion_sd: Standard deviations of k1, k2, p1, p2, k3 [-].
        edge_sd: Standard deviation of where the lens puts the table, at the worst place of the
            picture, most often a corner [px].
    """

    lens: Lens
    rms_px: float
    picture_count: int
    board: Board
    focal_sd: float
    centre_sd: float
    distortion_sd: tuple[float, ...]
    edge_sd: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Calibration:
    """A calibrated camera, and the quality of its calibration.

    Attributes:
        view: Lens and place of the camera.
        rms_px: Root mean square distance between where tags' corners were seen and where this
            calibration puts them [px].
        rms: Root mean square of that distance on the table [m].
        corners: Corners of the tags that were used, where they were seen, by the numbers of the
            tags [px], shape [4, 2] as nested tuples.
        family: Family of the tags.
        rejected_ids: Numbers of tags that were seen where the layout does not have them.
        turned: Whether the tags are turned by 180 degrees against the pictures that the installed
            OpenCV draws; those of the AprilTag library are, up to OpenCV 5.0.
    """

    view: CameraView
    rms_px: float
    rms: float
    corners: dict[int, tuple[tuple[float, float], ...]]
    family: str = FAMILY
    rejected_ids: tuple[int, ...] = ()
    turned: bool = False

    @property
    def tag_ids(self) -> tuple[int, ...]:
        """Numbers of the tags that were used."""
        return tuple(self.corners)

    def save(self, path: pathlib.Path) -> None:
        """Write the calibration as JSON."""
        write_json(path, dataclasses.asdict(self))

    @classmethod
    def load(cls, path: pathlib.Path) -> "Calibration":
        """Read a calibration."""
        try:
            values = read_json(path)
            view = values.pop("view")
            values["view"] = CameraView(
                lens=Lens.from_dict(view["lens"]),
                rotation=tuple(tuple(row) for row in view["rotation"]),
                position=tuple(view["position"]),
            )
            if "corners" not in values:
                raise InputError("it does not say where it saw the tags, so calibrate anew")
            values["corners"] = {
                int(tag_id): tuple((float(u), float(v)) for u, v in quad)
                for tag_id, quad in values["corners"].items()
            }
            values["rejected_ids"] = tuple(values["rejected_ids"])
            return cls(**values)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            reason = repr(error) if isinstance(error, (KeyError, AttributeError)) else error
            raise InputError(f"{path} is no calibration of a camera: {reason}") from None


@dataclasses.dataclass(frozen=True, kw_only=True)
class TagShift:
    """Distance between where tags are seen and where their calibration saw them.

    Attributes:
        px: Distance in the picture, in the median of the tags [px].
        table: Distance on the table, in the median of the tags [m].
        moved: Distances in the picture [px] and on the table [m] of tags that were moved by
            themselves, by their numbers.
    """

    px: float
    table: float
    moved: dict[int, tuple[float, float]]

    @property
    def words(self) -> str:
        """Distances for a person."""
        return f"{self.px:.1f} px ({1e3 * self.table:.1f} mm on the table)"

    @property
    def moved_words(self) -> str:
        """Tags that were moved, for a person; empty without any."""
        return ", ".join(
            f"{i} by {px:.1f} px, {1e3 * way:.1f} mm" for i, (px, way) in self.moved.items()
        )


def calibrate_lens(images: Sequence[NDArray[np.uint8]], board: Board) -> LensFit:
    """Fit a lens to pictures of a board at several places and angles.

    Boards printed by OpenCV before 4.6 have another pattern. Whichever of the two the pictures show
    is used.

    Raises:
        InputError: Too few pictures show the board, or they do not determine the lens; says which
            pictures to take.
    """
    height, width = images[0].shape[:2] if images else (0, 0)
    for image in images:
        if image.shape[:2] != (height, width):
            raise InputError(f"pictures of a board differ in size: {image.shape}, {height, width}")
    patterns = [dataclasses.replace(board, legacy=legacy) for legacy in (False, True)]
    # The wrong pattern puts corners where there are none: none is found, or a few by chance.
    found = [[find_board(image, pattern) for image in images] for pattern in patterns]
    counts = [sum(len(ids) for _, ids in pictures) for pictures in found]
    if all(len(ids) < BOARD_CORNERS_MIN for pictures in found for _, ids in pictures):
        _check_squares(images, board)
    i = int(counts[1] > counts[0])
    return fit_lens(found[i], patterns[i], (width, height))


def _check_squares(images: Sequence[NDArray[np.uint8]], board: Board) -> None:
    """Refuse pictures that show another board, by the tags in two of them."""
    cv2, share = load_cv2(), min(1.0, _FEW_WIDTH / max(images[0].shape[1], 1)) if images else 1.0
    few = [
        cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        for image in images[:: max(len(images) // 2, 1)][:2]
    ]
    asked = f"the board of {board.column_count} x {board.row_count} squares"
    # Families begin alike: the one that was named comes first.
    ids = sorted({i for image in few for i in detect_tags(image, board.family)})
    if len(ids) >= TAG_COUNT_MIN:
        raise InputError(
            f"0 of {len(images)} pictures show {asked}, but {len(ids)} tags of {board.family} are "
            f"seen in {len(few)} of them, numbers {ids[0]} to {ids[-1]}: a board with these has "
            f"about {2 * (ids[-1] + 1)} squares, not {board.column_count * board.row_count}. Name "
            "the squares across and down (--squares), or show the whole board, and sharp"
        )
    if (other := family_seen(few)) is not None:
        raise InputError(
            f"0 of {len(images)} pictures show the board with tags of {board.family}: they show "
            f"tags of {other}. Name that family, and the board's squares"
        )


def fit_lens(found: Sequence[tuple[Any, Any]], board: Board, size: tuple[int, int]) -> LensFit:
    """Fit a lens to the corners of a board in pictures of a width and a height [px].

    Args:
        found: Corners of the board in each picture, and their numbers, from `find_board`.
        board: Board with the pattern that they show.
        size: Width and height of the pictures [px].

    Raises:
        InputError: Too few pictures show enough of the board, or they do not determine the lens.
    """
    cv2, charuco, width = load_cv2(), board.to_opencv(), size[0]
    views, places = [], []
    for corners, ids in found:
        columns, rows = np.divmod(np.ravel(ids), board.column_count - 1)
        # A single row says nothing of the angle at which the board is held.
        if len(ids) < BOARD_CORNERS_MIN or not np.ptp(columns) or not np.ptp(rows):
            continue
        place = dict(zip(np.ravel(ids).tolist(), np.reshape(corners, (-1, 2)), strict=True))
        # A picture of the same pose says nothing new, and would count as if it did.
        if all(_apart(place, other) > _BOARD_MOVE_MIN * width for other in places):
            views.append(charuco.matchImagePoints(corners, ids))
            places.append(place)
    if len(views) < VIEW_COUNT_MIN:
        raise InputError(
            f"{len(views)} of {len(found)} pictures show the board in a pose of its own, with "
            f"{BOARD_CORNERS_MIN} corners in two rows or more: at least {VIEW_COUNT_MIN} are needed"
        )
    objects, pixels = (list(points) for points in zip(*views, strict=True))
    spread = np.ptp(np.concatenate(pixels).reshape(-1, 2)[:, 0]) / width
    if spread < _BOARD_SPREAD_MIN:
        raise InputError(
            f"the board was seen over {100 * spread:.0f} % of the image's width only: "
            f"show it in all corners, over at least {100 * _BOARD_SPREAD_MIN:.0f} %"
        )
    try:
        rms, K, distortion, rvecs, tvecs = cv2.calibrateCamera(objects, pixels, size, None, None)
        lens = _lens_from_opencv(*size, K, distortion)
    except (cv2.error, InputError):
        raise InputError(f"the pictures do not determine the lens: {_TILT_ADVICE}") from None
    covariance = rms**2 * _intrinsic_covariance(objects, K, distortion, rvecs, tvecs)
    sds = np.sqrt(np.diag(covariance))
    fit = LensFit(
        lens=lens,
        rms_px=float(rms),
        picture_count=len(views),
        board=board,
        focal_sd=float(max(sds[:2])),
        centre_sd=float(max(sds[2:4])),
        distortion_sd=tuple(sds[4:].tolist()),
        edge_sd=_edge_sd(lens, covariance),
    )
    tilts = [np.degrees(np.arccos(abs(cv2.Rodrigues(rvec)[0][2, 2]))) for rvec in rvecs]
    share = fit.focal_sd / min(lens.focal)
    if not (share <= FOCAL_SD_MAX and fit.centre_sd <= CENTRE_SD_MAX * width):
        raise InputError(
            f"the pictures do not determine the lens: focal length {lens.focal[0]:.0f} px +- "
            f"{100 * share:.2f} %, centre +- {fit.centre_sd:.2f} px; at most "
            f"{100 * FOCAL_SD_MAX:g} % and {CENTRE_SD_MAX * width:.2f} px. The board is tilted by "
            f"{min(tilts):.0f} to {max(tilts):.0f} deg: {_TILT_ADVICE}"
        )
    if not fit.edge_sd <= EDGE_SD_MAX * width:
        raise InputError(
            f"the pictures leave the lens open by {fit.edge_sd:.2f} px at the picture's edge, "
            f"above {EDGE_SD_MAX * width:.2f} px ({1e3 * fit.edge_sd / width:.1f} mm for each "
            f"metre that the picture shows across, above {1e3 * EDGE_SD_MAX:.1f} mm): "
            f"{_TILT_ADVICE}"
        )
    return fit


def _apart(a: dict[int, NDArray[np.float32]], b: dict[int, NDArray[np.float32]]) -> float:
    """Return how far the corners of a board went between two pictures, on average [px]."""
    common = a.keys() & b.keys()
    return float(np.mean([np.linalg.norm(a[i] - b[i]) for i in common])) if common else np.inf


def _inner_slopes(points: Any, rvec: Any, tvec: Any, K: Any, distortion: Any) -> Any:
    """Return derivatives of pixels by fu, fv, cu, cv, k1, k2, p1, p2, k3, shape [2 * point, 9].

    What the board's pose, which is fitted too, explains is left out.
    """
    slopes = load_cv2().projectPoints(points, rvec, tvec, K, distortion)[1]
    pose, inner = slopes[:, :6], slopes[:, 6:15]
    return inner - pose @ np.linalg.lstsq(pose, inner, rcond=None)[0]


def _intrinsic_covariance(
    objects: list[Any], K: Any, distortion: Any, rvecs: Any, tvecs: Any
) -> NDArray[np.float64]:
    """Return the covariance of fu, fv, cu, cv, k1, k2, p1, p2, k3 for a misfit of 1 px (rms).

    OpenCV's own (`calibrateCameraExtended`) leaves directions out that the pictures do not
    determine at all, and so calls a lens exact about which they say nothing.
    """
    information = np.zeros((9, 9))
    for points, rvec, tvec in zip(objects, rvecs, tvecs, strict=True):
        inner = _inner_slopes(points, rvec, tvec, K, distortion)
        information += inner.T @ inner
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    # The misfit is that of both coordinates of a corner.
    covariance = (vectors / np.maximum(values, 1e-14)) @ vectors.T / 2
    return covariance / np.outer(scale, scale)


def _edge_sd(lens: Lens, covariance: NDArray[np.float64]) -> float:
    """Return how far a lens leaves a table open whose pose is found with it, where most [px]."""
    u, v = np.meshgrid(np.linspace(0, lens.width - 1, 17), np.linspace(0, lens.height - 1, 10))
    ideal = lens.undistort(np.stack([u, v], axis=-1)).reshape(-1, 2)
    table, none = np.column_stack([ideal, np.ones(len(ideal))]), np.zeros(3)
    slopes = _inner_slopes(table, none, none, lens.matrix, np.array(lens.distortion))
    variance = np.einsum("ij,jk,ik->i", slopes, covariance, slopes)
    return float(np.sqrt(variance.reshape(-1, 2).sum(axis=1).max()))


def find_board(image: NDArray[np.uint8], board: Board) -> tuple[Any, Any]:
    """Return the corners of a board in a picture, grey or BGR; empty where it is not seen.

    Returns:
        Corners [px], shape [corner, 1, 2], and their numbers, shape [corner, 1].
    """
    cv2 = load_cv2()
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board.to_opencv()).detectBoard(to_grey(image))
    if ids is None:
        return np.empty((0, 1, 2), np.float32), np.empty((0, 1), np.int32)
    return corners, ids


def calibrate_view(
    images: Sequence[NDArray[np.uint8]],
    layout: TagLayout,
    *,
    lens: Lens | None = None,
    diagonal_view: float = np.radians(78.0),
) -> Calibration:
    """Fit the camera's place, and its lens too if that is not known, to tags on the table.

    Args:
        images: Pictures of the table from the unmoved camera; corners are averaged over them.
        layout: Places of the tags.
        lens: Lens from `calibrate_lens`; None to find the distortion from the tags.
        diagonal_view: Angle of view over the diagonal, used without a lens [rad]. The default is
            that of the paper's camera.

    Raises:
        InputError: Too few tags were seen, or they do not lie where the layout says.
    """
    if not images:
        raise InputError("a calibration needs at least one picture")
    seen = _median_tags([detect_tags(image, layout.family) for image in images], layout.corners)
    height, width = images[0].shape[:2]
    if lens is not None and (lens.width, lens.height) != (width, height):
        raise InputError(
            f"the lens was calibrated for {lens.width} x {lens.height} px, "
            f"but the pictures have {width} x {height}"
        )
    guess = Lens.from_view(width, height, diagonal_view) if lens is None else lens
    places = layout.corners
    rejected: list[int] = []
    turned: bool | None = None
    while True:
        if len(seen) < TAG_COUNT_MIN:
            extra = f", and tags {sorted(rejected)} lie elsewhere" if rejected else ""
            if not seen and not rejected and (other := family_seen(images[:1])):
                extra = f", but some of {other} are seen"
            raise InputError(
                f"{len(seen)} of the layout's {len(layout.tags)} tags can be used{extra}: at least "
                f"{TAG_COUNT_MIN} of {layout.family} are needed"
            )
        ids = sorted(seen)
        points = np.concatenate([places[i] for i in ids])
        fits = []
        for turn in (False, True) if turned is None else (turned,):
            corners = np.concatenate([np.roll(seen[i], 2 * turn, axis=0) for i in ids])
            view = _fit_view(points, corners, guess, lens_known=lens is not None)
            miss = np.linalg.norm(view.to_image(points) - corners, axis=1).reshape(-1, 4)
            fits.append((float(np.median(miss)), turn, view, corners, miss))
        # Of either orientation, the one that most tags agree with.
        _, turned, view, corners, miss = min(fits, key=lambda fit: fit[0])
        worst = int(np.argmax(miss.max(axis=1)))
        if miss[worst].max() <= _OUTLIER_PX:
            break
        rejected.append(ids[worst])
        del seen[ids[worst]]
    on_table = view.to_table(corners) - points[:, :2]
    return Calibration(
        view=view,
        rms_px=float(np.sqrt(np.mean(miss**2))),
        rms=float(np.sqrt(np.mean(np.sum(on_table**2, axis=1)))),
        corners={i: tuple(map(tuple, seen[i].tolist())) for i in ids},
        family=layout.family,
        rejected_ids=tuple(sorted(rejected)),
        turned=bool(turned),
    )


def _fit_view(
    points: NDArray[np.float64], corners: NDArray[np.float64], guess: Lens, *, lens_known: bool
) -> CameraView:
    """Fit a camera, and the distortion of a lens that is not known, to tags' corners [m, px]."""
    cv2 = load_cv2()
    if lens_known:
        _, rvec, tvec = cv2.solvePnP(points, corners, guess.matrix, np.array(guess.distortion))
        return _view(guess, rvec, tvec)
    # Tags cannot separate focal length from height, nor the axis from a tilt: hold these.
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_FOCAL_LENGTH
    flags |= cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    _, K, distortion, rvecs, tvecs = cv2.calibrateCamera(
        [points.astype(np.float32)],
        [corners.astype(np.float32)],
        (guess.width, guess.height),
        guess.matrix,
        np.zeros(5),
        flags=flags,
    )
    fitted = _lens_from_opencv(guess.width, guess.height, K, distortion)
    return _view(fitted, rvecs[0], tvecs[0])


def _median_tags(
    found: Sequence[FoundTags], tag_ids: Collection[int]
) -> dict[int, NDArray[np.float64]]:
    """Return median corners of each of some tags over the pictures that show it [px]."""
    quads = {tag_id: [seen[tag_id] for seen in found if tag_id in seen] for tag_id in tag_ids}
    # The median: an arm that passes over a tag's rim spoils a few pictures, not most.
    return {tag_id: np.median(seen, axis=0) for tag_id, seen in quads.items() if seen}


def check_tags(
    found: Sequence[FoundTags], calibration: Calibration, where: str, advice: str
) -> TagShift:
    """Return how far tags are from where their calibration saw them.

    Args:
        found: Tags in pictures of the same camera, from `detect_tags`.
        calibration: Calibration of the camera.
        where: Place of the pictures, for errors; may be empty.
        advice: What to do if the camera was moved.

    Raises:
        CameraError: The camera was moved, the pictures are turned, or too few tags are seen.
    """
    seen = _median_tags(found, calibration.tag_ids)
    if len(seen) < _TAGS_SEEN_MIN * len(calibration.tag_ids):
        raise CameraError(
            f"only {len(seen)} of {len(calibration.tag_ids)} tags are still seen{where}: clear "
            "what covers them, and switch automatic focus off"
        )
    view = calibration.view
    now = np.array([quad.mean(axis=0) for quad in seen.values()]).reshape(-1, 2)
    before = np.array([calibration.corners[i] for i in seen]).reshape(-1, 4, 2).mean(axis=1)
    ways = np.linalg.norm(now - before, axis=1)
    on_table = np.linalg.norm(view.to_table(now) - view.to_table(before), axis=1)
    moved = {i: at for at, i in enumerate(seen) if ways[at] > _TAG_MOVE_MAX}
    shift = TagShift(
        px=float(np.median(ways)),
        table=float(np.nanmedian(on_table)),
        moved={i: (float(ways[at]), float(on_table[at])) for i, at in moved.items()},
    )
    # Noise moves one tag, and not most of them.
    if shift.px > _VIEW_MOVE_MAX:
        turned = [view.lens.width - 1, view.lens.height - 1] - before
        if np.median(np.linalg.norm(now - turned, axis=1)) < _TURN_OFF * view.lens.width:
            raise CameraError(
                f"the pictures{where} are turned by 180 deg against those of the calibration, so "
                f"that {len(seen)} tags are seen {shift.words} from where they were: {advice}"
            )
        raise CameraError(
            f"the camera was moved: {len(seen)} tags are seen{where} {shift.words} from where they "
            f"were calibrated: {advice}"
        )
    return shift


def _lens_from_opencv(width: int, height: int, K: Any, distortion: Any) -> Lens:
    """Return the lens of OpenCV's camera matrix and distortion."""
    k1, k2, p1, p2, k3 = np.ravel(distortion)[:5].tolist()
    return Lens(
        width=width,
        height=height,
        focal=(float(K[0, 0]), float(K[1, 1])),
        centre=(float(K[0, 2]), float(K[1, 2])),
        distortion=(k1, k2, p1, p2, k3),
    )


def _view(lens: Lens, rvec: Any, tvec: Any) -> CameraView:
    """Return the camera of a lens and OpenCV's pose of the table before it."""
    R = load_cv2().Rodrigues(np.asarray(rvec, dtype=float))[0]
    x, y, z = (-R.T @ np.ravel(tvec)).tolist()
    return CameraView(lens=lens, rotation=tuple(map(tuple, R.tolist())), position=(x, y, z))

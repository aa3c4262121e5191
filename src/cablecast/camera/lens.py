"""Lenses: a pinhole with the distortion of OpenCV's model, in plain NumPy.

Pixel coordinates (u, v) count from the centre of the upper left pixel, u to the right, v down.
Normalised coordinates are those of an ideal pinhole of focal length 1.
"""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError, check_count, check_keys, check_number

_NEWTON_COUNT = 12
_NEWTON_STEP_MAX = 0.3


VIEW_BOUNDS_DEG = 6.0, 149.0
"""Bounds of the view over the diagonal of a picture [deg]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lens:
    """Intrinsics of a camera.

    Attributes:
        width: Width of the image [px].
        height: Height of the image [px].
        focal: Focal lengths along u and v [px].
        centre: Point at which the optical axis meets the image, u and v [px].
        distortion: Coefficients k1, k2, p1, p2, k3 of OpenCV's model [-].
    """

    width: int
    height: int
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self):
        for name in ("width", "height"):
            check_count(f"lens {name}", getattr(self, name), 16, 16384)
        for name, size in (("focal", 2), ("centre", 2), ("distortion", 5)):
            values = getattr(self, name)
            if len(values) != size:
                raise InputError(f"lens {name} = {values} must be {size} finite numbers")
            for value in values:
                check_number(f"lens {name}", value, -1e6, 1e6)
        if min(self.focal) <= 0:
            raise InputError(f"lens focal = {self.focal} px must be positive")

    @classmethod
    def from_view(cls, width: int, height: int, diagonal_view: float) -> "Lens":
        """Return a lens without distortion from the view over the image's diagonal [rad]."""
        check_number("diagonal view", float(np.degrees(diagonal_view)), *VIEW_BOUNDS_DEG, "deg")
        focal = float(np.hypot(width, height) / 2 / np.tan(diagonal_view / 2))
        return cls(
            width=width,
            height=height,
            focal=(focal, focal),
            centre=((width - 1) / 2, (height - 1) / 2),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, which `from_dict` reads."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in dataclasses.asdict(self).items()
        }

    @classmethod
    def from_dict(cls, values: Any) -> "Lens":
        """Make a lens from plain values.

        Raises:
            InputError: A key is unknown or missing, or a value out of bounds.
        """
        required = {"width", "height", "focal", "centre"}
        values = check_keys(values, required | {"distortion"}, "lens", required=required)
        for name in values.keys() - {"width", "height"}:
            row = values[name]
            values[name] = tuple(row) if isinstance(row, (list, tuple)) else (row,)
        return cls(**values)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Camera matrix as OpenCV takes it, shape [3, 3]."""
        (fu, fv), (cu, cv) = self.focal, self.centre
        return np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]])

    def distort(self, normalised: ArrayLike) -> NDArray[np.float64]:
        """Return the pixels at which normalised points appear, shape [..., 2]."""
        ideal = np.asarray(normalised, dtype=float)
        return self._bend(ideal) * self.focal + self.centre

    def undistort(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the normalised points that appear at some pixels, shape [..., 2]."""
        wanted = (np.asarray(pixels, dtype=float) - self.centre) / self.focal
        ideal = wanted.copy()
        for _ in range(_NEWTON_COUNT):
            a, b, d = self._jacobian(ideal)
            miss_x, miss_y = np.moveaxis(wanted - self._bend(ideal), -1, 0)
            step = np.stack([d * miss_x - b * miss_y, a * miss_y - b * miss_x], axis=-1)
            step /= (a * d - b * b)[..., None]
            ideal = ideal + np.clip(step, -_NEWTON_STEP_MAX, _NEWTON_STEP_MAX)
        return ideal

    def _bend(self, ideal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return distorted normalised points, shape [..., 2]."""
        _, _, p1, p2, _ = self.distortion
        x, y, r2, radial = self._radial(ideal)
        return np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )

    def _radial(self, ideal: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return x, y, their squared radius and the factor of radial distortion, shape [...]."""
        k1, k2, _, _, k3 = self.distortion
        x, y = ideal[..., 0], ideal[..., 1]
        r2 = x * x + y * y
        return x, y, r2, 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))

    def _jacobian(self, ideal: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the entries a, b, d of the derivative [[a, b], [b, d]] of `_bend`, shape [...]."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y, r2, radial = self._radial(ideal)
        slope = k1 + r2 * (2 * k2 + r2 * 3 * k3)
        a = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        b = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        d = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        return a, b, d


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraView:
    """A lens at a place: everything that maps between table and image.

    Attributes:
        lens: Intrinsics of the camera.
        rotation: Rotation of base-frame vectors into the camera's frame (x along u, y along v, z
            out of the lens), shape [3, 3] as nested tuples.
        position: Centre of the camera in the base frame [m].
    """

    lens: Lens
    rotation: tuple[tuple[float, float, float], ...]
    position: tuple[float, float, float]

    def __post_init__(self):
        R = np.asarray(self.rotation, dtype=float)
        if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6):
            raise InputError("the camera's rotation must be a rotation matrix")
        if np.linalg.det(R) < 0:
            raise InputError("the camera's rotation must not mirror")
        if len(self.position) != 3 or not np.all(np.isfinite(self.position)):
            raise InputError(f"camera position {self.position} must be three finite numbers")

    def to_image(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the pixels u, v [px], shape [..., 2], at which points [m], shape [..., 3], appear.

        They are NaN for points that are not in front of the camera.
        """
        seen = (np.asarray(points, dtype=float) - self.position) @ np.asarray(self.rotation).T
        depth = np.where(seen[..., 2] > 1e-3, seen[..., 2], np.nan)
        return self.lens.distort(seen[..., :2] / depth[..., None])

    def to_table(self, pixels: ArrayLike, z: float = 0.0) -> NDArray[np.float64]:
        """Return the points of a level plane at a height [m] that appear at pixels, shape [..., 2].

        Their x and y [m], shape [..., 2], are NaN where the line of sight does not meet the plane.
        """
        ideal = self.lens.undistort(pixels)
        ray = np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)
        ray = ray @ np.asarray(self.rotation)
        position = np.asarray(self.position)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = (z - position[2]) / ray[..., 2]
        scale = np.where(scale > 0, scale, np.nan)
        return position[:2] + scale[..., None] * ray[..., :2]

    def pixels_per_metre(self, xy: ArrayLike, z: float = 0.0) -> float:
        """Return the scale of the image [px/m] at x, y and a height above the table [m]."""
        x, y = np.asarray(xy, dtype=float)
        step = 0.01
        corners = np.array([[x, y, z], [x + step, y, z], [x, y + step, z]])
        origin, right, away = self.to_image(corners)
        area = np.linalg.det(np.stack([right - origin, away - origin]))
        return float(np.sqrt(abs(area)) / step)

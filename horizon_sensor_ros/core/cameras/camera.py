"""Cameras: raw pixels to unit rays and back, for the three distortion models of
`sensor_msgs/CameraInfo`.

Optical frame: x right, y down, z forward. Pixel centres lie at integers. Points are undistorted,
never images.

Models, with OpenCV's coefficients in OpenCV's order:

* ``plumb_bob``: k1 k2 p1 p2 [k3];
* ``rational_polynomial``: k1 k2 p1 p2 k3 k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]] (thin prism, tilted
sensor);
* ``equidistant`` (OpenCV's fisheye): k1 k2 k3 k4, rays beyond 90 degrees from the axis included.

A distortion polynomial is one-to-one only up to some angle off the axis; farther out it folds the
field back into the frame. Rays and pixels beyond that angle come back as NaN.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.lens.equidistant import EquidistantLens
from horizon_sensor_ros.core.lens.lens import Lens
from horizon_sensor_ros.core.lens.perspective import PerspectiveLens

_MODELS: dict[str, tuple[type[Lens], tuple[int, ...]]] = {
    "plumb_bob": (PerspectiveLens, (0, 4, 5)),
    "rational_polynomial": (PerspectiveLens, (0, 8, 12, 14)),
    "equidistant": (EquidistantLens, (0, 4)),
}


@dataclass(frozen=True)
class Camera:
    """Intrinsics and distortion of one delivered image.

    width, height : of the image, pixels. fx, fy, cx, cy : pixels, centres of pixels at integers.
    model : ``plumb_bob``, ``rational_polynomial`` or ``equidistant``. distortion : its
    coefficients; empty for none.
    Raises ValueError for an unknown model, a wrong number of coefficients, or values no camera can
    have.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    model: str = "plumb_bob"
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (float(self.width).is_integer() and float(self.height).is_integer()):
            raise ValueError(f"image size must be whole pixels, got {self.width} x {self.height}")
        if self.width <= 0 or self.height <= 0:
            raise ValueError(f"image size must be positive, got {self.width} x {self.height}")
        intrinsics = (self.fx, self.fy, self.cx, self.cy)
        if not np.all(np.isfinite(intrinsics)):
            raise ValueError(f"fx, fy, cx, cy must be finite, got {intrinsics}")
        if self.fx <= 0 or self.fy <= 0:
            raise ValueError(
                f"focal lengths must be positive, got fx={self.fx}, fy={self.fy} (0: uncalibrated)"
            )
        if self.model not in _MODELS:
            raise ValueError(
                f"unknown distortion model {reprlib.repr(self.model)}; "
                f"known are {', '.join(_MODELS)}"
            )
        distortion = tuple(float(d) for d in self.distortion)
        sizes = _MODELS[self.model][1]
        if len(distortion) not in sizes:
            wanted = " or ".join(str(size) for size in sizes)
            raise ValueError(
                f"distortion model {self.model} takes {wanted} coefficients, got {len(distortion)}"
            )
        if not np.all(np.isfinite(distortion)):
            raise ValueError(f"distortion coefficients must be finite, got {distortion}")
        object.__setattr__(self, "width", int(self.width))
        object.__setattr__(self, "height", int(self.height))
        for name in ("fx", "fy", "cx", "cy"):
            object.__setattr__(self, name, float(getattr(self, name)))
        object.__setattr__(self, "distortion", distortion)

    @classmethod
    def from_calibration(
        cls,
        width: int,
        height: int,
        k: Sequence[float] | np.ndarray,
        model: str,
        distortion: Sequence[float] | np.ndarray,
        binning_x: int = 0,
        binning_y: int = 0,
        roi: Sequence[int] = (0, 0, 0, 0),
    ) -> Camera:
        """Return the camera of the delivered image, from a calibration as `CameraInfo` carries it.

        width, height, k (9 row by row, or 3x3) : of the full-resolution image.
        roi : x, y, width, height in full-resolution pixels; width = height = 0 means the full
        frame.
        binning_x, binning_y : 0 means 1. Binning averages blocks of full-resolution pixels, so the
        centre of a delivered pixel lies (binning - 1) / 2 full-resolution pixels behind its first
        one: ``c' = (c - roi_offset - (binning - 1) / 2) / binning``, ``f' = f / binning``.
        An empty model name with no coefficients means no distortion.
        Raises ValueError, saying what is wrong, for an uncalibrated (k[0] <= 0), non-finite or
        inconsistent one.
        """
        matrix = _camera_matrix(k)
        coefficients = np.asarray(distortion, dtype=float).ravel()
        if not model and coefficients.size == 0:
            model = "plumb_bob"
        if binning_x < 0 or binning_y < 0:
            raise ValueError(f"binning must not be negative, got {binning_x} x {binning_y}")
        bin_x, bin_y = max(int(binning_x), 1), max(int(binning_y), 1)
        roi_x, roi_y, roi_width, roi_height = _region(roi, width, height)
        return cls(
            width=roi_width // bin_x,
            height=roi_height // bin_y,
            fx=matrix[0, 0] / bin_x,
            fy=matrix[1, 1] / bin_y,
            cx=(matrix[0, 2] - roi_x - (bin_x - 1) / 2) / bin_x,
            cy=(matrix[1, 2] - roi_y - (bin_y - 1) / 2) / bin_y,
            model=model,
            distortion=tuple(coefficients),
        )

    def rays(self, px: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) in the optical frame through raw pixels px (N, 2).

        A row is NaN where the pixel is not finite or lies outside the image of the model's
        one-to-one field.
        """
        px = _rows(px, 2, "px")
        x = (px[:, 0] - self.cx) / self.fx
        y = (px[:, 1] - self.cy) / self.fy
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            return self._lens.rays(x, y)

    def pixels(self, rays: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) of rays (N, 3) in the optical frame; the rays need not be unit vectors.

        A row is NaN where the ray is not finite, points behind the camera (perspective models), or
        lies outside the model's one-to-one field. The pixel need not lie inside the frame; see
        `in_frame`.
        """
        rays = _rows(rays, 3, "rays")
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            x, y = self._lens.places(rays)
            out = np.empty((2, len(rays)))
            np.multiply(x, self.fx, out=out[0])
            np.multiply(y, self.fy, out=out[1])
            out += self._centre_px[:, None]
        return out.T

    def pixel_jacobian(self, rays_unit: np.ndarray) -> np.ndarray:
        """Derivative (N, 2, 3) of the pixel by its ray's components, at unit rays (N, 3).

        The pixel does not depend on the ray's length, so every row is perpendicular to its ray. NaN
        where `pixels` is.
        """
        return self.project(rays_unit)[1]

    def pixel_gradients(self, rays_unit: np.ndarray, along_px: np.ndarray) -> np.ndarray:
        """How fast (N, 3) the pixel moves along vectors (N, 2) with the components of its ray, at
        unit rays (N, 3): `pixel_jacobian` times these.
        """
        rays = _rows(rays_unit, 3, "rays_unit")
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            return self._lens.gradients(rays, along_px * self._focal_px)

    def project(self, rays_unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `pixels` (N, 2) and `pixel_jacobian` (N, 2, 3) of unit rays (N, 3) in one go."""
        rays = _rows(rays_unit, 3, "rays_unit")
        px = np.empty((len(rays), 2))
        jacobian = np.empty((len(rays), 2, 3))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            self._lens.project_into(rays, px, jacobian)
        px *= self._focal_px
        px += self._centre_px
        jacobian *= self._focal_px[:, None]
        return px, jacobian

    def project_along(
        self, rays_unit: np.ndarray, along: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return `pixels` (N, 2) of unit rays (N, 3), and how they move (N, 2) as the rays do along
        vectors (N, 3).
        """
        rays = _rows(rays_unit, 3, "rays_unit")
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            px, moved = self._lens.project_along(rays, along)
            moved *= self._focal_px[:, None]
            px *= self._focal_px[:, None]
            px += self._centre_px[:, None]
        return px.T, moved.T

    def in_frame(self, px: np.ndarray) -> np.ndarray:
        """Whether pixels (N, 2) lie on the image, [-0.5, size - 0.5); (N,) bool, False for NaN."""
        px = _rows(px, 2, "px")
        x, y = px[:, 0], px[:, 1]
        return (x >= -0.5) & (x < self.width - 0.5) & (y >= -0.5) & (y < self.height - 0.5)

    @cached_property
    def pixel_rad(self) -> float:
        """Angle of a pixel in the middle of the image, mean of both directions."""
        return float(1.0 / np.sqrt(self.fx * self.fy))

    def off_axis(self, px: np.ndarray) -> np.ndarray:
        """Places (N, 2) of pixels from the optical axis, over half the frame's diagonal."""
        return np.asarray((px - self._centre_px) * self._per_half_diagonal)

    def cornered(self, px: np.ndarray) -> np.ndarray:
        """Squares (N,) of their distances to it: one in the corners, as a rule."""
        off = self.off_axis(px)
        return np.asarray(np.einsum("ij,ij->i", off, off))

    @cached_property
    def _per_half_diagonal(self) -> float:
        return 2.0 / math.hypot(self.width, self.height)

    def with_focal_scale(self, scale: float) -> Camera:
        """Return the camera with its focal lengths multiplied."""
        return replace(self, fx=self.fx * scale, fy=self.fy * scale)

    @property
    def max_angle_rad(self) -> float:
        """Angle off the axis up to which the model is one-to-one; pi/2 or pi without a limit."""
        return self._lens.max_angle_rad

    @cached_property
    def _lens(self) -> Lens:
        return _MODELS[self.model][0](self.distortion)

    @cached_property
    def _focal_px(self) -> np.ndarray:
        return np.array([self.fx, self.fy])

    @cached_property
    def _centre_px(self) -> np.ndarray:
        return np.array([self.cx, self.cy])


def _camera_matrix(k: np.ndarray | Sequence[float]) -> np.ndarray:
    """K (3, 3) as a pinhole camera has it; ValueError says why it is none."""
    matrix = np.asarray(k, dtype=float)
    if matrix.size != 9:
        raise ValueError(f"camera matrix K must have 9 elements, got {matrix.size}")
    matrix = matrix.reshape(3, 3)
    if not np.all(np.isfinite(matrix)):
        raise ValueError("camera matrix K has non-finite elements")
    if matrix[0, 0] <= 0:
        raise ValueError(f"camera is uncalibrated: K[0] = {matrix[0, 0]:g}")
    shape = (matrix[0, 1], matrix[1, 0], *matrix[2])
    if not np.allclose(shape, (0, 0, 0, 0, 1), rtol=0, atol=1e-12):
        raise ValueError("camera matrix K is not of the form [fx 0 cx; 0 fy cy; 0 0 1]")
    return matrix


def _region(roi: Sequence[int], width: int, height: int) -> tuple[int, int, int, int]:
    """x, y, width, height of a region of interest; ValueError where it is not in the frame."""
    x, y, roi_width, roi_height = (int(value) for value in roi)
    if width <= 0 or height <= 0:
        raise ValueError(f"width and height must be positive, got {width} x {height}")
    if roi_width == 0 and roi_height == 0:
        roi_width, roi_height = int(width), int(height)
    inside = (
        x >= 0
        and y >= 0
        and roi_width > 0
        and roi_height > 0
        and x + roi_width <= width
        and y + roi_height <= height
    )
    if not inside:
        raise ValueError(f"region of interest {tuple(roi)} is not inside {width} x {height}")
    return x, y, roi_width, roi_height


def _rows(values: np.ndarray, columns: int, name: str) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name} must have shape (N, {columns}), got {array.shape}")
    return array

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

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.mask import Mask

_MODEL_SIZES = {
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (0, 8, 12, 14),
    "equidistant": (0, 4),
}
_PERSPECTIVE_SIZE = 14
_TABLE_SIZE = 1024
# A perspective image of the half space is infinite; farther off axis than this no table is needed.
_STEEPEST_RAD = np.radians(89.9)
# Tangents beyond this are as good as infinite.
_FARTHEST = 1e100
_NEWTON_STEPS = 30
_CONVERGED = 1e-13


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
        if int(self.width) != self.width or int(self.height) != self.height:
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
        if self.model not in _MODEL_SIZES:
            raise ValueError(
                f"unknown distortion model {reprlib.repr(self.model)}; "
                f"known are {', '.join(_MODEL_SIZES)}"
            )
        distortion = tuple(float(d) for d in self.distortion)
        sizes = _MODEL_SIZES[self.model]
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
        coefficients = np.asarray(distortion, dtype=float).ravel()
        if not model and coefficients.size == 0:
            model = "plumb_bob"
        if binning_x < 0 or binning_y < 0:
            raise ValueError(f"binning must not be negative, got {binning_x} x {binning_y}")
        bin_x, bin_y = max(int(binning_x), 1), max(int(binning_y), 1)
        roi_x, roi_y, roi_width, roi_height = (int(value) for value in roi)
        if roi_width == 0 and roi_height == 0:
            roi_width, roi_height = int(width), int(height)
        inside = (
            roi_x >= 0
            and roi_y >= 0
            and roi_width > 0
            and roi_height > 0
            and roi_x + roi_width <= width
            and roi_y + roi_height <= height
        )
        if not inside:
            raise ValueError(f"region of interest {tuple(roi)} is not inside {width} x {height}")
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
            if self.model == "equidistant":
                return self._rays_equidistant(x, y)
            if not self._undistorted:
                x, y = self._undistort(x, y)
            out = np.empty((len(x), 3))
            scale = 1.0 / np.sqrt(1.0 + x * x + y * y)
            np.multiply(x, scale, out=out[:, 0])
            np.multiply(y, scale, out=out[:, 1])
            out[:, 2] = scale
        return out

    def pixels(self, rays: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) of rays (N, 3) in the optical frame; the rays need not be unit vectors.

        A row is NaN where the ray is not finite, points behind the camera (perspective models), or
        lies outside the model's one-to-one field. The pixel need not lie inside the frame; see
        `in_frame`.
        """
        rays = _rows(rays, 3, "rays")
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if self.model == "equidistant":
                x, y, _, _ = self._project_equidistant(rays)
            else:
                x, y, _ = self._normalised(rays)
                if not self._undistorted:
                    x, y = self._tilt(*self._distort(x, y)[:2])
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

    def project(self, rays_unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `pixels` (N, 2) and `pixel_jacobian` (N, 2, 3) of unit rays (N, 3) in one go."""
        rays = _rows(rays_unit, 3, "rays_unit")
        px = np.empty((len(rays), 2))
        jacobian = np.empty((len(rays), 2, 3))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if self.model == "equidistant":
                self._project_equidistant_into(rays, px, jacobian)
            else:
                self._project_perspective_into(rays, px, jacobian)
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
        if self.model == "equidistant" or not self._undistorted:
            px, jacobian = self.project(rays_unit)
            return px, np.einsum("nij,nj->ni", jacobian, along)
        rays = _rows(rays_unit, 3, "rays_unit")
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            x, y, inverse_z = self._normalised(rays)
            px = np.stack([x, y])
            moved = along.T[:2] - px * along.T[2]
            moved *= inverse_z
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
        half_diagonal = 0.5 * np.hypot(self.width, self.height)
        return np.asarray((px - (self.cx, self.cy)) / half_diagonal)

    @cached_property
    def max_angle_rad(self) -> float:
        """Angle off the axis up to which the model is one-to-one; pi/2 or pi without a limit."""
        if self.model == "equidistant":
            return self._max_theta
        return float(np.arctan(self._max_radius))

    @cached_property
    def _focal_px(self) -> np.ndarray:
        return np.array([self.fx, self.fy])

    @cached_property
    def _centre_px(self) -> np.ndarray:
        return np.array([self.cx, self.cy])

    # ------------------------------------------------------------------ perspective models

    @cached_property
    def _undistorted(self) -> bool:
        return not any(self.distortion)

    @cached_property
    def _coefficients(self) -> tuple[float, ...]:
        return self.distortion + (0.0,) * (_PERSPECTIVE_SIZE - len(self.distortion))

    @cached_property
    def _tilt_matrix(self) -> np.ndarray | None:
        """Homography of a tilted sensor (OpenCV: calib3d, tilted model); None without tilt."""
        tau_x, tau_y = self._coefficients[12:14]
        if tau_x == 0 and tau_y == 0:
            return None
        rot_x = np.array(
            [[1, 0, 0], [0, np.cos(tau_x), np.sin(tau_x)], [0, -np.sin(tau_x), np.cos(tau_x)]]
        )
        rot_y = np.array(
            [[np.cos(tau_y), 0, -np.sin(tau_y)], [0, 1, 0], [np.sin(tau_y), 0, np.cos(tau_y)]]
        )
        rot = rot_y @ rot_x
        keep = np.array([[rot[2, 2], 0, -rot[0, 2]], [0, rot[2, 2], -rot[1, 2]], [0, 0, 1]])
        return keep @ rot

    @cached_property
    def _max_radius(self) -> float:
        """Largest undistorted radius (tangent of the angle off axis) of the one-to-one field.

        On a disc the map is one-to-one if the symmetric part of its Jacobian is positive definite
        everywhere. For the radial terms that is d(r c)/dr > 0, a polynomial in r^2; with tangential
        and prism terms the disc is cut back to the smallest radius at which the condition fails in
        any direction.
        """
        k1, k2, _, _, k3, k4, k5, k6 = self._coefficients[:8]
        poly = np.polynomial.Polynomial
        top, bottom, s = poly([1, k1, k2, k3]), poly([1, k4, k5, k6]), poly([0, 1])
        slope = top * bottom + 2 * s * (top.deriv() * bottom - top * bottom.deriv())
        radius = np.sqrt(min(_first_positive_root(slope), _first_positive_root(bottom)))
        if not any(self._coefficients[2:4]) and not any(self._coefficients[8:12]):
            return float(radius)
        # The last node stays inside the radial limit, where the slope is positive.
        steepest = min(np.arctan(radius), _STEEPEST_RAD)
        radii = np.tan(np.linspace(0.0, steepest, _TABLE_SIZE)) * (1 - 1e-12)
        azimuth = np.linspace(0.0, 2 * np.pi, 180, endpoint=False)
        bad = np.flatnonzero(self._least_stretch(radii, azimuth) <= 0)
        if bad.size == 0:
            return float(radii[-1])
        low, high = radii[bad[0] - 1], radii[bad[0]]
        for _ in range(50):
            middle = 0.5 * (low + high)
            if self._least_stretch(np.array([middle]), azimuth)[0] > 0:
                low = middle
            else:
                high = middle
        return float(low)

    def _least_stretch(self, radii: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        x = radii[:, None] * np.cos(azimuth)
        y = radii[:, None] * np.sin(azimuth)
        a, b, c, d = self._distortion_jacobian(x, y)
        return np.min(0.5 * (a + d) - np.hypot(0.5 * (a - d), 0.5 * (b + c)), axis=1)

    @cached_property
    def _radius_table(self) -> tuple[np.ndarray, np.ndarray]:
        """Distorted and undistorted radii of the radial terms: the start of the inverse."""
        steepest = min(np.arctan(self._max_radius), _STEEPEST_RAD)
        radius = np.tan(np.linspace(0.0, steepest, _TABLE_SIZE))
        distorted = radius * self._radial(radius * radius)[0]
        # At a pole of the model the last one may lie beyond it.
        rises = np.append(True, np.diff(distorted) > 0.0)
        end = len(radius) if rises.all() else int(np.argmin(rises))
        return distorted[:end], radius[:end]

    def _normalised(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x/z, y/z and 1/z, NaN behind the camera and outside the one-to-one field."""
        x, y, z = rays.T
        inverse_z = 1.0 / np.where(z > 0, z, np.nan)
        limit = _FARTHEST if self._undistorted else min(self._max_radius, _FARTHEST)
        inside = (x * x + y * y) * (inverse_z * inverse_z) <= limit * limit
        if not inside.all():
            inverse_z[~inside] = np.nan
        return x * inverse_z, y * inverse_z, inverse_z

    def _radial(self, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the radial factor, and the denominator where there is one."""
        k1, k2, _, _, k3, k4, k5, k6 = self._coefficients[:8]
        top = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if k4 == 0 and k5 == 0 and k6 == 0:
            return top, None
        bottom = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        return top / bottom, bottom

    def _distort(
        self, x: np.ndarray, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
        """Return distorted x, y before any tilt, and r^2, factor, denominator for the Jacobian."""
        _, _, p1, p2 = self._coefficients[:4]
        s1, s2, s3, s4 = self._coefficients[8:12]
        r2 = x * x + y * y
        factor, bottom = self._radial(r2)
        x_out = x * factor
        y_out = y * factor
        if p1 or p2:
            # 2 p1 x y + p2 (r2 + 2 x x) = x q + p2 r2 with q = 2 (p1 y + p2 x); likewise for y
            q = 2.0 * (p1 * y + p2 * x)
            x_out += x * q + p2 * r2
            y_out += y * q + p1 * r2
        if s1 or s2 or s3 or s4:
            x_out += r2 * (s1 + s2 * r2)
            y_out += r2 * (s3 + s4 * r2)
        return x_out, y_out, r2, factor, bottom

    def _distortion_jacobian(
        self,
        x: np.ndarray,
        y: np.ndarray,
        r2: np.ndarray | None = None,
        factor: np.ndarray | None = None,
        bottom: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return dx'/dx, dx'/dy, dy'/dx, dy'/dy of `_distort`."""
        k1, k2, p1, p2, k3, k4, k5, k6 = self._coefficients[:8]
        s1, s2, s3, s4 = self._coefficients[8:12]
        if r2 is None or factor is None:
            r2 = x * x + y * y
            factor, bottom = self._radial(r2)
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))
        if bottom is not None:
            slope = (slope - 2.0 * factor * (k4 + r2 * (2.0 * k5 + 3.0 * k6 * r2))) / bottom
        x_slope = x * slope
        a = factor + x * x_slope
        b = y * x_slope
        d = factor + y * y * slope
        if p1 or p2:
            p1y, p2x = p1 * y, p2 * x
            a += 2.0 * p1y + 6.0 * p2x
            b += 2.0 * (p1 * x + p2 * y)
            d += 6.0 * p1y + 2.0 * p2x
        if not (s1 or s2 or s3 or s4):
            return a, b, b, d
        prism_x = 2.0 * s1 + 4.0 * s2 * r2
        prism_y = 2.0 * s3 + 4.0 * s4 * r2
        return a + x * prism_x, b + y * prism_x, b + x * prism_y, d + y * prism_y

    def _tilt(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        m = self._tilt_matrix
        return (x, y) if m is None else _mapped(m, x, y)

    def _untilt(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        m = self._tilt_matrix
        return (x, y) if m is None else _mapped(np.linalg.inv(m), x, y)

    def _undistort(self, x_raw: np.ndarray, y_raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse of `_distort` and `_tilt`, by Newton's method from the radial table; else NaN."""
        x_raw, y_raw = self._untilt(x_raw, y_raw)
        distorted, radius = self._radius_table
        r_raw = np.hypot(x_raw, y_raw)
        scale = np.interp(r_raw, distorted, radius) / np.maximum(r_raw, 1e-300)
        x = x_raw * scale
        y = y_raw * scale
        # The common case, all points at once; the few that need more are then treated alone.
        for _ in range(2):
            x, y, change = self._newton_step(x, y, x_raw, y_raw)
        todo = np.flatnonzero(~(change <= _CONVERGED))
        for _ in range(_NEWTON_STEPS):
            if todo.size == 0:
                return x, y
            x[todo], y[todo], change = self._newton_step(x[todo], y[todo], x_raw[todo], y_raw[todo])
            todo = todo[~(change <= _CONVERGED)]
        x[todo] = np.nan
        y[todo] = np.nan
        return x, y

    def _newton_step(
        self, x: np.ndarray, y: np.ndarray, x_raw: np.ndarray, y_raw: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One step inside the one-to-one field, and its relative size squared (inf where cut)."""
        x_now, y_now, r2, factor, bottom = self._distort(x, y)
        a, b, c, d = self._distortion_jacobian(x, y, r2, factor, bottom)
        x_now -= x_raw
        y_now -= y_raw
        inverse = 1.0 / (a * d - b * c)
        x_step = (d * x_now - b * y_now) * inverse
        y_step = (a * y_now - c * x_now) * inverse
        change = (x_step * x_step + y_step * y_step) / (1.0 + r2)
        x = x - x_step
        y = y - y_step
        if np.isfinite(self._max_radius):
            cut = self._max_radius / np.sqrt(x * x + y * y)
            outside = cut < 1.0
            if outside.any():
                x[outside] *= cut[outside]
                y[outside] *= cut[outside]
                change[outside] = np.inf
        return x, y, change

    def _project_perspective_into(
        self, rays: np.ndarray, px: np.ndarray, jacobian: np.ndarray
    ) -> None:
        x, y, inverse_z = self._normalised(rays)
        if self._undistorted:
            px[:, 0], px[:, 1] = x, y
            jacobian[:, 0, 0] = jacobian[:, 1, 1] = inverse_z
            jacobian[:, 0, 1] = jacobian[:, 1, 0] = 0.0 * inverse_z
            jacobian[:, :, 2] = px * -inverse_z[:, None]
            return
        x_raw, y_raw, r2, factor, bottom = self._distort(x, y)
        a, b, c, d = self._distortion_jacobian(x, y, r2, factor, bottom)
        if self._tilt_matrix is not None:
            m = self._tilt_matrix
            w = m[2, 0] * x_raw + m[2, 1] * y_raw + m[2, 2]
            x_raw, y_raw = self._tilt(x_raw, y_raw)
            t00, t01 = (m[0, 0] - x_raw * m[2, 0]) / w, (m[0, 1] - x_raw * m[2, 1]) / w
            t10, t11 = (m[1, 0] - y_raw * m[2, 0]) / w, (m[1, 1] - y_raw * m[2, 1]) / w
            a, b, c, d = t00 * a + t01 * c, t00 * b + t01 * d, t10 * a + t11 * c, t10 * b + t11 * d
        px[:, 0], px[:, 1] = x_raw, y_raw
        jacobian[:, 0, 0] = a * inverse_z
        jacobian[:, 0, 1] = b * inverse_z
        jacobian[:, 1, 0] = c * inverse_z
        jacobian[:, 1, 1] = d * inverse_z
        jacobian[:, 0, 2] = -(a * x + b * y) * inverse_z
        jacobian[:, 1, 2] = -(c * x + d * y) * inverse_z

    # ------------------------------------------------------------------ equidistant model

    @cached_property
    def _max_theta(self) -> float:
        if self._undistorted:
            return float(np.pi)
        k1, k2, k3, k4 = self.distortion
        slope = np.polynomial.Polynomial([1, 3 * k1, 5 * k2, 7 * k3, 9 * k4])
        return float(min(np.sqrt(_first_positive_root(slope)), np.pi))

    @cached_property
    def _theta_table(self) -> tuple[np.ndarray, np.ndarray]:
        theta = np.linspace(0.0, self._max_theta, _TABLE_SIZE)
        return self._theta_distorted(theta)[0], theta

    def _theta_distorted(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distorted angle and its derivative."""
        if self._undistorted:
            return theta, np.ones_like(theta)
        k1, k2, k3, k4 = self.distortion
        t2 = theta * theta
        value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        slope = 1.0 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        return value, slope

    def _project_equidistant(
        self, rays: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return x, y on the image plane, the factor x / X and the slope of the distorted angle."""
        radius = np.hypot(rays[:, 0], rays[:, 1])
        theta = np.arctan2(radius, rays[:, 2])
        # Straight behind the camera the direction in the image is undefined.
        theta[~((theta <= self._max_theta) & (theta < np.pi))] = np.nan
        distorted, slope = self._theta_distorted(theta)
        on_axis = radius < 1e-150
        factor = distorted / np.where(on_axis, 1.0, radius)
        if on_axis.any():
            factor[on_axis] = np.where(rays[on_axis, 2] > 0, 1.0 / rays[on_axis, 2], np.nan)
        return rays[:, 0] * factor, rays[:, 1] * factor, factor, slope

    def _project_equidistant_into(
        self, rays: np.ndarray, px: np.ndarray, jacobian: np.ndarray
    ) -> None:
        x, y, factor, slope = self._project_equidistant(rays)
        px[:, 0], px[:, 1] = x, y
        r2 = rays[:, 0] * rays[:, 0] + rays[:, 1] * rays[:, 1]
        length2 = r2 + rays[:, 2] * rays[:, 2]
        radial = slope / length2
        # Derivative of `factor` along the radius, over the radius; its limit on the axis meets X^2
        # = 0.
        bend = (radial * rays[:, 2] - factor) / np.where(r2 > 1e-24, r2, np.inf)
        jacobian[:, 0, 0] = factor + rays[:, 0] * rays[:, 0] * bend
        jacobian[:, 1, 1] = factor + rays[:, 1] * rays[:, 1] * bend
        jacobian[:, 0, 1] = jacobian[:, 1, 0] = rays[:, 0] * rays[:, 1] * bend
        jacobian[:, 0, 2] = -rays[:, 0] * radial
        jacobian[:, 1, 2] = -rays[:, 1] * radial

    def _rays_equidistant(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        distorted = np.hypot(x, y)
        if self._undistorted:
            theta = distorted.copy()
        else:
            table, nodes = self._theta_table
            theta = np.interp(distorted, table, nodes)
            change = np.inf
            for _ in range(_NEWTON_STEPS):
                value, slope = self._theta_distorted(theta)
                step = (value - distorted) / slope
                theta = np.clip(theta - step, 0.0, self._max_theta)
                change = np.nanmax(np.abs(step), initial=0.0, where=distorted <= table[-1])
                if change <= 1e-7:
                    break
            theta[distorted > table[-1]] = np.nan
        theta[~(theta < np.pi)] = np.nan
        out = np.empty((len(x), 3))
        factor = np.sin(theta) / np.where(distorted > 0, distorted, 1.0)
        np.multiply(x, factor, out=out[:, 0])
        np.multiply(y, factor, out=out[:, 1])
        np.cos(theta, out=out[:, 2])
        return out


@dataclass(frozen=True, eq=False)
class CameraView:
    """A camera in its place: name, camera, and the rotation that takes optical-frame vectors to the
    base frame.

    mask : what of its image may be used; None: all.
    Raises ValueError when rot_base_from_cam is not a rotation matrix (orthonormal to 1e-6,
    determinant +1), or the mask has another size than the camera.
    """

    name: str
    camera: Camera
    rot_base_from_cam: np.ndarray
    mask: Mask | None = None

    def __post_init__(self) -> None:
        rot = np.array(self.rot_base_from_cam, dtype=float)
        if rot.shape != (3, 3) or not np.all(np.isfinite(rot)):
            raise ValueError(f"rot_base_from_cam of {self.name!r} must be a finite 3 x 3 matrix")
        if np.abs(rot @ rot.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rot) < 0:
            raise ValueError(f"rot_base_from_cam of {self.name!r} is not a rotation matrix")
        rot.setflags(write=False)
        object.__setattr__(self, "rot_base_from_cam", rot)
        if self.mask is not None and self.mask.shape != (self.camera.height, self.camera.width):
            height, width = self.mask.shape
            raise ValueError(
                f"mask of {self.name!r} is {width} x {height}, "
                f"the camera {self.camera.width} x {self.camera.height}"
            )


def _mapped(homography: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points under a homography (3, 3); NaN where it maps them behind the camera."""
    m = homography
    w = m[2, 0] * x + m[2, 1] * y + m[2, 2]
    scale = 1.0 / np.where(w > 0, w, np.nan)
    return (
        (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * scale,
        (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * scale,
    )


def _rows(values: np.ndarray, columns: int, name: str) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name} must have shape (N, {columns}), got {array.shape}")
    return array


def _first_positive_root(polynomial: np.polynomial.Polynomial) -> float:
    """Smallest positive real root of a polynomial whose constant term is 1; inf without one."""
    # Solved for the reciprocal, whose leading coefficient is that 1, however small the last is.
    inverse = np.polynomial.polynomial.polyroots(polynomial.coef[::-1])
    real = inverse.real[np.abs(inverse.imag) <= 1e-7 * np.abs(inverse)]
    largest = float(real.max(initial=0.0))
    return 1.0 / largest if largest > 1e-12 else np.inf

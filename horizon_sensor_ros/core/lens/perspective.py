"""Perspective lenses: `plumb_bob` and `rational_polynomial`, with OpenCV's radial, tangential and
thin-prism terms and tilted sensor.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.lens.lens import Lens
from horizon_sensor_ros.core.lens.one_to_one import first_positive_root

_SIZE = 14
_TABLE_SIZE = 1024
# A perspective image of the half space is infinite; farther off axis than this no table is needed.
_STEEPEST_RAD = np.radians(89.9)
# Tangents beyond this are as good as infinite.
_FARTHEST = 1e100
_GRAZING = 1e-90  # unit rays with more than that along the axis have tangents below it
_NEWTON_STEPS = 30
_CONVERGED = 1e-13
_MOST_OFF = 1e-6  # of a point that is found, from where it should be, over its radius and one


class PerspectiveLens(Lens):
    """Up to 14 coefficients, k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y; those left out are 0.

    Nothing behind the camera has an image.
    """

    @cached_property
    def max_angle_rad(self) -> float:
        """Angle off the axis up to which the model is one-to-one; pi/2 without a limit."""
        return float(np.arctan(self._max_radius))

    def rays(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """As `Lens.rays`."""
        if not self.undistorted:
            x, y = self._undistort(x, y)
        out = np.empty((len(x), 3))
        scale = 1.0 / np.sqrt(1.0 + x * x + y * y)
        np.multiply(x, scale, out=out[:, 0])
        np.multiply(y, scale, out=out[:, 1])
        out[:, 2] = scale
        return out

    def places(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `Lens.places`."""
        x, y, _ = self._normalised(rays)
        return (x, y) if self.undistorted else self._tilt(*self._distort(x, y)[:2])

    def project_into(self, rays: np.ndarray, places: np.ndarray, jacobian: np.ndarray) -> None:
        """As `Lens.project_into`."""
        if self.undistorted:
            found, inverse_z = self._undistorted_places(rays)
            places.T[:] = found
            jacobian[:, 0, 0] = jacobian[:, 1, 1] = inverse_z
            jacobian[:, 0, 1] = jacobian[:, 1, 0] = 0.0 * inverse_z
            jacobian[:, :, 2] = places * -inverse_z[:, None]
            return
        x, y, inverse_z = self._normalised(rays)
        x_raw, y_raw, r2, factor, bottom = self._distort(x, y)
        a, b, c, d = self._distortion_jacobian(x, y, r2, factor, bottom)
        if self._tilt_matrix is not None:
            m = self._tilt_matrix
            w = m[2, 0] * x_raw + m[2, 1] * y_raw + m[2, 2]
            x_raw, y_raw = self._tilt(x_raw, y_raw)
            t00, t01 = (m[0, 0] - x_raw * m[2, 0]) / w, (m[0, 1] - x_raw * m[2, 1]) / w
            t10, t11 = (m[1, 0] - y_raw * m[2, 0]) / w, (m[1, 1] - y_raw * m[2, 1]) / w
            a, b, c, d = t00 * a + t01 * c, t00 * b + t01 * d, t10 * a + t11 * c, t10 * b + t11 * d
        places[:, 0], places[:, 1] = x_raw, y_raw
        jacobian[:, 0, 0] = a * inverse_z
        jacobian[:, 0, 1] = b * inverse_z
        jacobian[:, 1, 0] = c * inverse_z
        jacobian[:, 1, 1] = d * inverse_z
        jacobian[:, 0, 2] = -(a * x + b * y) * inverse_z
        jacobian[:, 1, 2] = -(c * x + d * y) * inverse_z

    def project_along(self, rays: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `Lens.project_along`."""
        if not self.undistorted:
            return super().project_along(rays, along)
        places, inverse_z = self._undistorted_places(rays)
        moved = along.T[:2] - places * along.T[2]
        moved *= inverse_z
        return places, moved

    def gradients(self, rays: np.ndarray, along: np.ndarray) -> np.ndarray:
        """As `Lens.gradients`."""
        if not self.undistorted:
            return super().gradients(rays, along)
        places, inverse_z = self._undistorted_places(rays)
        out = np.empty((3, len(rays)))
        np.multiply(along.T, inverse_z, out=out[:2])
        places *= out[:2]
        np.add(places[0], places[1], out=out[2])
        np.negative(out[2], out=out[2])
        return out.T

    def _undistorted_places(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (2, N) of unit rays (N, 3), without distortion, and 1/z."""
        z = rays.T[2]
        if z.min(initial=1.0) > _GRAZING:
            inverse_z = 1.0 / z
            return rays.T[:2] * inverse_z, inverse_z
        x, y, inverse_z = self._normalised(rays)
        return np.stack([x, y]), inverse_z

    @cached_property
    def _coefficients(self) -> tuple[float, ...]:
        return self.distortion + (0.0,) * (_SIZE - len(self.distortion))

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
        radius = np.sqrt(min(first_positive_root(slope), first_positive_root(bottom)))
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
        limit = _FARTHEST if self.undistorted else min(self._max_radius, _FARTHEST)
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
                break
            x[todo], y[todo], change = self._newton_step(x[todo], y[todo], x_raw[todo], y_raw[todo])
            todo = todo[~(change <= _CONVERGED)]
        x[todo] = np.nan
        y[todo] = np.nan
        if any(self._coefficients[5:8]):
            # Steps are small beside a pole too, wherever it leads.
            x_now, y_now = self._distort(x, y)[:2]
            off = ~(np.hypot(x_now - x_raw, y_now - y_raw) < _MOST_OFF * (1.0 + r_raw))
            x[off] = y[off] = np.nan
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


def _mapped(homography: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points under a homography (3, 3); NaN where it maps them behind the camera."""
    m = homography
    w = m[2, 0] * x + m[2, 1] * y + m[2, 2]
    scale = 1.0 / np.where(w > 0, w, np.nan)
    return (
        (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * scale,
        (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * scale,
    )

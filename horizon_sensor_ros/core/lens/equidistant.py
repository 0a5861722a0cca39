"""Fisheye lenses: `equidistant`, OpenCV's fisheye, rays beyond 90 degrees off the axis included."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.lens.lens import Lens
from horizon_sensor_ros.core.lens.one_to_one import first_positive_root

_TABLE_SIZE = 1024
_NEWTON_STEPS = 30


class EquidistantLens(Lens):
    """Coefficients k1 k2 k3 k4, or none: a ray theta off the axis has its place at a distance of
    theta (1 + k1 theta^2 + k2 theta^4 ...) from the centre.
    """

    @cached_property
    def max_angle_rad(self) -> float:
        """Angle off the axis up to which the model is one-to-one; pi without a limit."""
        if self.undistorted:
            return float(np.pi)
        k1, k2, k3, k4 = self.distortion
        slope = np.polynomial.Polynomial([1, 3 * k1, 5 * k2, 7 * k3, 9 * k4])
        return float(min(np.sqrt(first_positive_root(slope)), np.pi))

    def rays(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """As `Lens.rays`."""
        distorted = np.hypot(x, y)
        if self.undistorted:
            theta = distorted.copy()
        else:
            table, nodes = self._theta_table
            theta = np.interp(distorted, table, nodes)
            change = np.inf
            for _ in range(_NEWTON_STEPS):
                value, slope = self._theta_distorted(theta)
                step = (value - distorted) / slope
                theta = np.clip(theta - step, 0.0, self.max_angle_rad)
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

    def places(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `Lens.places`."""
        x, y, _, _ = self._project(rays)
        return x, y

    def project_into(self, rays: np.ndarray, places: np.ndarray, jacobian: np.ndarray) -> None:
        """As `Lens.project_into`."""
        x, y, factor, slope = self._project(rays)
        places[:, 0], places[:, 1] = x, y
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

    @cached_property
    def _theta_table(self) -> tuple[np.ndarray, np.ndarray]:
        theta = np.linspace(0.0, self.max_angle_rad, _TABLE_SIZE)
        return self._theta_distorted(theta)[0], theta

    def _theta_distorted(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distorted angle and its derivative."""
        if self.undistorted:
            return theta, np.ones_like(theta)
        k1, k2, k3, k4 = self.distortion
        t2 = theta * theta
        value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        slope = 1.0 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        return value, slope

    def _project(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return x, y on the image plane, the factor x / X and the slope of the distorted angle."""
        radius = np.hypot(rays[:, 0], rays[:, 1])
        theta = np.arctan2(radius, rays[:, 2])
        # Straight behind the camera the direction in the image is undefined.
        theta[~((theta <= self.max_angle_rad) & (theta < np.pi) & (radius < np.inf))] = np.nan
        distorted, slope = self._theta_distorted(theta)
        on_axis = radius < 1e-150
        factor = distorted / np.where(on_axis, 1.0, radius)
        if on_axis.any():
            factor[on_axis] = np.where(rays[on_axis, 2] > 0, 1.0 / rays[on_axis, 2], np.nan)
        return rays[:, 0] * factor, rays[:, 1] * factor, factor, slope

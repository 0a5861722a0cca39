"""A camera whose rays are stretched: to it an ellipsoid is a sphere."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.derived_camera import DerivedCamera, intrinsics


@dataclass(frozen=True, eq=False)
class StretchedCamera(DerivedCamera):
    """A camera with another one's pixels, and rays ``stretch @ u`` where that one has u, made unit
    vectors.

    stretch : (3, 3), symmetric, and its inverse, in the optical frame.
    """

    stretch: np.ndarray = field(kw_only=True)
    inverse: np.ndarray = field(kw_only=True)

    def rays(self, px: np.ndarray) -> np.ndarray:
        """Stretched unit rays (N, 3); see `Camera.rays`."""
        return _unit(self.original.rays(px) @ self.stretch)

    def pixels(self, rays: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) of stretched rays; see `Camera.pixels`."""
        return self.original.pixels(np.asarray(rays, dtype=float) @ self.inverse)

    def project(self, rays_unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels and their derivative by the stretched rays; see `Camera.project`."""
        # The original's derivative is that by whatever ray it is given, of unit length or not.
        px, jacobian = self.original.project(np.asarray(rays_unit, dtype=float) @ self.inverse)
        return px, (jacobian.reshape(-1, 3) @ self.inverse).reshape(-1, 2, 3)

    def project_along(
        self, rays_unit: np.ndarray, along: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pixels, and how they move with the stretched rays; see `Camera.project_along`."""
        rays = np.asarray(rays_unit, dtype=float) @ self.inverse
        return self.original.project_along(rays, along @ self.inverse)


def stretched_view(view: CameraView, stretch_base: np.ndarray) -> CameraView:
    """Return a view with rays ``stretch_base @ u``; stretch_base : (3, 3), symmetric."""
    rot = view.rot_base_from_cam
    camera = StretchedCamera(
        **intrinsics(view.camera),
        stretch=rot.T @ stretch_base @ rot,
        inverse=rot.T @ np.linalg.inv(stretch_base) @ rot,
    )
    return replace(view, camera=camera)


def _unit(rays: np.ndarray) -> np.ndarray:
    # Calibrations that make no sense have rays without end: NaN.
    with np.errstate(invalid="ignore"):
        return rays / np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]

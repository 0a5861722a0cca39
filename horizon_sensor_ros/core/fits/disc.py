"""The planet's disc in the frames, as a fit has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis


class FittedFigure(Protocol):
    """What a disc asks of the planet's figure, which is fitted as a sphere."""

    @property
    def shortfall(self) -> str:
        """Why it is not the planet's own figure; empty when it is."""

    def view(self, view: CameraView) -> CameraView:
        """Return a camera as it would see the sphere."""


@dataclass(frozen=True, eq=False)
class Disc:
    """The planet's disc as it was fitted: a cone ``u . nadir = cos rho`` of a figure's rays."""

    figure: FittedFigure
    nadir: np.ndarray
    rho_rad: float

    def limb_px(self, view: CameraView, count: int) -> np.ndarray:
        """Pixels (count, 2) once round the disc's edge; NaN where the camera has none."""
        angle = np.linspace(0.0, 2 * np.pi, count)
        across = tangent_basis(self.nadir) @ np.array([np.cos(angle), np.sin(angle)])
        rays = np.cos(self.rho_rad) * self.nadir + np.sin(self.rho_rad) * across.T
        seen = self.figure.view(view)
        return seen.camera.pixels(rays @ seen.rot_base_from_cam)

    def residuals_px(self, view: CameraView, limb: LimbPoints) -> np.ndarray:
        """Distances (N,) of one camera's usable limb points from the disc's edge, along their
        normals.
        """
        rays = LimbObservation(self.figure.view(view), limb).rays
        return rays.residuals_px(self.nadir, self.rho_rad)

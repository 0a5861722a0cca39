"""One cloud made ready for registration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import LEAST_POINTS, RegistrationConfig
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage, range_image
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView, surface_view


@dataclass(frozen=True, eq=False)
class TargetView:
    """A cloud made ready for registration; ``surface`` is None where ``status`` is not OK."""

    status: Status
    reason: str
    image: RangeImage
    surface: SurfaceView | None


def target_view(points: np.ndarray, config: RegistrationConfig | None = None) -> TargetView:
    """Prepare a cloud, (H, W, 3) organised or (N, 3) plain, metres; bad data comes back as a
    status."""
    config = RegistrationConfig() if config is None else config
    image = range_image(points, config.focal_px, config.min_points)
    if image.status is not Status.OK:
        return TargetView(image.status, image.reason, image, None)
    surface = surface_view(image, config.range_noise_m)
    needed = max(config.min_points // 4, LEAST_POINTS)
    if len(surface.surfels.points) < needed:
        reason = f"{len(surface.surfels.points)} surface elements, {needed} needed"
        return TargetView(Status.TOO_FEW_POINTS, reason, image, None)
    return TargetView(Status.OK, "", image, surface)

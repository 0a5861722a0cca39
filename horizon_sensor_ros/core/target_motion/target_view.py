"""One cloud made ready for registration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import LEAST_POINTS, RegistrationConfig
from horizon_sensor_ros.core.target_motion.ranges.cropped import with_cropped
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage, range_image
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView, surface_view

# Views of which one's pixels are so many times as wide on the target as the other's show different
# things: what is smaller than the wider ones these smear.
_OTHER_SCALE = 2.0
# Noise of a real sensor over a pixel's width on the target, at least: of good ones it is a tenth.
_LEAST_NOISE = 0.01


@dataclass(frozen=True, eq=False)
class TargetView:
    """A cloud made ready for registration; ``surface`` is None where ``status`` is not OK."""

    status: Status
    reason: str
    image: RangeImage
    surface: SurfaceView | None

    @property
    def has_noise(self) -> bool:
        """Whether ranges have noise, as a sensor's do and a drawn target's need not."""
        assert self.surface is not None
        return self.surface.sigma_m > _LEAST_NOISE * self.surface.footprint_m

    def as_fine_as(self, other: TargetView) -> bool:
        """Whether both views are about as fine on the target."""
        assert self.surface is not None
        assert other.surface is not None
        finer, wider = sorted((self.surface.footprint_m, other.surface.footprint_m))
        return wider < _OTHER_SCALE * finer


def target_view(
    points: np.ndarray,
    config: RegistrationConfig | None = None,
    cropped: np.ndarray | None = None,
) -> TargetView:
    """Prepare a cloud, (H, W, 3) organised or (N, 3) plain, metres; bad data comes back as a
    status. cropped : (M, 3) returns that were taken out of it.
    """
    config = RegistrationConfig() if config is None else config
    image = range_image(points, config.focal_px, config.min_points)
    if cropped is not None:
        image = with_cropped(image, cropped)
    return view_of_image(image, config)


def view_of_image(image: RangeImage, config: RegistrationConfig) -> TargetView:
    """Prepare a cloud of which the image was made."""
    if image.status is not Status.OK:
        return TargetView(image.status, image.reason, image, None)
    surface = surface_view(image, config.range_noise_m)
    needed = max(config.min_points // 4, LEAST_POINTS)
    if len(surface.surfels.points) < needed:
        reason = f"{len(surface.surfels.points)} surface elements, {needed} needed"
        return TargetView(Status.TOO_FEW_POINTS, reason, image, None)
    return TargetView(Status.OK, "", image, surface)

"""What goes into a horizon fit: the limb points of each camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.limb_rays import LimbRays, no_rays, rays_of
from horizon_sensor_ros.core.limb_points import LimbPoints


@dataclass(frozen=True)
class LimbObservation:
    """The limb points that one camera saw."""

    view: CameraView
    limb: LimbPoints

    @cached_property
    def rays(self) -> LimbRays:
        """The usable points in the base frame."""
        return rays_of(self.view, self.limb)


def gather(observations: Sequence[LimbObservation]) -> LimbRays:
    """Bring the limb points of all cameras into the base frame; empty ones contribute nothing."""
    if len(observations) == 1:
        return observations[0].rays
    seen = [observation.rays for observation in observations]
    num_points = sum(part.num_points for part in seen)
    parts = [part for part in seen if len(part)]
    if not parts:
        return no_rays(num_points)
    return LimbRays(
        np.concatenate([part.rays_base for part in parts]),
        np.concatenate([part.outward_base for part in parts]),
        np.concatenate([part.sigma_px for part in parts]),
        np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
        tuple(name for part in parts for name in part.cameras),
        num_points,
        all(part.ordered for part in parts),
    )

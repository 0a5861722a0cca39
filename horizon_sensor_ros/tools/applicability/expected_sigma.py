"""The sigma to be expected of a fix: how it is sampled, and up to which it is of use."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.bound import horizon_information
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.planet import Planet

# A sigma above this is refused by the nodes, unless they are told otherwise.
USABLE_DEG = float(np.degrees(HorizonConfig.max_nadir_sigma_rad))
_SAMPLES = 1440  # of the limb, fewer than for a single attitude: here there are thousands


def information_of(
    view: CameraView, planet: Planet, nadir_base: np.ndarray, altitude_m: float, sigma_px: float
) -> np.ndarray:
    """Return what one camera's frame tells, (3, 3); arguments and errors as of
    `horizon_information`.
    """
    return horizon_information(view, planet, nadir_base, altitude_m, sigma_px, _SAMPLES)

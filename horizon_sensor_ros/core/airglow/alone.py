"""Nadir and altitude by the night's airglow alone, where no limb of the ground's shows below it.

The layer's upper edge is the limb of a sphere some 97 km higher. How high it really is makes the
altitude uncertain by as much; nadir it tells as it does beside the ground's limb.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.airglow.edge import (
    AIRGLOW_HEIGHT_M,
    airglow_edge,
    sphere_of_airglow,
)
from horizon_sensor_ros.core.airglow.nadir import cone_of_airglow, under_stars
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.calibration_error import with_calibration_error
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.search.stars import NIGHT_STARS
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import Figure

# Without the ground nothing else says that it is a layer. In 40 photographs from the ISS in which
# it is .85 and more of it lay on the cone, and bent by .8 at most; beside twilight and structure
# .78 and .63, and 1.6.
_LEAST_SHARE, _MOST_BEND = 0.82, 1.0
_PASSES = 2  # around the search's cone, and around what was found
# How high the edge lies, besides what `airglow_edge` claims of one camera's: the layer rises and
# sinks by some kilometres with the hour and the season.
_HEIGHT_SIGMA_M = 4e3


@dataclass(frozen=True, eq=False)
class AirglowAlone:
    """The airglow's edge in simultaneous frames: its cone, whose altitude is above the layer, with
    all that may be wrong with it, and the edges that lie on it, one per frame.
    """

    edge: HorizonFit
    observations: tuple[LimbObservation, ...]

    def above_ground(self, sphere: Planet) -> HorizonFit:
        """Estimate with the altitude above the ground."""
        altitude_m = self.edge.altitude_m + AIRGLOW_HEIGHT_M
        rho_rad = sphere.rho_from_altitude(altitude_m)
        return replace(self.edge, altitude_m=altitude_m, rho_rad=rho_rad)


def by_airglow_alone(
    frames: Sequence[tuple[np.ndarray, CameraView]],
    working: Sequence[WorkingImage],
    cone: tuple[np.ndarray, float],
    figure: Figure,
    *,
    mounting_sigma_rad: float,
    lens_sigma_px: float,
) -> AirglowAlone | None:
    """Find the airglow's edge; None where it is not as even as airglow is in nearly all of what is
    seen, or no stars are above it.

    frames : image (H, W), and its camera, stretched as the figure has it. working : working
    images of them. cone : nadir (3,) and rho of where the ground's limb would be below the layer.
    mounting_sigma_rad, lens_sigma_px : as in `HorizonConfig`.
    """
    sphere = figure.sphere
    layer = sphere_of_airglow(sphere)
    for _ in range(_PASSES):
        seen = [
            LimbObservation(view, airglow_edge(gray, view, *cone, sphere)) for gray, view in frames
        ]
        found = cone_of_airglow(seen, layer, _LEAST_SHARE, _MOST_BEND)
        if found is None:
            return None
        edge, observations = found
        cone = edge.nadir_base, sphere.rho_from_altitude(edge.altitude_m + AIRGLOW_HEIGHT_M)
    views = [view for _, view in frames]
    if not under_stars(views, working, edge, NIGHT_STARS):
        return None
    cov = edge.cov_nadir_altitude + figure.covariance(edge, observations)
    edge = with_calibration_error(
        replace(edge, cov_nadir_altitude=cov),
        observations,
        layer,
        mounting_sigma_rad=mounting_sigma_rad,
        lens_sigma_px=lens_sigma_px,
        limb_height_sigma_m=_HEIGHT_SIGMA_M,
    )
    return AirglowAlone(edge, observations)

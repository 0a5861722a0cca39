"""How good each camera alone, and all together, would be at an attitude: share and sigma."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.applicability.visibility import horizon_in_view
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.bound import nadir_sigma_bound_rad
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.tools.applicability.expected_sigma import information_of

ALL = "all cameras"


@dataclass(frozen=True, eq=False)
class Quality:
    """One entry an attitude (M,).

    share : of the horizon's azimuth that is in the frame, 0 to 1; of all cameras together, the sum,
    in which what two of them see counts twice. sigma_rad : expected one sigma of nadir in its least
    certain direction; infinite where the frames leave it open.
    """

    share: np.ndarray
    sigma_rad: np.ndarray


def quality_maps(
    views: Sequence[CameraView],
    rays_down: np.ndarray,
    attitudes: np.ndarray,
    planet: Planet,
    altitude_m: float,
    sigma_px: float,
) -> dict[str, Quality]:
    """Quality by camera, and of `ALL` where there is more than one.

    rays_down, attitudes : as of `horizon_in_view`. sigma_px : error of a limb point, one a pixel.
    Raises ValueError as `information_of` does.
    """
    shares = [horizon_in_view(view, rays_down, attitudes).fraction for view in views]
    informations = np.zeros((len(views), len(attitudes), 3, 3))
    bar = tqdm(total=len(attitudes), desc="sigma", unit="attitude", leave=False)
    for i, attitude in enumerate(attitudes):
        for k, view in enumerate(views):
            if shares[k][i] > 0:
                informations[k, i] = information_of(
                    view, planet, attitude[:, 2], altitude_m, sigma_px
                )
        bar.update()
    bar.close()
    found = {
        view.name: Quality(shares[k], _sigmas(informations[k])) for k, view in enumerate(views)
    }
    if len(views) > 1:
        found[ALL] = Quality(np.sum(shares, axis=0), _sigmas(informations.sum(axis=0)))
    return found


def _sigmas(informations: np.ndarray) -> np.ndarray:
    return np.array([nadir_sigma_bound_rad(information) for information in informations])

"""All that may be wrong with a fit, in its covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.covariance.calibration_error import with_calibration_error
from horizon_sensor_ros.core.covariance.common_cone import nearest_to_cones
from horizon_sensor_ros.core.covariance.hidden_air import hidden_air_sigma_m
from horizon_sensor_ros.core.covariance.shared_error import covariance_with_shared
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import Figure


def with_errors(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    figure: Figure,
    config: HorizonConfig,
) -> HorizonFit:
    """Return the fit with all that may be wrong with observations in its covariance; moved to the
    cone that is nearest to all cameras' cones, where each has one.
    """
    nearest = nearest_to_cones(fit, observations, figure.sphere)
    # What points of the cones share is in the covariance of these already.
    if nearest is None:
        cov = covariance_with_shared(fit, observations, figure.sphere)
    else:
        fit, cov = nearest, nearest.cov_nadir_altitude
    cov = cov + figure.covariance(fit, observations)
    fit = replace(fit, cov_nadir_altitude=cov)
    return _with_configured(fit, observations, figure.sphere, config)


def common_covariance(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    figure: Figure,
    config: HorizonConfig,
) -> np.ndarray:
    """Covariance (4, 4) of what is wrong alike with whatever the cameras of a fit see: with these,
    and with the planet's figure.
    """
    exact = replace(fit, cov_nadir_altitude=np.zeros((4, 4)))
    configured = _with_configured(exact, observations, figure.sphere, config)
    return configured.cov_nadir_altitude + figure.covariance(fit, observations)


def _with_configured(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    sphere: Planet,
    config: HorizonConfig,
) -> HorizonFit:
    """Return the fit with what may be wrong with cameras and the limb's height."""
    hidden_m = hidden_air_sigma_m(fit, observations, sphere)
    return with_calibration_error(
        fit,
        observations,
        sphere,
        mounting_sigma_rad=config.mounting_sigma_rad,
        lens_sigma_px=config.lens_sigma_px,
        limb_height_sigma_m=math.hypot(config.limb_height_sigma_m, hidden_m),
        limb_unevenness_m=config.limb_unevenness_m,
    )

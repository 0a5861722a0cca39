"""What is wrong alike with whatever the cameras of a fit see."""

from __future__ import annotations

import numpy as np
from limb_samples import PINHOLE, observe, view_at_limb

from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fit_errors import common_covariance
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import MeanSphere

NADIR = np.array([0.0, 0.0, 1.0])


def test_an_ellipsoid_that_is_taken_for_a_sphere_is_wrong_for_all_cameras_alike() -> None:
    """Limb and airglow's edge are weighted against each other without it."""
    figure = MeanSphere(Planet.wgs84(), "geocentric")
    rho = figure.sphere.rho_from_altitude(600e3)
    views = [view_at_limb(PINHOLE, NADIR, rho, 1.6 * k, name=f"camera_{k + 1}") for k in range(2)]
    seen = [observe(view, NADIR, rho) for view in views]
    fit = fit_horizon(seen, figure.sphere)
    of_figure = figure.covariance(fit, seen)
    assert np.degrees(np.sqrt(np.trace(of_figure[:3, :3]))) > 0.03
    common = common_covariance(fit, seen, figure, HorizonConfig())
    np.testing.assert_allclose(common[:3, :3], of_figure[:3, :3], rtol=1e-9)
    exact = common_covariance(fit, seen, MeanSphere(Planet(), "geocentric"), HorizonConfig())
    np.testing.assert_allclose(exact[:3, :3], 0.0, atol=1e-20)

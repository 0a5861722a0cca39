"""An altitude known from elsewhere against the closed form of how covariances shrink."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limb_samples import BARREL, nadir_nees, observe, view_at_limb

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.fits.known_altitude import with_altitude
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.planet import Planet

PLANET = Planet()
NADIR = np.array([-0.2, 0.6, 0.77]) / np.linalg.norm([-0.2, 0.6, 0.77])
ALTITUDE_M = 600e3
RHO = PLANET.rho_from_altitude(ALTITUDE_M)


def short_arc(seed: int, arc_rad: float = 0.4) -> HorizonFit:
    view = view_at_limb(BARREL, NADIR, RHO, 0.4)
    noise = np.random.default_rng(seed)
    return fit_horizon([observe(view, NADIR, RHO, 0.1, noise, arc_rad=arc_rad)], PLANET)


def three(fit: HorizonFit) -> np.ndarray:
    """Covariance (3, 3) of (two tangent components, altitude in km)."""
    to = np.zeros((3, 4))
    to[:2, :3] = tangent_basis(fit.nadir_base).T
    to[2, 3] = 1e-3
    return to @ fit.cov_nadir_altitude @ to.T


@given(st.integers(0, 1000), st.floats(10.0, 1e6))
@settings(max_examples=30)
def test_the_covariance_shrinks_as_information_adds(seed: int, sigma_m: float) -> None:
    fit = short_arc(seed)
    both, unused = with_altitude(fit, AltitudeMeasurement(ALTITUDE_M, sigma_m), PLANET)
    assert unused == ""
    information = np.linalg.inv(three(fit))
    information[2, 2] += 1.0 / (sigma_m * 1e-3) ** 2
    # To a turn of the tangent plane by the update, a fraction of a degree.
    np.testing.assert_allclose(
        np.linalg.eigvalsh(three(both)), np.linalg.eigvalsh(np.linalg.inv(information)), rtol=1e-3
    )
    variance = fit.cov_nadir_altitude[3, 3]
    want = variance * sigma_m**2 / (variance + sigma_m**2)
    assert both.cov_nadir_altitude[3, 3] == pytest.approx(want, rel=1e-9)
    mean = (fit.altitude_m * sigma_m**2 + ALTITUDE_M * variance) / (variance + sigma_m**2)
    assert both.altitude_m == pytest.approx(mean, rel=1e-9)
    assert np.linalg.norm(both.nadir_base) == pytest.approx(1.0, abs=1e-12)
    along = both.nadir_base @ both.cov_nadir_altitude[:3, :3] @ both.nadir_base
    assert abs(along) < 1e-15
    assert both.rho_rad == pytest.approx(PLANET.rho_from_altitude(both.altitude_m))


@given(st.integers(0, 2**31), st.floats(1e3, 1e6), st.floats(-4.0, 3.0))
def test_an_altitude_known_far_better_than_seen_keeps_its_variance(
    seed: int, seen_sigma_m: float, exponent: float
) -> None:
    """The difference of nearly equal variances was rounding, and mostly zero."""
    rows = np.random.default_rng(seed).normal(size=(3, 3)) * ((1e-3,), (1e-3,), (seen_sigma_m,))
    basis = np.zeros((4, 3))
    basis[:3, :2], basis[3, 2] = tangent_basis(NADIR), 1.0
    cov = basis @ rows @ rows.T @ basis.T
    fit = replace(short_arc(3), nadir_base=NADIR, cov_nadir_altitude=cov)
    sigma_m = 10.0**exponent
    both, unused = with_altitude(fit, AltitudeMeasurement(fit.altitude_m, sigma_m), PLANET)
    assert unused == ""
    want = sigma_m**2 * cov[3, 3] / (cov[3, 3] + sigma_m**2)
    assert both.cov_nadir_altitude[3, 3] == pytest.approx(want, rel=1e-9)
    sigmas = np.sqrt(np.diag(three(both)))
    assert np.linalg.eigvalsh(three(both) / np.outer(sigmas, sigmas))[0] > -1e-9


def test_nadir_on_a_short_arc_gains_too_and_stays_honest() -> None:
    errors, gains = [], []
    for seed in range(60):
        fit = short_arc(seed)
        both, _ = with_altitude(fit, AltitudeMeasurement(ALTITUDE_M, 100.0), PLANET)
        errors.append(nadir_nees(both, NADIR))
        gains.append(
            np.trace(both.cov_nadir_altitude[:3, :3]) / np.trace(fit.cov_nadir_altitude[:3, :3])
        )
    assert np.median(gains) < 0.2
    assert 1.4 < np.mean(errors) < 2.7


def test_a_useless_altitude_changes_nothing() -> None:
    fit = short_arc(3)
    same, _ = with_altitude(fit, AltitudeMeasurement(0.0, 1e15), PLANET)
    np.testing.assert_allclose(same.nadir_base, fit.nadir_base, atol=1e-12)
    assert same.altitude_m == pytest.approx(fit.altitude_m, rel=1e-9)


def test_an_altitude_that_contradicts_the_frames_is_not_used_and_said_so() -> None:
    """It turned nadir, by up to fifty of the sigmas that were claimed."""
    fit = short_arc(3)
    sigma_m = float(np.sqrt(fit.cov_nadir_altitude[3, 3] + 1e3**2))
    for sign in (-1.0, 1.0):
        near = AltitudeMeasurement(fit.altitude_m + sign * 4.9 * sigma_m, 1e3)
        far = AltitudeMeasurement(fit.altitude_m + sign * 5.1 * sigma_m, 1e3)
        assert with_altitude(fit, near, PLANET)[1] == ""
        same, unused = with_altitude(fit, far, PLANET)
        assert same is fit
        assert f"{far.altitude_m / 1e3:.1f} +- 1.0 km" in unused


def test_an_altitude_below_the_limb_is_not_used() -> None:
    """Nothing is seen from there, and there would be no disc."""
    planet = Planet(limb_height_m=30e3)
    rho = planet.rho_from_altitude(32e3)
    view = view_at_limb(BARREL, NADIR, rho, 0.4)
    fit = fit_horizon([observe(view, NADIR, rho, 0.1, np.random.default_rng(0))], planet)
    cov = fit.cov_nadir_altitude.copy()
    cov[3, 3] += 2e3**2
    fit = replace(fit, cov_nadir_altitude=cov)
    same, unused = with_altitude(fit, AltitudeMeasurement(28e3, 500.0), planet)
    assert same is fit
    assert "28.0 km, is not used: it lies below the limb" in unused

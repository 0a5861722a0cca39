"""The maximum-likelihood fit's statistics by Monte Carlo: bias, bound, covariance, outliers."""

from __future__ import annotations

import numpy as np
import pytest
from limb_samples import BARREL, FISHEYE, PINHOLE, RATIONAL, cone_rays, observe, view_at_limb

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits import HorizonFit, LimbObservation, fit_horizon
from horizon_sensor_ros.core.fits.bound import horizon_bound
from horizon_sensor_ros.core.fits.circle import circle_on_sphere
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import gather
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import angle_rad, tangent_basis
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

PLANET = Planet()
NADIR = np.array([-0.2, 0.6, 0.77]) / np.linalg.norm([-0.2, 0.6, 0.77])
BASIS = tangent_basis(NADIR)


def clean_limbs(
    cameras: list[Camera], altitude_m: float, sigma_px: float, **options: float
) -> list[LimbObservation]:
    rho = PLANET.rho_from_altitude(altitude_m)
    return [
        observe(
            view_at_limb(camera, NADIR, rho, 0.3 + k * np.pi / 2, 0.4 * k, 0.0, str(k)),
            NADIR, rho, sigma_px, None, **options,
        )
        for k, camera in enumerate(cameras)
    ]  # fmt: skip


def shifted(observation: LimbObservation, across_px: np.ndarray) -> LimbObservation:
    limb = observation.limb
    px = limb.px + limb.normal_px * across_px[:, None]
    return LimbObservation(
        observation.view, LimbPoints(Status.OK, "", px, limb.normal_px, limb.sigma_px)
    )


def monte_carlo(
    limbs: list[LimbObservation], sigma_px: float, runs: int, seed: int, method: str = "ml"
) -> list[HorizonFit]:
    rng = np.random.default_rng(seed)
    return [
        fit_horizon(
            [shifted(limb, rng.normal(0, sigma_px, len(limb.limb.px))) for limb in limbs],
            PLANET,
            method,
        )
        for _ in range(runs)
    ]


def errors_and_nees(fits: list[HorizonFit]) -> tuple[np.ndarray, np.ndarray]:
    errors = np.array([BASIS.T @ fit.nadir_base for fit in fits])
    nees = [
        e @ np.linalg.solve(BASIS.T @ fit.cov_nadir_altitude[:3, :3] @ BASIS, e)
        for e, fit in zip(errors, fits, strict=True)
    ]
    return errors, np.array(nees)


@pytest.mark.parametrize(
    ("cameras", "altitude", "spacing"),
    [
        ([PINHOLE], 4e5, 2.0),
        ([BARREL, PINHOLE], 4e5, 2.0),
        ([RATIONAL], 6e6, 4.0),
        ([FISHEYE], 3.2e4, 2.0),
    ],
    ids=["one", "two", "high", "balloon"],
)
def test_error_meets_the_cramer_rao_bound_and_the_covariance_is_true(
    cameras: list[Camera], altitude: float, spacing: float
) -> None:
    runs, sigma = 250, 0.1
    limbs = clean_limbs(cameras, altitude, sigma, spacing_px=spacing)
    fits = monte_carlo(limbs, sigma, runs, seed=1)
    assert all(fit.ok for fit in fits)
    errors, nees = errors_and_nees(fits)
    bound = horizon_bound(
        [limb.view for limb in limbs], PLANET, NADIR, altitude, sigma * np.sqrt(spacing)
    )
    rms = np.sqrt((errors**2).sum(axis=1).mean())
    assert rms / np.sqrt(np.trace(bound[:3, :3])) == pytest.approx(1.03, abs=0.15)
    # The mean of 250 two-degree chi squares has a sigma of 0.13.
    assert 1.5 < nees.mean() < 2.4
    altitude_error = np.array([fit.altitude_m - altitude for fit in fits])
    assert np.sqrt(np.mean(altitude_error**2) / bound[3, 3]) == pytest.approx(1.03, abs=0.15)
    sigma_altitude = np.array([np.sqrt(fit.cov_nadir_altitude[3, 3]) for fit in fits])
    assert 0.7 < np.mean((altitude_error / sigma_altitude) ** 2) < 1.3
    standard_error = rms / np.sqrt(2 * runs)
    assert np.abs(errors.mean(axis=0)).max() < 5 * standard_error


@pytest.mark.parametrize(("arc_deg", "sigma"), [(30, 0.1), (10, 0.1), (5, 0.02), (3, 0.005)])
def test_short_arcs_do_not_bias_it_beyond_its_sigma(arc_deg: float, sigma: float) -> None:
    limbs = clean_limbs([PINHOLE], 4e5, sigma, spacing_px=1.0, arc_rad=np.radians(arc_deg))
    fits = monte_carlo(limbs, sigma, 200, seed=2)
    assert np.mean([fit.ok for fit in fits]) > 0.97
    errors, nees = errors_and_nees([fit for fit in fits if fit.ok])
    rms = np.sqrt((errors**2).sum(axis=1).mean())
    assert np.linalg.norm(errors.mean(axis=0)) < 0.25 * rms
    assert 1.3 < nees.mean() < 2.7


def test_where_the_linear_cone_is_biased_its_covariance_says_so() -> None:
    limbs = clean_limbs([PINHOLE], 4e5, 0.1, spacing_px=1.0, arc_rad=np.radians(15))
    linear, nees = errors_and_nees(monte_carlo(limbs, 0.1, 60, seed=3, method="cone"))
    best, _ = errors_and_nees(monte_carlo(limbs, 0.1, 60, seed=3))
    assert np.linalg.norm(linear.mean(axis=0)) > 3 * np.linalg.norm(best.mean(axis=0))
    assert nees.mean() < 3


def test_arcs_too_short_to_show_curvature_are_refused() -> None:
    for arc_deg in (1.0, 2.0, 3.0):
        limbs = clean_limbs([PINHOLE], 4e5, 0.1, spacing_px=1.0, arc_rad=np.radians(arc_deg))
        for method in ("ml", "cone", "gauss_newton"):
            fits = monte_carlo(limbs, 0.1, 60, seed=4, method=method)
            assert not any(fit.ok for fit in fits)


@pytest.mark.parametrize("one_sided", [False, True])
def test_outliers_do_not_move_it(one_sided: bool) -> None:
    rng = np.random.default_rng(6)
    limbs = clean_limbs([BARREL, PINHOLE], 5e5, 0.1)
    fits = []
    for _ in range(60):
        noisy = []
        for limb in limbs:
            across = rng.normal(0, 0.1, len(limb.limb.px))
            wild = rng.random(len(across)) < 0.35
            spread = rng.uniform(-1, 0.1 if one_sided else 1, len(across)) * 40
            noisy.append(shifted(limb, np.where(wild, spread, across)))
        fits.append(fit_horizon(noisy, PLANET))
    assert all(fit.ok for fit in fits)
    errors, nees = errors_and_nees(fits)
    clean, _ = errors_and_nees(monte_carlo(limbs, 0.1, 60, seed=6))
    assert np.sqrt((errors**2).mean()) < 2 * np.sqrt((clean**2).mean())
    assert nees.mean() < 3.5
    assert all(fit.num_inliers < 0.75 * fit.num_points for fit in fits)


def test_noise_larger_than_claimed_enlarges_the_covariance() -> None:
    limbs = clean_limbs([BARREL, PINHOLE], 5e5, 0.1)
    fits = monte_carlo(limbs, 0.4, 150, seed=7)
    _, nees = errors_and_nees(fits)
    assert 1.4 < nees.mean() < 2.6
    assert np.mean([fit.rms_residual_px for fit in fits]) == pytest.approx(0.4, rel=0.1)


def test_noise_that_hangs_together_along_the_limb_enlarges_the_covariance() -> None:
    rng = np.random.default_rng(8)
    limbs = clean_limbs([BARREL, PINHOLE], 5e5, 0.1, spacing_px=1.0)
    kernel = np.exp(-np.arange(40) / 8.0)
    kernel /= np.linalg.norm(kernel)
    fits = []
    for _ in range(120):
        noisy = [
            shifted(
                limb, 0.1 * np.convolve(rng.normal(size=len(limb.limb.px) + 39), kernel, "valid")
            )
            for limb in limbs
        ]
        fits.append(fit_horizon(noisy, PLANET))
    _, nees = errors_and_nees(fits)
    # As independent points their covariance would be some 16 times too small.
    assert nees.mean() < 4


def test_the_start_does_not_matter() -> None:
    limbs = clean_limbs([BARREL, PINHOLE], 5e5, 0.1)
    noisy = [shifted(limb, np.random.default_rng(1).normal(0, 0.1, len(limb.limb.px)))
             for limb in limbs]  # fmt: skip
    reference = fit_maximum_likelihood(noisy, PLANET)
    rho = PLANET.rho_from_altitude(5e5)
    for azimuth in np.linspace(0, 6, 5):
        start = cone_rays(NADIR, 0.08, np.array([azimuth]))[0]
        fit = fit_maximum_likelihood(noisy, PLANET, initial=(start, rho - 0.05))
        assert fit.ok
        assert angle_rad(fit.nadir_base, reference.nadir_base) < 1e-6
    lost = fit_maximum_likelihood(noisy, PLANET, initial=(np.full(3, np.nan), rho))
    assert lost.status is Status.ILL_CONDITIONED


def test_circle_on_the_sphere_is_exact_on_exact_rays() -> None:
    for altitude in (2e4, 5e5, 4e7):
        nadir, rho = circle_on_sphere(gather(clean_limbs([PINHOLE, BARREL], altitude, 0.1)))
        assert angle_rad(nadir, NADIR) < 1e-6
        assert rho == pytest.approx(PLANET.rho_from_altitude(altitude), abs=1e-6)


def test_bound_of_a_disc_seen_whole_is_the_closed_form() -> None:
    """A pinhole looking straight down: the limb is a circle in the image, of known length."""
    altitude = 1.5e7
    rho = PLANET.rho_from_altitude(altitude)
    focal = 600.0
    camera = Camera(600, 600, focal, focal, 299.5, 299.5)
    view = CameraView("down", camera, np.column_stack((BASIS, NADIR)))
    bound = horizon_bound([view], PLANET, NADIR, altitude, 0.05)
    num_px = 2 * np.pi * focal * np.tan(rho)
    sigma_rad = 0.05 * np.cos(rho) ** 2 / focal
    nadir_variance = 2 * sigma_rad**2 / num_px
    assert np.linalg.eigvalsh(bound[:3, :3])[1:] == pytest.approx([nadir_variance] * 2, rel=1e-5)
    sigma_altitude = sigma_rad / np.sqrt(num_px) * abs(PLANET.altitude_slope(rho))
    assert np.sqrt(bound[3, 3]) == pytest.approx(sigma_altitude, rel=1e-5)


def test_bound_shrinks_with_cameras_and_vanishes_without_limb() -> None:
    rho = PLANET.rho_from_altitude(5e5)
    views = [view_at_limb(PINHOLE, NADIR, rho, k, 0.1, 0.0, str(k)) for k in (0.0, 1.5)]
    one = horizon_bound(views[:1], PLANET, NADIR, 5e5, 0.02)
    two = horizon_bound(views, PLANET, NADIR, 5e5, 0.02)
    assert np.all(np.diag(two) < np.diag(one))
    away = view_at_limb(PINHOLE, NADIR, rho, 0.0, 0.0, 1.2)
    assert np.isnan(horizon_bound([away], PLANET, NADIR, 5e5, 0.02)).all()
    assert np.isnan(horizon_bound([], PLANET, NADIR, 5e5, 0.02)).all()
    assert horizon_bound([away, *views], PLANET, NADIR, 5e5, 0.02) == pytest.approx(two)


@pytest.mark.parametrize("num_views", [0, 1])
@pytest.mark.parametrize(
    ("nadir", "altitude_m", "sigma_px", "words"),
    [
        (np.zeros(3), 5e5, 0.02, "nadir_base must be a direction"),
        (np.full(3, np.nan), 5e5, 0.02, "nadir_base must be a direction"),
        (NADIR[:2], 5e5, 0.02, "nadir_base must be a direction"),
        (NADIR, -5.0, 0.02, "altitude_m must be above the limb, got -5.0"),
        (NADIR, 5e5, 0.0, "sigma_px must be positive, got 0.0"),
    ],
)
def test_a_bound_of_what_makes_no_sense_is_the_callers_bug(
    nadir: np.ndarray, altitude_m: float, sigma_px: float, words: str, num_views: int
) -> None:
    """Of no direction it was not a number; without a camera nothing was asked."""
    views = [view_at_limb(PINHOLE, NADIR, PLANET.rho_from_altitude(5e5), 0.0)][:num_views]
    with pytest.raises(ValueError, match=words):
        horizon_bound(views, PLANET, nadir, altitude_m, sigma_px)

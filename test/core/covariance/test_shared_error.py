"""Covariances of fits to points that are off together: against fits to points drawn so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_samples import PINHOLE, observe, view_at_limb

from horizon_sensor_ros.core.covariance.shared_error import with_shared_error
from horizon_sensor_ros.core.fits import LimbObservation, fit_horizon
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb_points import (
    BEND_OF_STRETCHES,
    MEAN_OF_STRETCHES,
    SLOPE_OF_STRETCHES,
    SharedError,
)
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.planet import Planet

NADIR, PLANET = np.array([0.0, 0.0, 1.0]), Planet()
RHO_RAD = PLANET.rho_from_altitude(800e3)
STRETCHES = 6
BASIS = tangent_basis(NADIR)


def limb_of(camera: int, **claims: object) -> LimbObservation:
    """One camera's exact limb, a tenth of a pixel claimed for each point unless said otherwise."""
    view = view_at_limb(PINHOLE, NADIR, RHO_RAD, 1.7 * camera, name=f"camera_{camera + 1}")
    exact = observe(view, NADIR, RHO_RAD, spacing_px=12.0)
    claims.setdefault("sigma_px", np.full(len(exact.limb.px), 0.1))
    return LimbObservation(view, replace(exact.limb, **claims))


def unequal(num: int) -> np.ndarray:
    """Sigmas (num,) of points beside ground that is even for a third of the limb."""
    return np.where(np.arange(num) < num // 3, 0.03, 0.3)


def drawn(exact: LimbObservation, rng: np.random.Generator) -> LimbObservation:
    """The limb with the errors that it claims."""
    limb = exact.limb
    num = len(limb.px)
    off = limb.sigma_px * rng.standard_normal(num) + limb.shared.shift_px * rng.standard_normal()
    stretch = np.minimum(np.arange(num) * STRETCHES // num, STRETCHES - 1)
    off += limb.shared.coherent_px * rng.standard_normal(STRETCHES)[stretch]
    off += limb.shared.slope_px * rng.standard_normal() * np.linspace(-1.0, 1.0, num)
    return replace(exact, limb=replace(limb, px=limb.px + off[:, None] * limb.normal_px))


def cov_of_cone(cov: np.ndarray) -> np.ndarray:
    """(3, 3) by tangent components and rho, of (4, 4) by nadir and altitude."""
    to_cone = np.zeros((3, 4))
    to_cone[:2, :3], to_cone[2, 3] = BASIS.T, 1.0 / PLANET.altitude_slope(RHO_RAD)
    return to_cone @ cov @ to_cone.T


def nees_of(fit: HorizonFit) -> float:
    """Three degrees of freedom: nadir and rho."""
    off = np.append(BASIS.T @ fit.nadir_base, fit.rho_rad - RHO_RAD)
    return float(off @ np.linalg.solve(cov_of_cone(fit.cov_nadir_altitude), off))


@pytest.mark.parametrize("cameras", [1, 2])
@pytest.mark.parametrize("even", [True, False], ids=["alike", "unequal"])
@pytest.mark.parametrize("slope_px", [0.0, 0.3], ids=["", "turned"])
def test_errors_are_as_large_as_claimed(cameras: int, even: bool, slope_px: float) -> None:
    """Also where few points of the limb, or those of one camera, weigh most in the fit."""
    rng = np.random.default_rng(20 + cameras)
    shared = [SharedError(coherent_px, 0.1, slope_px) for coherent_px in (0.15, 0.4)]
    exact = [limb_of(i, shared=shared[i]) for i in range(cameras)]
    if not even:
        exact = [
            replace(one, limb=replace(one.limb, sigma_px=unequal(len(one.limb.px))))
            for one in exact
        ]
    nees = []
    for _ in range(400):
        seen = [drawn(one, rng) for one in exact]
        fit = with_shared_error(fit_horizon(seen, PLANET), seen, PLANET)
        assert fit.ok
        nees.append(nees_of(fit))
    # Three degrees of freedom; stretches that happen to lie off far are believed, which adds to
    # the covariance.
    assert 1.8 < np.mean(nees) < 3.4


@pytest.mark.parametrize("coherent_px", [0.1, 0.4])
def test_what_chance_bends_a_limb_by_is_not_claimed_besides(coherent_px: float) -> None:
    """It made claims that hold half as large again, in the mean of their variance."""
    rng = np.random.default_rng(3)
    exact = limb_of(0, shared=SharedError(coherent_px))

    def claimed(seen: LimbObservation) -> float:
        fit = with_shared_error(fit_horizon([seen], PLANET), [seen], PLANET)
        return float(np.trace(cov_of_cone(fit.cov_nadir_altitude)))

    by_chance = np.mean([claimed(drawn(exact, rng)) for _ in range(300)])
    assert 1.0 < by_chance / claimed(exact) < 1.4


def test_a_limb_that_bends_far_more_than_its_points_claim_is_claimed_to() -> None:
    """Three degrees of freedom: the median is 2.4."""
    rng, claims = np.random.default_rng(4), SharedError(0.15)
    exact, nees = limb_of(0, shared=SharedError(1.5)), []
    for _ in range(300):
        seen = drawn(exact, rng)
        seen = replace(seen, limb=replace(seen.limb, shared=claims))
        nees.append(nees_of(with_shared_error(fit_horizon([seen], PLANET), [seen], PLANET)))
    assert np.median(nees) < 4.0


def log_scale(seen: LimbObservation) -> np.ndarray:
    """(N,) logarithm of pixels to a radian: by how far two rays beside each point are apart."""
    px, normal_px = seen.limb.px, seen.limb.normal_px
    rays = [seen.view.camera.rays(px + step * normal_px) for step in (-0.5, 0.5)]
    outward = rays[1] - rays[0]
    return -np.log(np.linalg.norm(outward, axis=1))


@pytest.mark.parametrize("cameras", [1, 2])
def test_air_that_lifts_edges_less_where_pixels_are_finer_turns_the_limb(cameras: int) -> None:
    """The same air above all limbs; what it lifts all of them by is not in this covariance."""
    rng = np.random.default_rng(40 + cameras)
    exact = [limb_of(i, shared=SharedError(scale_px=0.6)) for i in range(cameras)]
    scales = [log_scale(one) for one in exact]
    usual = np.concatenate(scales).mean()
    nees, without = [], []
    for _ in range(300):
        air = rng.standard_normal()
        seen = []
        for one, scale in zip(exact, scales, strict=True):
            off = one.limb.sigma_px * rng.standard_normal(len(one.limb.px))
            off += air * one.limb.shared.scale_px * (scale - usual)
            px = one.limb.px + off[:, None] * one.limb.normal_px
            seen.append(replace(one, limb=replace(one.limb, px=px)))
        plain = fit_horizon(seen, PLANET)
        for fit, found in ((with_shared_error(plain, seen, PLANET), nees), (plain, without)):
            found.append(nees_of(fit))
    # Three degrees of freedom.
    assert 2.0 < np.mean(nees) < 3.6
    # Two cameras that see it alike hold each other: it is one height again.
    assert cameras > 1 or np.mean(without) > 1.5 * np.mean(nees)


@pytest.mark.parametrize("cameras", [1, 2])
def test_light_of_air_lifts_edges_the_more_the_darker_the_ground_is(cameras: int) -> None:
    """Each camera's limb by itself; what all of it is lifted by is not in this covariance."""
    rng = np.random.default_rng(60 + cameras)
    exact = []
    for i in range(cameras):
        num = len(limb_of(i).limb.px)
        # As under a Sun that is low at one end of the limb.
        step = np.linspace(0.4, 1.3, num)
        exact.append(limb_of(i, shared=SharedError(dark_px=0.3), step=step))
    nees, without = [], []
    for _ in range(300):
        seen = []
        for one in exact:
            limb = one.limb
            off = limb.sigma_px * rng.standard_normal(len(limb.px))
            darkness = np.median(limb.step) / limb.step
            uneven = darkness - darkness.mean()
            off += rng.standard_normal() * limb.shared.dark_px * uneven
            px = limb.px + off[:, None] * limb.normal_px
            seen.append(replace(one, limb=replace(limb, px=px)))
        plain = fit_horizon(seen, PLANET)
        for fit, found in ((with_shared_error(plain, seen, PLANET), nees), (plain, without)):
            found.append(nees_of(fit))
    # Three degrees of freedom; what two cameras show of it in their residuals is believed as well.
    assert 1.4 < np.mean(nees) < 3.6
    assert np.mean(without) > 1.5 * np.mean(nees)


def test_one_cameras_cone_is_known_as_it_says() -> None:
    root = np.array([[1.0, 0.0, 0.0], [0.3, 0.8, 0.0], [0.5, -0.2, 0.4]]) * 1e-4
    to_base = np.zeros((4, 3))
    to_base[:3, :2], to_base[3, 2] = BASIS, 1.0
    seen = [limb_of(0, shared=SharedError(0.1, 0.1), cone_errors=to_base @ root)]
    fit = with_shared_error(fit_horizon(seen, PLANET), seen, PLANET)
    assert np.allclose(cov_of_cone(fit.cov_nadir_altitude), root @ root.T, rtol=1e-4, atol=1e-13)


@pytest.mark.parametrize("true_px", [0.15, 1.5], ids=["as claimed", "bent"])
def test_a_cone_of_a_limb_that_bends_more_than_claimed_is_claimed_to_be_off_more(
    true_px: float,
) -> None:
    """Its errors are those that stretches as they are claimed make, and grow as a bend shows that
    these are off by ten times as much. Three degrees of freedom: the median is 2.4.
    """
    claims = SharedError(0.15)
    usual = limb_of(0, shared=claims)
    known = with_shared_error(fit_horizon([usual], PLANET), [usual], PLANET)
    to_base = np.zeros((4, 3))
    to_base[:3, :2], to_base[3, 2] = BASIS, 1.0
    errors = to_base @ np.linalg.cholesky(cov_of_cone(known.cov_nadir_altitude))
    rng, exact, nees = np.random.default_rng(4), limb_of(0, shared=SharedError(true_px)), []
    for _ in range(300):
        seen = drawn(exact, rng)
        seen = replace(seen, limb=replace(seen.limb, shared=claims, cone_errors=errors))
        nees.append(nees_of(with_shared_error(fit_horizon([seen], PLANET), [seen], PLANET)))
    assert 1.2 < np.median(nees) < 4.0


def test_six_stretches_bend_a_limb_as_a_parabola_through_their_middles() -> None:
    u = (np.arange(6) + 0.5) / 3.0 - 1.0
    each = np.linalg.pinv(np.stack([np.ones(6), u, u * u], axis=1))
    _, slope, bend = np.linalg.norm(each, axis=1)
    assert pytest.approx(slope, abs=0.01) == SLOPE_OF_STRETCHES
    assert pytest.approx(bend, abs=0.01) == BEND_OF_STRETCHES
    assert pytest.approx(6**-0.5, abs=0.01) == MEAN_OF_STRETCHES


def test_points_that_scatter_more_than_they_claim_are_believed_as_much_less() -> None:
    """What all of a limb shares is added to the variance that the fit found, not to the claims."""
    observations = [limb_of(camera, shared=SharedError(0.0, 0.05)) for camera in range(2)]
    fit = fit_horizon(observations, PLANET)
    scattered = replace(fit, cov_nadir_altitude=4.0 * fit.cov_nadir_altitude)
    said, more = (
        cov_of_cone(with_shared_error(each, observations, PLANET).cov_nadir_altitude)
        for each in (fit, scattered)
    )
    own = cov_of_cone(fit.cov_nadir_altitude)
    np.testing.assert_allclose(more - said, 3.0 * own, atol=0.1 * np.abs(own).max())

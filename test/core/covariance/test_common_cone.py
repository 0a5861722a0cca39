"""The cone nearest to several cameras' cones: against cones drawn with the errors they claim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_samples import PINHOLE, observe, turned, view_at_limb

from horizon_sensor_ros.core.covariance.calibration_error import with_calibration_error
from horizon_sensor_ros.core.covariance.common_cone import cone_shares, nearest_to_cones
from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.planet import Planet

NADIR, PLANET = np.array([0.0, 0.0, 1.0]), Planet()
RHO_RAD = PLANET.rho_from_altitude(800e3)
BASIS = tangent_basis(NADIR)
VIEWS = tuple(
    view_at_limb(PINHOLE, NADIR, RHO_RAD, 1.7 * i, name=f"camera_{i + 1}") for i in range(2)
)
# What errors of two cones, three unknowns each, are made of: the last two are common to both.
ERRORS = 1e-4 * np.array(
    [
        [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        [1.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5],
        [2.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0],
        [0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 4.0, 0.0, 0.0, -0.5],
        [0.0, 0.0, 0.0, 0.0, 2.0, 0.8, 2.0, 0.0],
    ]
)
TO_CONE = np.zeros((4, 3))
TO_CONE[:3, :2], TO_CONE[3, 2] = BASIS, 1.0


def cones(off: np.ndarray, errors: np.ndarray = ERRORS) -> list[LimbObservation]:
    """Limbs of two cameras on cones that are off by (6,)."""
    out = []
    for i, view in enumerate(VIEWS):
        own = slice(3 * i, 3 * i + 3)
        nadir = NADIR + BASIS @ off[own][:2]
        limb = observe(view, nadir / np.linalg.norm(nadir), RHO_RAD + off[own][2]).limb
        out.append(LimbObservation(view, replace(limb, cone_errors=TO_CONE @ errors[own])))
    return out


def off_truth(fit: HorizonFit) -> np.ndarray:
    return np.append(BASIS.T @ fit.nadir_base, fit.rho_rad - RHO_RAD)


def fitted(seen: list[LimbObservation]) -> tuple[HorizonFit, HorizonFit]:
    """By their points, and by their cones."""
    by_points = fit_maximum_likelihood(seen, PLANET)
    assert by_points.ok
    nearest = nearest_to_cones(by_points, seen, PLANET)
    assert nearest is not None
    return by_points, nearest


def cov_of_cone(fit: HorizonFit) -> np.ndarray:
    """(3, 3) by tangent components and rho."""
    to_cone = np.zeros((3, 4))
    to_cone[:2, :3], to_cone[2, 3] = BASIS.T, 1.0 / PLANET.altitude_slope(RHO_RAD)
    return to_cone @ fit.cov_nadir_altitude @ to_cone.T


def test_it_is_off_by_what_it_claims_and_by_less_than_points_are() -> None:
    rng = np.random.default_rng(4)
    by_points, by_cones, nees = [], [], []
    for _ in range(300):
        points, nearest = fitted(cones(ERRORS @ rng.standard_normal(8)))
        by_points.append(off_truth(points))
        by_cones.append(off_truth(nearest))
        nees.append(by_cones[-1] @ np.linalg.solve(cov_of_cone(nearest), by_cones[-1]))
    # Three degrees of freedom; cones that happen to lie apart are believed, which adds to it.
    assert 1.8 < np.mean(nees) < 3.3
    points_rms, cones_rms = (np.std([one[:2] for one in off]) for off in (by_points, by_cones))
    assert cones_rms < 0.7 * points_rms


def test_no_other_linear_mean_of_the_cones_is_off_by_less() -> None:
    """Gauss and Markov: any other weights that add up to one have a larger covariance."""
    _, nearest = fitted(cones(np.zeros(6)))
    best = cov_of_cone(nearest)
    shares = np.hstack([share for _, share in cone_shares(nearest, cones(np.zeros(6)))])
    assert np.allclose(shares[:, :3] + shares[:, 3:], np.eye(3), atol=1e-6)
    assert np.allclose(best, shares @ ERRORS @ ERRORS.T @ shares.T, rtol=1e-3, atol=1e-14)
    rng = np.random.default_rng(1)
    for _ in range(20):
        turned = 0.2 * rng.standard_normal((3, 3))
        other = shares + np.hstack([turned, -turned])
        worse = other @ ERRORS @ ERRORS.T @ other.T - best
        assert np.linalg.eigvalsh(worse).min() > -1e-3 * np.linalg.eigvalsh(best).max()


def test_cones_farther_apart_than_they_claim_are_known_less() -> None:
    apart = 1e-3 * np.array([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    near, far = fitted(cones(np.zeros(6)))[1], fitted(cones(apart))[1]
    assert np.trace(far.cov_nadir_altitude[:3, :3]) > 4.0 * np.trace(
        near.cov_nadir_altitude[:3, :3]
    )


def test_one_camera_edges_and_other_methods_are_left_as_they_are() -> None:
    seen = cones(np.zeros(6))
    points = fit_maximum_likelihood(seen, PLANET)
    assert nearest_to_cones(points, seen[:1], PLANET) is None
    edges = LimbObservation(seen[1].view, replace(seen[1].limb, cone_errors=None))
    assert cone_shares(points, [seen[0], edges]) == []
    assert nearest_to_cones(points, [seen[0], edges], PLANET) is None
    circle = fit_horizon(seen, PLANET, "cone")
    assert nearest_to_cones(circle, seen, PLANET) is None


def test_mounting_errors_move_it_as_said() -> None:
    """Fits with cameras that are really turned."""
    sigma_rad, rng = np.radians(0.05), np.random.default_rng(3)
    seen = cones(np.zeros(6))
    offs = [off_truth(fitted(turned(seen, sigma_rad, rng))[1]) for _ in range(300)]
    nearest = fitted(seen)[1]
    said = with_calibration_error(nearest, seen, PLANET, mounting_sigma_rad=sigma_rad)
    added = cov_of_cone(said) - cov_of_cone(nearest)
    scatter = np.cov(np.array(offs).T)
    assert np.linalg.norm(added[:2, :2], 2) == pytest.approx(
        np.linalg.norm(scatter[:2, :2], 2), rel=0.3
    )

"""Errors of mounting and limb height: against fits with cameras that are really turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import PLANET
from limb_samples import observe, turned, view_at_limb

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.readout import view_at_stamp
from horizon_sensor_ros.core.covariance.calibration_error import with_calibration_error
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.motion.turn_rate import TurnRate
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.poses import camera_from_fov

CAMERA = camera_from_fov(640, 480, np.radians(60.0))
NADIR = np.array([0.36, -0.48, 0.8])
ALTITUDE_M = 900e3
RHO = PLANET.rho_from_altitude(ALTITUDE_M)
SIGMA_RAD = np.radians(0.05)


def exact_limbs(azimuths_deg: tuple[float, ...], rho: float = RHO) -> list[LimbObservation]:
    # The second camera sees a third of the limb that the first does, and sees it worse.
    return [
        observe(
            view_at_limb(CAMERA, NADIR, rho, np.radians(azimuth), name=f"camera_{i}"),
            NADIR,
            rho,
            sigma_px=0.5 * (i + 1),
            arc_rad=0.5 / (i + 1),
        )
        for i, azimuth in enumerate(azimuths_deg)
    ]


def fitted(observations: list[LimbObservation], planet: Planet = PLANET) -> HorizonFit:
    fit = fit_maximum_likelihood(observations, planet)
    assert fit.ok, fit.reason
    return fit


def said_and_scatter(
    observations: list[LimbObservation], drawn: list[list[LimbObservation]], **sigmas: float
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (4, 4) that is added for errors, and that of the fits of limbs drawn with them; of
    altitude in units of 10,000 km.
    """
    fits = [fitted(limbs) for limbs in drawn]
    scatter = np.cov(np.array([[*fit.nadir_base, fit.altitude_m / 1e7] for fit in fits]).T)
    fit = fitted(observations)
    with_error = with_calibration_error(fit, observations, PLANET, **sigmas)
    units = np.diag([1.0, 1.0, 1.0, 1e-7])
    said = units @ (with_error.cov_nadir_altitude - fit.cov_nadir_altitude) @ units
    np.testing.assert_allclose(said, scatter, atol=0.25 * np.linalg.norm(scatter, 2))
    # Least certain direction.
    assert np.linalg.norm(said[:3, :3], 2) == pytest.approx(
        np.linalg.norm(scatter[:3, :3], 2), rel=0.25
    )
    return said, scatter


@pytest.mark.parametrize("azimuths_deg", [(0.0,), (0.0, 90.0), (0.0, 60.0, 200.0)])
def test_nadir_and_altitude_scatter_as_said_when_cameras_are_turned(
    azimuths_deg: tuple[float, ...],
) -> None:
    observations = exact_limbs(azimuths_deg)
    rng = np.random.default_rng(3)
    drawn = [turned(observations, SIGMA_RAD, rng) for _ in range(400)]
    said, scatter = said_and_scatter(observations, drawn, mounting_sigma_rad=SIGMA_RAD)
    assert said[3, 3] == pytest.approx(scatter[3, 3], rel=0.3, abs=1e-16)


def test_one_camera_turns_nadir_with_it() -> None:
    observations = exact_limbs((30.0,))
    fit = fitted(observations)
    with_error = with_calibration_error(fit, observations, PLANET, mounting_sigma_rad=SIGMA_RAD)
    added = with_error.cov_nadir_altitude - fit.cov_nadir_altitude
    across = np.eye(3) - np.outer(fit.nadir_base, fit.nadir_base)
    np.testing.assert_allclose(added[:3, :3], SIGMA_RAD**2 * across, atol=1e-12)
    np.testing.assert_allclose(added[3], 0.0, atol=1e-6)


def test_the_rates_part_is_added_but_once() -> None:
    """A fit that has it is enlarged by what cameras contradict each other by."""
    rate = TurnRate(np.zeros(3), 0.01)
    seen = [
        replace(each, view=replace(each.view, readout_s=0.02, rate=rate))
        for each in exact_limbs((0.0, 90.0))
    ]
    fit = fitted(seen)
    once = with_calibration_error(fit, seen, PLANET)
    assert np.trace(once.cov_nadir_altitude) > np.trace(fit.cov_nadir_altitude)
    turned_rad = 1e-12
    again = with_calibration_error(
        once, seen, PLANET, mounting_sigma_rad=turned_rad, with_rate=False
    )
    np.testing.assert_allclose(again.cov_nadir_altitude, once.cov_nadir_altitude, rtol=1e-6)


def _with_other_lens(view: CameraView, focal_px: float, distortion_px: float) -> CameraView:
    """A camera whose corners are off by so much, by focal length and by distortion."""
    camera = view.camera
    corner = 0.5 * np.hypot(camera.width, camera.height)
    scale = 1.0 + focal_px / corner
    k1 = distortion_px / corner * (camera.fx / corner) ** 2
    other = replace(
        camera, fx=scale * camera.fx, fy=scale * camera.fy, distortion=(k1, 0.0, 0.0, 0.0, 0.0)
    )
    return replace(view, camera=other)


@pytest.mark.parametrize("azimuths_deg", [(0.0,), (0.0, 90.0), (0.0, 60.0, 200.0)])
def test_nadir_and_altitude_scatter_as_said_where_lenses_are_others(
    azimuths_deg: tuple[float, ...],
) -> None:
    """Cameras that are calibrated otherwise than they are: fits themselves are the truth."""
    sigma_px = 0.4
    observations = exact_limbs(azimuths_deg)
    rng = np.random.default_rng(5)
    drawn = []
    for _ in range(400):
        others = [
            LimbObservation(_with_other_lens(seen.view, *rng.normal(0.0, sigma_px, 2)), seen.limb)
            for seen in observations
        ]
        drawn.append(others)
    said, scatter = said_and_scatter(observations, drawn, lens_sigma_px=sigma_px)
    assert said[3, 3] == pytest.approx(scatter[3, 3], rel=0.25)


@pytest.mark.parametrize("azimuths_deg", [(0.0,), (0.0, 90.0)])
def test_what_lenses_of_another_focal_length_and_distortion_do_is_claimed(
    azimuths_deg: tuple[float, ...],
) -> None:
    """To first order: fits by one lens after the other that is a little otherwise. Distortion grows
    with the third power of the distance to the axis.
    """
    sigma_px = 0.02
    observations = exact_limbs(azimuths_deg)
    fit = fitted(observations)
    cov = np.zeros((4, 4))
    for i, seen in enumerate(observations):
        for other in ((sigma_px, 0.0), (0.0, sigma_px)):
            limbs = list(observations)
            limbs[i] = LimbObservation(_with_other_lens(seen.view, *other), seen.limb)
            moved = fitted(limbs)
            off = np.append(moved.nadir_base - fit.nadir_base, moved.altitude_m - fit.altitude_m)
            cov += np.outer(off, off)
    said = with_calibration_error(fit, observations, PLANET, lens_sigma_px=sigma_px)
    units = np.diag([1.0, 1.0, 1.0, 1e-7])
    said_cov = units @ (said.cov_nadir_altitude - fit.cov_nadir_altitude) @ units
    cov = units @ cov @ units
    np.testing.assert_allclose(said_cov, cov, atol=5e-4 * np.linalg.norm(cov, 2))


@pytest.mark.parametrize(("readout_s", "after_s"), [(0.02, 0.0), (-0.02, 0.01), (0.0, 0.01)])
@pytest.mark.parametrize("azimuths_deg", [(0.0,), (0.0, 90.0)])
def test_nadir_and_altitude_scatter_as_said_where_the_craft_turns_otherwise(
    azimuths_deg: tuple[float, ...], readout_s: float, after_s: float
) -> None:
    """Rows that are read, and cameras that are late one after the other, as the craft turns at
    rates nobody knows; all turn alike.
    """
    sigma_rad_s = np.radians(2.0)
    plain = exact_limbs(azimuths_deg)
    views = [replace(seen.view, readout_s=readout_s) for seen in plain]

    def read(rate: np.ndarray, sigma: float) -> list[LimbObservation]:
        turning = TurnRate(rate, sigma)
        at_stamp = [view_at_stamp(view, turning, (i + 1) * after_s) for i, view in enumerate(views)]
        limbs = [seen.limb for seen in plain]
        return [LimbObservation(view, limb) for view, limb in zip(at_stamp, limbs, strict=True)]

    rng = np.random.default_rng(6)
    drawn = [read(rng.normal(0.0, sigma_rad_s, 3), 0.0) for _ in range(400)]
    said, scatter = said_and_scatter(read(np.zeros(3), sigma_rad_s), drawn)
    assert said[3, 3] == pytest.approx(scatter[3, 3], rel=0.25, abs=1e-16)


@pytest.mark.parametrize("azimuths_deg", [(0.0,), (0.0, 90.0), (0.0, 10.0)])
def test_nadir_and_altitude_scatter_as_said_where_the_limb_is_uneven(
    azimuths_deg: tuple[float, ...],
) -> None:
    """Heights drawn along all of a limb; cameras that see the same of it see the same heights."""
    sigma_m, azimuth = 3e3, np.linspace(0.0, 2.0 * np.pi, 721)[:-1]
    radius_m, distance_m = PLANET.radius_m, PLANET.radius_m + ALTITUDE_M
    # Distances along the ground between points of a circle of angular radius 90 deg - rho.
    apart = np.sin(RHO) ** 2 + np.cos(RHO) ** 2 * np.cos(azimuth[:, None] - azimuth)
    alike = np.exp(-radius_m * np.arccos(np.clip(apart, -1.0, 1.0)) / 500e3)
    root = sigma_m * np.linalg.cholesky(alike + 1e-9 * np.eye(len(azimuth)))
    observations = exact_limbs(azimuths_deg)
    east, north = np.linalg.svd(NADIR[None])[2][1:]
    rng = np.random.default_rng(7)
    drawn = []
    for _ in range(400):
        heights = root @ rng.standard_normal(len(azimuth))
        limbs = []
        for seen in observations:
            view, limb = seen.view, seen.limb
            rays = view.camera.rays(limb.px) @ view.rot_base_from_cam.T
            level = rays - (rays @ NADIR)[:, None] * NADIR
            level /= np.linalg.norm(level, axis=1)[:, None]
            at = np.arctan2(level @ north, level @ east)
            height = np.interp(at, azimuth, heights, period=2.0 * np.pi)
            rho = np.arcsin((radius_m + height) / distance_m)[:, None]
            raised = (np.cos(rho) * NADIR + np.sin(rho) * level) @ view.rot_base_from_cam
            limbs.append(LimbObservation(view, replace(limb, px=view.camera.pixels(raised))))
        drawn.append(limbs)
    said, scatter = said_and_scatter(observations, drawn, limb_unevenness_m=sigma_m)
    assert said[3, 3] == pytest.approx(scatter[3, 3], rel=0.25)


def test_a_limb_that_lies_higher_moves_the_altitude_alone() -> None:
    observations = exact_limbs((0.0, 90.0))
    higher = fitted(observations, Planet(PLANET.radius_m, 5e3))
    fit = fitted(observations)
    with_error = with_calibration_error(fit, observations, PLANET, limb_height_sigma_m=5e3)
    added = with_error.cov_nadir_altitude - fit.cov_nadir_altitude
    assert np.sqrt(added[3, 3]) == pytest.approx(higher.altitude_m - fit.altitude_m, rel=1e-6)
    assert np.count_nonzero(added) == 1


def test_none_is_the_same_fit() -> None:
    observations = exact_limbs((0.0,))
    fit = fitted(observations)
    same = with_calibration_error(fit, observations, PLANET, mounting_sigma_rad=0.0)
    assert same is fit


@pytest.mark.parametrize(
    "name", ["mounting_sigma_rad", "lens_sigma_px", "limb_height_sigma_m", "limb_unevenness_m"]
)
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_sigmas_that_make_no_sense(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        HorizonConfig(**{name: value})

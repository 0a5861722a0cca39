"""The ellipsoid's limb as a sphere's: against its numerical limb, closed forms, and many refits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limb_frames import as_frames, shared_frames, shared_truths
from limb_samples import BARREL, CAMERAS, FISHEYE, view_at_limb
from scipy.optimize import brentq
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import Aiding, AltitudeMeasurement, CoarsePose
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.stretched_camera import stretched_view
from horizon_sensor_ros.core.covariance.figure_error import (
    ANY_POLE,
    figure_influence,
    mean_figure,
    pole_covariance,
)
from horizon_sensor_ros.core.fits import METHODS, fit_horizon
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.estimator import HorizonEstimator
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb_curve import limb_curve
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import angle_rad, tangent_basis
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import VERTICALS, Figure, MeanSphere, StretchedEllipsoid
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene
from horizon_sensor_ros.sim.scene_sets import two_camera_set

WGS84 = Planet.wgs84()
FLAT = Planet(6.4e6, 2e4, 0.1)  # ten times as flat as any planet need be
seeds = st.integers(0, 2**32 - 1)


class Craft:
    """Somewhere above an ellipsoid, any way up, with cameras at its limb."""

    def __init__(
        self,
        seed: int,
        planet: Planet = WGS84,
        cameras: tuple[Camera, ...] = (BARREL, BARREL),
        altitudes_m: tuple[float, float] = (300e3, 6000e3),
    ) -> None:
        rng = np.random.default_rng(seed)
        self.planet = planet
        self.height_m = float(np.exp(rng.uniform(*np.log(altitudes_m))))
        self.latitude = float(np.arcsin(rng.uniform(-1, 1)))
        self.position = planet.ecef_from_geodetic(
            self.latitude, rng.uniform(-np.pi, np.pi), self.height_m
        )
        self.rot_ecef_from_base = Rotation.random(random_state=rng.integers(2**31)).as_matrix()
        nadir = self.nadir("geocentric")
        rho = Planet(planet.mean_radius_m).rho_from_altitude(self.height_m)
        start = rng.uniform(0, 2 * np.pi)
        self.views = [
            view_at_limb(camera, nadir, rho, start + k * np.pi / 2, rng.uniform(0, 6), name=str(k))
            for k, camera in enumerate(cameras)
        ]

    def nadir(self, vertical: str) -> np.ndarray:
        return self.rot_ecef_from_base.T @ self.planet.nadir_ecef(self.position, vertical)

    def pose(
        self,
        rng: np.random.Generator | None = None,
        position_sigma_m: float = 50e3,
        rotation_sigma_rad: float = float(np.radians(10.0)),
    ) -> CoarsePose:
        """Coarse pose: the true one, or with errors drawn as its sigmas say."""
        position, rot = self.position, self.rot_ecef_from_base
        if rng is not None:
            position = position + rng.normal(0, position_sigma_m, 3)
            rot = rot @ Rotation.from_rotvec(rng.normal(0, rotation_sigma_rad, 3)).as_matrix()
        return CoarsePose(position, rot, position_sigma_m, rotation_sigma_rad)

    def observations(self, sigma_px: float = 0.05, count: int = 1200) -> list[LimbObservation]:
        """Limb points without noise, from the quadric's cone."""
        azimuth = np.linspace(-np.pi, np.pi, count, endpoint=False)
        higher = Planet(
            self.planet.radius_m, self.planet.limb_height_m + 200.0, self.planet.flattening
        )
        found = []
        for view in self.views:
            rot = self.rot_ecef_from_base @ view.rot_base_from_cam
            px, ahead = (
                view.camera.pixels(self.planet.limb_rays_ecef(self.position, a) @ rot)
                for a in (azimuth, azimuth + 1e-5)
            )
            outer = view.camera.pixels(higher.limb_rays_ecef(self.position, azimuth) @ rot)
            normal = np.column_stack((px[:, 1] - ahead[:, 1], ahead[:, 0] - px[:, 0]))
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            normal *= np.sign(np.sum(normal * (outer - px), axis=1))[:, None]
            keep = np.isfinite(normal).all(axis=1) & view.camera.in_frame(px)
            sigma = np.full(int(keep.sum()), sigma_px)
            found.append(
                LimbObservation(view, LimbPoints(Status.OK, "", px[keep], normal[keep], sigma))
            )
        return found


def fitted(
    figure: Figure, observations: list[LimbObservation], method: str = "ml"
) -> tuple[HorizonFit, list[LimbObservation]]:
    seen = [LimbObservation(figure.view(o.view), o.limb) for o in observations]
    fit = fit_horizon(seen, figure.sphere, method)
    assert fit.ok, fit.reason
    return fit, seen


def solved(
    figure: Figure, observations: list[LimbObservation]
) -> tuple[HorizonFit, np.ndarray, Figure]:
    """What the chain makes of limb points: estimate, the figure's covariance, the figure."""
    figure = figure.aligned(fitted(figure, observations)[0].nadir_base)
    fit, seen = fitted(figure, observations)
    return figure.estimate(fit), figure.covariance(fit, seen), figure


# ------------------------------------------------------------------ the limb itself


def numerical_limb(planet: Planet, position: np.ndarray, azimuth: float) -> np.ndarray:
    """Ray at an azimuth about nadir that just grazes the limb's ellipsoid, by root finding."""
    nadir = -position / np.linalg.norm(position)
    basis = tangent_basis(nadir)
    outward = basis @ [np.cos(azimuth), np.sin(azimuth)]
    axes = np.array([planet.radius_m, planet.radius_m, planet.polar_radius_m])
    axes = axes + planet.limb_height_m

    def ray(angle: float) -> np.ndarray:
        return np.cos(angle) * nadir + np.sin(angle) * outward

    def miss(angle: float) -> float:
        """How far the ray's nearest point lies outside, in semi-axes."""
        start, step = position / axes, ray(angle) / axes
        nearest = start - (start @ step) / (step @ step) * step
        return float(np.linalg.norm(nearest)) - 1.0

    return ray(brentq(miss, 1e-6, np.pi / 2, xtol=1e-14))


@given(seeds, st.sampled_from([WGS84, FLAT, Planet.wgs84(3e4)]))
@settings(max_examples=60)
def test_stretched_limb_is_a_circular_cone(seed: int, planet: Planet) -> None:
    craft = Craft(seed, planet, cameras=())
    figure = StretchedEllipsoid(planet, "geocentric", craft.pose())
    rng = np.random.default_rng(seed)
    rays_ecef = np.array(
        [numerical_limb(planet, craft.position, a) for a in rng.uniform(-np.pi, np.pi, 12)]
    )
    # Any camera: here one that sees all directions as they are.
    view = CameraView("all", FISHEYE, np.eye(3))
    stretched = stretched_view(view, stretch_along(craft.rot_ecef_from_base[2], ratio(planet)))
    assert isinstance(figure.view(view).camera, type(stretched.camera))
    rays = rays_ecef @ craft.rot_ecef_from_base @ stretched.camera.stretch  # type: ignore[attr-defined]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    m = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    # On one cone about its own nadir, u . m = 1 ...
    np.testing.assert_allclose(rays @ m, 1.0, atol=1e-9)
    # ... that the estimate takes back to where the craft is.
    rho = float(np.arccos(1.0 / np.linalg.norm(m)))
    fit = HorizonFit(
        Status.OK, "", "ml", m / np.linalg.norm(m), rho, figure.sphere.altitude_from_rho(rho),
        np.zeros((4, 4)),
    )  # fmt: skip
    for vertical in VERTICALS:
        estimate = StretchedEllipsoid(planet, vertical, craft.pose()).estimate(fit)
        assert angle_rad(estimate.nadir_base, craft.nadir(vertical)) < 1e-7
        assert estimate.altitude_m == pytest.approx(craft.height_m, abs=2.0)


def stretch_along(axis: np.ndarray, ratio: float) -> np.ndarray:
    """Stretch (3, 3) along an axis (3,)."""
    return np.asarray(np.eye(3) + (ratio - 1.0) * np.outer(axis, axis))


def ratio(planet: Planet) -> float:
    return (planet.radius_m + planet.limb_height_m) / (planet.polar_radius_m + planet.limb_height_m)


@pytest.mark.parametrize("camera", CAMERAS)
def test_stretched_cameras_pixels_rays_and_jacobian(camera: Camera) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    rot = Rotation.from_euler("xyz", [0.3, 1.0, -0.4]).as_matrix()
    view = CameraView("c", camera, rot)
    stretched = stretched_view(view, stretch_along(axis, 1.1)).camera
    px = np.random.default_rng(0).uniform(50, 400, (40, 2))
    rays = stretched.rays(px)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(stretched.pixels(rays), px, atol=1e-8)
    original = camera.rays(px) @ rot.T
    longer = original + 0.1 * (original @ axis)[:, None] * axis
    longer /= np.linalg.norm(longer, axis=1, keepdims=True)
    np.testing.assert_allclose(rays @ rot.T, longer, atol=1e-13)
    again, jacobian = stretched.project(rays)
    np.testing.assert_allclose(again, px, atol=1e-8)
    np.testing.assert_array_equal(stretched.pixel_jacobian(rays), jacobian)
    expected = np.einsum("nij,ni->nj", jacobian, px)
    np.testing.assert_allclose(stretched.pixel_gradients(rays, px), expected, rtol=1e-12)
    along = np.random.default_rng(1).normal(size=rays.shape)
    again, moved = stretched.project_along(rays, along)
    np.testing.assert_allclose(again, px, atol=1e-8)
    np.testing.assert_allclose(moved, np.einsum("nij,nj->ni", jacobian, along), rtol=1e-9)
    for axis_index in range(3):
        step = np.zeros(3)
        step[axis_index] = 1e-6
        numeric = (stretched.pixels(rays + step) - stretched.pixels(rays - step)) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, axis_index], numeric, rtol=1e-5, atol=1e-3)


@given(seeds, st.sampled_from(VERTICALS), st.sampled_from([WGS84, Planet.wgs84(2e4), FLAT]))
@settings(max_examples=30)
def test_with_the_true_pose_the_chain_is_exact(seed: int, vertical: str, planet: Planet) -> None:
    craft = Craft(seed, planet)
    figure = StretchedEllipsoid(planet, vertical, craft.pose())
    estimate, _, _ = solved(figure, craft.observations())
    assert angle_rad(estimate.nadir_base, craft.nadir(vertical)) < 1e-9
    assert estimate.altitude_m == pytest.approx(craft.height_m, abs=0.1)
    assert estimate.disc is not None
    for observation in craft.observations():
        # What is drawn of the limb lies on it.
        drawn = estimate.disc.limb_px(observation.view, 7200)
        drawn = drawn[np.isfinite(drawn).all(axis=1)]
        assert cKDTree(drawn).query(observation.limb.px)[0].max() < 3.0
        off = estimate.disc.residuals_px(observation.view, observation.limb)
        assert np.abs(off).max() < 1e-6


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"chord", "chord_image", "arc"}))
def test_any_method_over_all_rays_fits_the_ellipsoid(method: str) -> None:
    craft = Craft(5)
    figure = StretchedEllipsoid(WGS84, "geodetic", craft.pose())
    estimate = figure.estimate(fitted(figure, craft.observations(), method)[0])
    assert np.degrees(angle_rad(estimate.nadir_base, craft.nadir("geodetic"))) < 1e-4


# ------------------------------------------------------------------ coarse poses


def test_a_tilt_of_the_coarse_attitude_is_measured_away() -> None:
    craft = Craft(11)
    tilt = Rotation.from_rotvec(0.2 * tangent_basis(craft.nadir("geocentric"))[:, 0]).as_matrix()
    pose = CoarsePose(craft.position, craft.rot_ecef_from_base @ tilt)
    figure = StretchedEllipsoid(WGS84, "geocentric", pose)
    estimate, _, _ = solved(figure, craft.observations())
    # What is left is second order: the first fit's axis was 11 deg off.
    assert np.degrees(angle_rad(estimate.nadir_base, craft.nadir("geocentric"))) < 1e-3


def test_a_coarse_attitude_that_the_limb_contradicts_is_not_believed() -> None:
    craft = Craft(12)
    upside_down = (
        craft.rot_ecef_from_base
        @ Rotation.from_rotvec(np.pi * tangent_basis(craft.nadir("geocentric"))[:, 0]).as_matrix()
    )
    figure = StretchedEllipsoid(WGS84, "geodetic", CoarsePose(craft.position, upside_down))
    estimate, cov, figure = solved(figure, craft.observations())
    assert isinstance(figure, MeanSphere)
    assert (
        figure.shortfall == "fitted as a sphere: the coarse pose is 180 deg off the limb's vertical"
    )
    error = angle_rad(estimate.nadir_base, craft.nadir("geodetic"))
    assert error < 4.0 * np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1])


@pytest.mark.parametrize(("off_deg", "believed"), [(4.0, True), (6.0, False)])
def test_five_sigma_contradict_an_attitude(off_deg: float, believed: bool) -> None:
    craft = Craft(12)
    tilt = np.radians(off_deg) * tangent_basis(craft.nadir("geocentric"))[:, 1]
    rot = craft.rot_ecef_from_base @ Rotation.from_rotvec(tilt).as_matrix()
    pose = CoarsePose(craft.position, rot, 1e3, float(np.radians(1.0)))
    figure = StretchedEllipsoid(WGS84, "geodetic", pose).aligned(craft.nadir("geocentric"))
    assert isinstance(figure, StretchedEllipsoid) == believed


def test_no_shortest_way_leads_from_an_attitude_of_which_nothing_is_known_upside_down() -> None:
    craft = Craft(12)
    over = np.pi * tangent_basis(craft.nadir("geocentric"))[:, 0]
    rot = craft.rot_ecef_from_base @ Rotation.from_rotvec(over).as_matrix()
    pose = CoarsePose(craft.position, rot, rotation_sigma_rad=3.2)
    estimate, cov, figure = solved(
        StretchedEllipsoid(WGS84, "geodetic", pose), craft.observations()
    )
    assert isinstance(figure, MeanSphere)
    assert nees(estimate, cov, craft.nadir("geodetic")) < 11.8


@pytest.mark.parametrize("vertical", VERTICALS)
def test_the_covariance_has_nothing_along_the_vertical_that_is_told(vertical: str) -> None:
    """The vertical of the fitted sphere is another one."""
    craft = Craft(3, FLAT)
    figure = StretchedEllipsoid(FLAT, vertical, craft.pose())
    fit = fitted(figure, craft.observations())[0]
    told = figure.estimate(fit)
    assert angle_rad(fit.nadir_base, told.nadir_base) > 1e-3
    cov = told.cov_nadir_altitude[:3, :3]
    along = [one.nadir_base @ cov @ one.nadir_base for one in (told, fit)]
    assert abs(along[0]) < 1e-3 * along[1]
    # Turned, and otherwise as it was.
    sigmas2 = [np.linalg.eigvalsh(c)[1:] for c in (cov, fit.cov_nadir_altitude[:3, :3])]
    np.testing.assert_allclose(*sigmas2, rtol=1e-6)


def nees(estimate: HorizonFit, cov: np.ndarray, nadir: np.ndarray) -> float:
    """Two degrees of freedom, with 0.003 deg of other errors: the figure's own may be singular."""
    basis = tangent_basis(nadir)
    error = basis.T @ estimate.nadir_base
    both = basis.T @ cov[:3, :3] @ basis + np.radians(0.003) ** 2 * np.eye(2)
    return float(error @ np.linalg.solve(both, error))


@pytest.mark.parametrize("vertical", VERTICALS)
def test_the_error_of_coarse_poses_is_in_the_covariance(vertical: str) -> None:
    rng = np.random.default_rng(50)
    found, errors = [], []
    for seed in range(60):
        craft = Craft(seed, cameras=(BARREL,) * (1 + seed % 2))
        figure = StretchedEllipsoid(WGS84, vertical, craft.pose(rng))
        estimate, cov, _ = solved(figure, craft.observations(count=600))
        found.append(nees(estimate, cov, craft.nadir(vertical)))
        errors.append(np.degrees(angle_rad(estimate.nadir_base, craft.nadir(vertical))))
    assert np.median(errors) < 0.02
    assert 0.5 < np.mean(found) < 2.4
    assert np.mean(np.array(found) > 11.8) < 0.05


@pytest.mark.parametrize("off_deg", [30.0, 45.0])
def test_an_attitude_far_off_the_vertical_is_not_sure_of_its_heading(off_deg: float) -> None:
    """A pose of a minute ago, say. Its heading was claimed to the ten degrees of a good one.

    A turn about the vertical alone shows itself to nobody.
    """
    rng = np.random.default_rng(51)
    found = []
    for seed in range(60):
        craft = Craft(seed, cameras=(BARREL,) * (1 + seed % 2))
        axis = rng.standard_normal(3)
        turn = Rotation.from_rotvec(np.radians(off_deg) * axis / np.linalg.norm(axis)).as_matrix()
        pose = CoarsePose(craft.position, craft.rot_ecef_from_base @ turn)
        estimate, cov, _ = solved(StretchedEllipsoid(WGS84, "geodetic", pose), craft.observations())
        found.append(nees(estimate, cov, craft.nadir("geodetic")))
    assert np.median(found) < 2.5
    assert np.mean(np.array(found) > 11.8) < 0.15


@pytest.mark.parametrize("vertical", VERTICALS)
def test_what_the_craft_flew_since_its_pose_is_in_the_covariance(vertical: str) -> None:
    """A minute along a low orbit is 450 km, nine sigma of a coarse pose, and not seen from it."""
    rng = np.random.default_rng(52)
    age_s, found, at_once = 60.0, [], []
    for seed in range(60):
        craft = Craft(seed, cameras=(BARREL,) * (1 + seed % 2), altitudes_m=(300e3, 800e3))
        distance = float(np.linalg.norm(craft.position))
        # Flown level: position and attitude turn about the planet's centre alike.
        axis = np.cross(craft.position, rng.standard_normal(3))
        orbit_rad_s = np.sqrt(3.986e14 / distance**3)
        flown = Rotation.from_rotvec(age_s * orbit_rad_s * axis / np.linalg.norm(axis)).as_matrix()
        position, rot = flown @ craft.position, flown @ craft.rot_ecef_from_base
        for age, each in ((age_s, found), (0.0, at_once)):
            pose = CoarsePose(position, rot, 1e3, 0.01, age_s=age)
            figure = StretchedEllipsoid(WGS84, vertical, pose)
            estimate, cov, _ = solved(figure, craft.observations(count=600))
            each.append(nees(estimate, cov, craft.nadir(vertical)))
    assert np.mean(found) < 2.4
    assert np.mean(at_once) > 1.5 * np.mean(found)


def test_what_the_craft_turned_since_its_pose_is_in_the_covariance() -> None:
    craft = Craft(13)
    pose = replace(craft.pose(), age_s=30.0)
    nadir = craft.nadir("geocentric")
    estimator = HorizonEstimator(HorizonConfig(planet=WGS84, rate_sigma_rad_s=0.002))

    def sigma_deg(aiding: Aiding) -> float:
        _, cov, _ = solved(estimator.figure(aiding), craft.observations())
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1])))

    unknown = sigma_deg(Aiding(pose))
    # About a horizontal axis the vertical shows it.
    along = sigma_deg(Aiding(pose, rate_base_rad_s=0.03 * tangent_basis(nadir)[:, 0]))
    about = sigma_deg(Aiding(pose, rate_base_rad_s=0.03 * nadir))
    assert along == pytest.approx(unknown, rel=0.05)
    assert about > 3.0 * along


@pytest.mark.parametrize("with_gyro", [False, True])
def test_an_attitude_is_not_contradicted_by_what_the_craft_turned_since(with_gyro: bool) -> None:
    """A star tracker's of ten seconds ago, on a craft that turns by 1 deg/s."""
    rng = np.random.default_rng(53)
    age_s, found, off_deg = 10.0, [], []
    estimator = HorizonEstimator(HorizonConfig(planet=WGS84))
    for seed in range(40):
        craft = Craft(seed, altitudes_m=(300e3, 800e3))
        rate = rng.standard_normal(3)
        rate *= np.radians(1.0) / np.linalg.norm(rate)
        back = Rotation.from_rotvec(-age_s * rate).as_matrix()
        pose = CoarsePose(craft.position, craft.rot_ecef_from_base @ back, 1e3, 0.002, age_s)
        figure = estimator.figure(Aiding(pose, rate_base_rad_s=rate if with_gyro else None))
        estimate, cov, figure = solved(figure, craft.observations(count=600))
        assert figure.shortfall == ""
        nadir = craft.nadir("geocentric")
        found.append(nees(estimate, cov, nadir))
        off_deg.append(np.degrees(angle_rad(estimate.nadir_base, nadir)))
    assert np.mean(found) < 2.4
    # As a sphere it is 0.09 deg off.
    assert np.median(off_deg) < 0.03


def test_an_attitude_is_not_contradicted_by_what_the_position_is_off_by() -> None:
    """A star tracker's, beside a position that is good to 50 km, 0.4 deg of the vertical."""
    craft = Craft(14)
    east = np.cross(craft.position, [0.0, 0.0, 1.0])
    position = craft.position + 100e3 * east / np.linalg.norm(east)
    pose = CoarsePose(position, craft.rot_ecef_from_base, 50e3, 1e-4)
    _, _, figure = solved(StretchedEllipsoid(WGS84, "geocentric", pose), craft.observations())
    assert figure.shortfall == ""


@pytest.mark.parametrize("vertical", VERTICALS)
@pytest.mark.parametrize("cameras", [1, 2])
@pytest.mark.parametrize("altitudes_m", [(300e3, 800e3), (2000e3, 6000e3)])
def test_the_error_of_the_mean_sphere_is_in_the_covariance(
    vertical: str, cameras: int, altitudes_m: tuple[float, float]
) -> None:
    found, heights = [], []
    for seed in range(60):
        craft = Craft(seed, cameras=(BARREL,) * cameras, altitudes_m=altitudes_m)
        estimate, cov, _ = solved(MeanSphere(WGS84, vertical), craft.observations(count=600))
        found.append(nees(estimate, cov, craft.nadir(vertical)))
        heights.append((estimate.altitude_m - craft.height_m) / np.sqrt(cov[3, 3] + 100.0**2))
    assert 1.5 < np.mean(found) < 2.6
    # The ellipsoid's worst is bounded, unlike a Gaussian's.
    assert max(found) < 12.0
    assert 0.7 < np.sqrt(np.mean(np.square(heights))) < 1.3
    assert np.abs(heights).max() < 3.0


def test_a_sphere_has_no_error_of_its_figure() -> None:
    craft = Craft(1, Planet())
    figure = MeanSphere(Planet(), "geodetic")
    fit, seen = fitted(figure, craft.observations())
    assert not figure.covariance(fit, seen).any()


def test_the_pole_of_nowhere_in_particular() -> None:
    k = np.random.default_rng(0).normal(size=(400_000, 3))
    k /= np.linalg.norm(k, axis=1, keepdims=True)
    i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    np.testing.assert_allclose(np.cov((k[:, i] * k[:, j]).T), ANY_POLE, atol=1e-3)


def test_poles_covariance_against_drawn_ones() -> None:
    rng = np.random.default_rng(2)
    nadir, pole = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, -0.8])
    basis = tangent_basis(nadir)
    sigmas = np.array([0.01, 0.01, 0.15])
    axes = np.column_stack((basis, nadir))
    turns = Rotation.from_rotvec(rng.normal(size=(200_000, 3)) * sigmas @ axes.T)
    k, k_mean = turns.apply(pole) @ axes, pole @ axes
    i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    off = k[:, i] * k[:, j] - k_mean[i] * k_mean[j]
    drawn = off.T @ off / len(off)
    found = pole_covariance(nadir, pole, 0.01, 0.15)
    np.testing.assert_allclose(found, drawn, atol=0.03 * np.abs(drawn).max())


@pytest.mark.parametrize("heading_rad", [0.8, 1.2, 3.2, 40.0])
def test_poles_covariance_where_the_heading_is_hardly_known(heading_rad: float) -> None:
    """A position from an orbit, and no attitude: up to the half of the error was not claimed."""
    nadir, pole = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, -0.8])
    axes = np.column_stack((tangent_basis(nadir), nadir))
    angle = np.random.default_rng(3).normal(0.0, heading_rad, 200_000)
    k = Rotation.from_rotvec(angle[:, None] * nadir).apply(pole) @ axes
    k_mean = pole @ axes
    i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    product = k[:, i] * k[:, j]
    off = product - k_mean[i] * k_mean[j]
    drawn = off.T @ off / len(off)
    found = pole_covariance(nadir, pole, 0.0, heading_rad)
    np.testing.assert_allclose(found, drawn, atol=0.02 * np.abs(drawn).max())
    # About the mean of all headings there is less.
    mean = axes.T @ mean_figure(nadir, pole, heading_rad) @ axes
    np.testing.assert_allclose(mean[i, j], product.mean(axis=0), atol=3e-3)
    found = pole_covariance(nadir, pole, 0.0, heading_rad, heading_rad)
    np.testing.assert_allclose(found, np.cov(product.T), atol=0.02 * np.abs(drawn).max())


@pytest.mark.parametrize("vertical", VERTICALS)
@pytest.mark.parametrize("rotation_sigma_deg", [60.0, 183.0])
def test_coarse_poses_without_an_attitude(vertical: str, rotation_sigma_deg: float) -> None:
    rng = np.random.default_rng(52)
    found = []
    for seed in range(60):
        craft = Craft(seed, cameras=(BARREL,) * (1 + seed % 2))
        pose = craft.pose(rng, rotation_sigma_rad=float(np.radians(rotation_sigma_deg)))
        estimate, cov, _ = solved(
            StretchedEllipsoid(WGS84, vertical, pose), craft.observations(count=600)
        )
        found.append(nees(estimate, cov, craft.nadir(vertical)))
    assert np.mean(found) < 3.0
    assert np.mean(np.array(found) > 11.8) < 0.05


@pytest.mark.parametrize("vertical", VERTICALS)
def test_the_mean_of_all_headings_is_nearer_than_one_at_random(vertical: str) -> None:
    """Of a vector of any direction the mean is as far as one sigma, another one 1.4 times that."""
    rng = np.random.default_rng(54)
    by_mean, by_one, squares = [], [], []
    for seed in range(60):
        craft = Craft(seed, cameras=(BARREL,) * 2)
        observations, nadir = craft.observations(count=600), craft.nadir(vertical)
        turned = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * nadir).as_matrix()
        told = CoarsePose(craft.position, craft.rot_ecef_from_base @ turned, 1e3, 0.01)
        for pose, errors in ((told, by_one), (replace(told, rotation_sigma_rad=3.2), by_mean)):
            estimate, cov, _ = solved(StretchedEllipsoid(WGS84, vertical, pose), observations)
            errors.append(np.linalg.norm(estimate.nadir_base - nadir))
            if errors is by_mean:
                squares.append(nees(estimate, cov, nadir))
    ratio_of = np.sqrt(np.mean(np.square(by_mean)) / np.mean(np.square(by_one)))
    assert ratio_of == pytest.approx(np.sqrt(0.5), abs=0.1)
    # And no more is claimed than that.
    assert np.mean(squares) == pytest.approx(2.0, abs=0.6)


@pytest.mark.parametrize("limb_height_m", [0.0, 3e4])
@pytest.mark.parametrize("vertical", VERTICALS)
def test_influence_against_refits_with_the_axis_moved(vertical: str, limb_height_m: float) -> None:
    # The influence is of first order: hardly flattened, nothing else is left.
    planet = Planet(6378137.0, limb_height_m, 1e-5)
    craft = Craft(21, planet)
    true = StretchedEllipsoid(planet, vertical, craft.pose())
    observations = craft.observations()
    fit, seen = fitted(true, observations)
    influence = figure_influence(fit, seen, planet, vertical)
    axes = np.column_stack((tangent_basis(fit.nadir_base), fit.nadir_base))
    i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    pole = craft.rot_ecef_from_base[2]
    right = true.estimate(fit)
    for turn in np.eye(3) * 0.02:
        moved = Rotation.from_rotvec(turn).apply(pole)
        figure = StretchedEllipsoid(planet, vertical, craft.pose(), pole_base=moved)
        wrong = figure.estimate(fitted(figure, observations)[0])
        k, k_wrong = pole @ axes, moved @ axes
        # The axis used less the true one; a few per cent are the thinned limb's.
        predicted = influence @ (k_wrong[i] * k_wrong[j] - k[i] * k[j])
        found = np.append(
            axes[:, :2].T @ (wrong.nadir_base - right.nadir_base),
            wrong.altitude_m - right.altitude_m,
        )
        np.testing.assert_allclose(predicted[:2], found[:2], atol=0.05 * np.abs(found[:2]).max())
        assert predicted[2] == pytest.approx(found[2], rel=0.02, abs=0.01)


def test_influence_of_the_cameras_and_points_that_the_fit_goes_by() -> None:
    craft = Craft(21)
    figure = MeanSphere(WGS84, "geocentric")
    one, other = craft.observations(count=20_000)
    assert min(len(each.limb.px) for each in (one, other)) > 1000
    fit = fitted(figure, [one, other])[0]

    def influence(fit: HorizonFit, *seen: LimbObservation) -> np.ndarray:
        return figure_influence(fit, seen, WGS84, "geocentric")

    def near(found: np.ndarray, expected: np.ndarray) -> None:
        for row, goal in zip(found, expected, strict=True):
            np.testing.assert_allclose(row, goal, atol=0.02 * np.abs(goal).max())

    expected = influence(fit, one, other)
    # A tenth as many points, each as sure as ten.
    few = _points(one, slice(None, None, 10), 0.1**0.5)
    near(influence(fit, few, other), expected)
    # Points far off say nothing.
    limb = one.limb
    aside = LimbPoints(
        Status.OK,
        "",
        np.vstack((limb.px, limb.px[::3] + 60.0 * limb.normal_px[::3])),
        np.vstack((limb.normal_px, limb.normal_px[::3])),
        np.concatenate((limb.sigma_px, limb.sigma_px[::3])),
    )
    near(influence(fit, LimbObservation(one.view, aside), other), expected)
    # Nor does a camera that the fit left out.
    alone = fitted(figure, [one])[0]
    np.testing.assert_array_equal(influence(alone, one, other), influence(alone, one))


def _points(observation: LimbObservation, which: slice, times: float) -> LimbObservation:
    """Some of the points, with so many times their sigma."""
    limb = observation.limb
    part = LimbPoints(
        limb.status, "", limb.px[which], limb.normal_px[which], times * limb.sigma_px[which]
    )
    return LimbObservation(observation.view, part)


# ------------------------------------------------------------------ altitudes


@pytest.mark.parametrize("vertical", VERTICALS)
def test_a_known_height_is_kept_where_nadir_moves_with_it(vertical: str) -> None:
    """From far up, on an arc, by a pose that is 50 km off: it came back as that of the latitude
    before, up to 200 m off here.
    """
    for seed in range(6):
        craft = Craft(seed, altitudes_m=(12000e3, 36000e3))
        pose = craft.pose(np.random.default_rng(seed), rotation_sigma_rad=0.01)
        frames = _arc(craft, seed)
        sensor = HorizonSensor(HorizonConfig(planet=WGS84, vertical=vertical))
        known = sensor.process(frames, Aiding(pose, AltitudeMeasurement(craft.height_m, 10.0)))
        assert known.ok, known.reason
        assert known.fit.altitude_m == pytest.approx(craft.height_m, abs=3.0)
        assert known.fit.cov_nadir_altitude[3, 3] == pytest.approx(10.0**2, rel=0.01)
        sigma = np.sqrt(np.linalg.eigvalsh(known.fit.cov_nadir_altitude[:3, :3])[-1])
        assert angle_rad(known.fit.nadir_base, craft.nadir(vertical)) < 3.0 * sigma


def _arc(craft: Craft, seed: int) -> list[Frame]:
    """One frame of a part of the planet's limb, where nadir and altitude hang together."""
    rho = WGS84.rho_from_altitude(craft.height_m)
    camera = Camera(640, 480, 800.0 / np.tan(rho), 800.0 / np.tan(rho), 319.5, 239.5)
    axes = np.column_stack((tangent_basis(craft.nadir("geocentric")), craft.nadir("geocentric")))
    aside = Rotation.from_rotvec([0.0, rho, 0.0]).as_matrix()
    view = CameraView("arc", camera, axes @ aside)
    drawn = render_views(
        (view,),
        craft.rot_ecef_from_base,
        craft.position,
        EarthScene(planet=WGS84, texture="clouds", texture_seed=seed),
        np.random.default_rng(seed),
    )
    return as_frames((view,), drawn)


# ------------------------------------------------------------------ whole scenes


@pytest.mark.parametrize("vertical", VERTICALS)
def test_the_sensor_on_a_drawn_ellipsoid(vertical: str) -> None:
    (case,) = two_camera_set(1, 3, WGS84)
    truth = case.frames[0].truth
    frames = as_frames(case.views, case.frames)
    nadir = truth.geodetic_nadir_base if vertical == "geodetic" else truth.nadir_base
    sensor = HorizonSensor(HorizonConfig(planet=WGS84, vertical=vertical))
    pose = CoarsePose(truth.position_ecef_m, truth.rot_world_from_base, 1e3, 0.01)
    fix = sensor.process(frames, Aiding(pose))
    assert fix.ok, fix.reason
    assert np.degrees(angle_rad(fix.fit.nadir_base, nadir)) < 0.01
    assert fix.fit.altitude_m == pytest.approx(truth.altitude_m, abs=1e3)
    for view, frame, limb in zip(case.views, frames, fix.limbs, strict=True):
        assert isinstance(frame, Frame)
        assert 0.0 < fix.residual_px(view, limb) < 0.5
    # An altitude known to 10 m is kept, and says nothing against the rest.
    known = sensor.process(frames, Aiding(pose, AltitudeMeasurement(truth.altitude_m, 10.0)))
    assert known.fit.altitude_m == pytest.approx(truth.altitude_m, abs=3.0)
    assert known.fit.cov_nadir_altitude[3, 3] < 10.0**2
    assert np.degrees(angle_rad(known.fit.nadir_base, nadir)) < 0.01


def test_what_is_kept_of_one_pose_is_not_taken_for_another() -> None:
    """The limb of a camera is drawn with what was kept of the last one; pixels are alike here."""
    view = view_at_limb(BARREL, np.array([0.0, 0.0, 1.0]), 1.2, 0.0)
    nadir = view.rot_base_from_cam @ np.array([0.05, 0.6, 0.8])
    nadir /= np.linalg.norm(nadir)
    one, other = (
        stretched_view(view, stretch_along(axis, 1.0 / 0.9)) for axis in np.eye(3)[[0, 2]]
    )
    assert one.camera != other.camera
    limb_curve(other, nadir, 1.2)
    after = limb_curve(one, nadir, 1.2)
    alone = limb_curve(stretched_view(view, stretch_along(np.eye(3)[0], 1.0 / 0.9)), nadir, 1.2)
    np.testing.assert_array_equal(after.px, alone.px)


@pytest.mark.parametrize("vertical", VERTICALS)
def test_the_shared_ellipsoid(vertical: str, shared_data: Path) -> None:
    truth = shared_truths(shared_data)["wgs840"]
    pose = CoarsePose(np.array(truth["position_ecef_km"]) * 1e3, np.array(truth["world_from_body"]))
    sensor = HorizonSensor(HorizonConfig(planet=WGS84, vertical=vertical))
    frames = shared_frames(shared_data, truth)
    nadir = truth["geodetic_nadir_body" if vertical == "geodetic" else "nadir_body"]
    fix = sensor.process(frames, Aiding(pose))
    assert np.degrees(angle_rad(fix.fit.nadir_base, np.array(nadir))) < 0.02
    # Without the position the sphere's error is large, and in the covariance.
    alone = sensor.process(frames)
    error = angle_rad(alone.fit.nadir_base, np.array(nadir))
    sigma = np.sqrt(np.linalg.eigvalsh(alone.fit.cov_nadir_altitude[:3, :3])[-1])
    assert error < 3.0 * sigma

"""Every fit against the cone its points were made from, and against bad data."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limb_samples import BARREL, CAMERAS, FISHEYE, PINHOLE, cone_rays, observe, view_at_limb
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits import METHODS, HorizonFit, LimbObservation, fit_horizon
from horizon_sensor_ros.core.fits.arc import fit_arc, fit_circle
from horizon_sensor_ros.core.fits.assessment import correlation_factor
from horizon_sensor_ros.core.fits.gauss_newton import solve_roll_pitch_rho
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

PLANET = Planet()
EXACT = ("chord", "gauss_newton", "cone", "ml")
NADIR = np.array([0.3, -0.5, 0.81]) / np.linalg.norm([0.3, -0.5, 0.81])

directions = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: np.array(v) / np.linalg.norm(v))
)
angles = st.floats(-np.pi, np.pi)


def pair(
    camera: Camera,
    altitude_m: float,
    nadir: np.ndarray = NADIR,
    noise: np.random.Generator | None = None,
    sigma_px: float = 0.1,
    spacing_px: float = 2.0,
) -> list[LimbObservation]:
    """Two cameras a quarter of the limb apart."""
    rho = PLANET.rho_from_altitude(altitude_m)
    return [
        observe(
            view_at_limb(camera, nadir, rho, 0.3 + index * np.pi / 2, 0.4 + index, 0.0, name),
            nadir,
            rho,
            sigma_px,
            noise,
            spacing_px,
        )
        for index, name in enumerate(("camera_1", "camera_2"))
    ]


def moved(
    observation: LimbObservation, across_px: np.ndarray, sigma_px: float | None = None
) -> LimbObservation:
    limb = observation.limb
    sigma = limb.sigma_px if sigma_px is None else np.full(len(limb.px), sigma_px)
    px = limb.px + limb.normal_px * across_px[:, None]
    return LimbObservation(observation.view, LimbPoints(Status.OK, "", px, limb.normal_px, sigma))


def assert_no_estimate(fit: HorizonFit) -> None:
    assert not fit.ok
    assert fit.reason
    assert np.isnan(fit.nadir_base).all()
    assert np.isnan([fit.rho_rad, fit.altitude_m, fit.rms_residual_px]).all()
    assert np.isnan(fit.cov_nadir_altitude).all()


# ---------------------------------------------------------------- exact points, exact answers


@settings(max_examples=60)
@given(
    directions,
    st.floats(np.log(2e4), np.log(4e7)),
    st.sampled_from(CAMERAS),
    angles,
    angles,
    st.floats(-0.1, 0.1),
)
def test_two_cameras_any_attitude_any_altitude_any_model(
    nadir: np.ndarray,
    log_altitude: float,
    camera: Camera,
    azimuth: float,
    roll: float,
    offset: float,
) -> None:
    altitude = float(np.exp(log_altitude))
    rho = PLANET.rho_from_altitude(altitude)
    observations = [
        observe(view_at_limb(camera, nadir, rho, azimuth, roll, offset, "a"), nadir, rho),
        observe(view_at_limb(camera, nadir, rho, azimuth + 1.7, 0.1, -offset, "b"), nadir, rho),
    ]
    for method in EXACT:
        fit = fit_horizon(observations, PLANET, method)
        if method == "chord" and fit.status is Status.ILL_CONDITIONED:
            continue  # two wide arcs may have parallel chords
        assert fit.status is Status.OK, (method, fit.reason)
        assert angle_rad(fit.nadir_base, nadir) < 1e-9
        assert fit.rho_rad == pytest.approx(rho, abs=1e-9)
        assert fit.altitude_m == pytest.approx(altitude, rel=1e-6)
        assert fit.rms_residual_px < 1e-5
        assert fit.cameras == ("a", "b")
        assert fit.num_inliers == fit.num_points
        cov = fit.cov_nadir_altitude
        assert np.all(np.linalg.eigvalsh(cov[:3, :3])[1:] > 0)
        assert cov[3, 3] > 0
        assert np.abs(cov[:3, :3] @ fit.nadir_base).max() < 1e-12 * np.trace(cov[:3, :3]) + 1e-20


@settings(max_examples=40)
@given(directions, st.floats(np.log(2e4), np.log(4e7)), st.sampled_from(CAMERAS), angles, angles)
def test_one_camera_any_attitude_any_altitude_any_model(
    nadir: np.ndarray, log_altitude: float, camera: Camera, azimuth: float, roll: float
) -> None:
    altitude = float(np.exp(log_altitude))
    rho = PLANET.rho_from_altitude(altitude)
    observations = [observe(view_at_limb(camera, nadir, rho, azimuth, roll), nadir, rho, 0.02)]
    for method in ("gauss_newton", "cone", "ml"):
        fit = fit_horizon(observations, PLANET, method)
        assert fit.status is Status.OK, (method, fit.reason)
        assert angle_rad(fit.nadir_base, nadir) < 1e-8
        assert fit.altitude_m == pytest.approx(altitude, rel=1e-5)


def test_limb_height_is_part_of_the_disc() -> None:
    hazy = Planet(6371000.0, 15000.0)
    rho = hazy.rho_from_altitude(4e5)
    view = view_at_limb(PINHOLE, NADIR, rho, 0.0)
    fit = fit_horizon([observe(view, NADIR, rho)], hazy)
    assert fit.altitude_m == pytest.approx(4e5, rel=1e-6)


# ---------------------------------------------------------------- paper A: chords


def test_chord_in_the_image_is_exact_only_for_ends_equally_far_from_the_axis() -> None:
    rho = PLANET.rho_from_altitude(3e5)
    camera = Camera(800, 800, 500.0, 500.0, 399.5, 399.5)
    upright = [view_at_limb(camera, NADIR, rho, k * np.pi / 2, 0.0, 0.0, str(k)) for k in (0, 1)]
    tilted = [view_at_limb(camera, NADIR, rho, k * np.pi / 2, 0.5, 0.1, str(k)) for k in (0, 1)]
    for views, method, low, high in (
        (upright, "chord_image", 0.0, 1e-4),
        (tilted, "chord_image", 1e-2, 0.2),
        (tilted, "chord", 0.0, 1e-9),
    ):
        fit = fit_horizon([observe(view, NADIR, rho) for view in views], PLANET, method)
        assert fit.ok, fit.reason
        error = angle_rad(fit.nadir_base, NADIR)
        assert low <= error < high
        # The approximation is part of the covariance.
        assert error < 4 * np.sqrt(np.trace(fit.cov_nadir_altitude[:3, :3])) + 1e-9


def test_chord_needs_two_cameras_and_chords_that_cross() -> None:
    observations = pair(BARREL, 5e5)
    one = fit_horizon(observations[:1], PLANET, "chord")
    assert one.status is Status.ILL_CONDITIONED
    assert_no_estimate(one)
    rho = PLANET.rho_from_altitude(5e5)
    opposite = [
        observe(view_at_limb(PINHOLE, NADIR, rho, azimuth, 0.2, 0.0, str(azimuth)), NADIR, rho)
        for azimuth in (0.0, np.pi)
    ]
    assert fit_horizon(opposite, PLANET, "chord").status is Status.ILL_CONDITIONED
    assert fit_horizon(opposite, PLANET, "ml").ok


def test_chord_survives_wild_points_at_its_ends() -> None:
    observations = pair(PINHOLE, 5e5)
    for index in (0, 1):
        across = np.zeros(len(observations[index].limb.px))
        across[[0, 1, -1]] = 60.0, -50.0, 80.0
        observations[index] = moved(observations[index], across)
    fit = fit_horizon(observations, PLANET, "chord")
    assert fit.ok
    assert angle_rad(fit.nadir_base, NADIR) < 1e-3


# ---------------------------------------------------------------- paper B: arcs


def test_circle_through_points_of_a_circle() -> None:
    angle = np.linspace(0.2, 0.9, 30)
    points = np.column_stack((3 + 5 * np.cos(angle), -2 + 5 * np.sin(angle)))
    centre, radius = fit_circle(points)
    assert centre == pytest.approx(np.array([3, -2]), abs=1e-9)
    assert radius == pytest.approx(5, abs=1e-9)
    assert np.isnan(fit_circle(np.column_stack((angle, 2 * angle)))[1])
    assert np.isnan(fit_circle(np.zeros((5, 2)))[1])


@settings(max_examples=40)
@given(st.floats(0.2, 1.45), st.floats(-0.3, 0.3))
def test_radius_of_curvature_at_the_limbs_vertex_is_tan_rho(rho: float, vertex: float) -> None:
    """What the arc fit rests on, from three neighbouring points of the exact cone."""
    eta = rho + vertex
    nadir = np.array([np.sin(eta), 0.0, np.cos(eta)])
    axis_point = np.array([np.sin(vertex), 0, np.cos(vertex)])
    turn = Rotation.from_rotvec(np.outer([-1e-3, 0, 1e-3], nadir))
    rays = turn.apply(axis_point)
    centre, radius = fit_circle(rays[:, :2] / rays[:, 2:])
    assert radius == pytest.approx(np.tan(rho), rel=1e-3)
    assert centre[0] == pytest.approx(np.tan(vertex) + np.tan(rho), rel=1e-3)


@pytest.mark.parametrize("altitude", [3e5, 3e6])
def test_arc_is_good_on_the_axis_and_honest_off_it(altitude: float) -> None:
    rho = PLANET.rho_from_altitude(altitude)
    narrow = Camera(640, 480, 2500.0, 2500.0, 319.5, 239.5)
    for camera, offset, limit in ((narrow, 0.0, 0.2), (PINHOLE, 0.05, 3.0)):
        view = view_at_limb(camera, NADIR, rho, 0.4, 0.3, offset)
        fit = fit_horizon([observe(view, NADIR, rho, 0.01)], PLANET, "arc")
        assert fit.ok, fit.reason
        error = angle_rad(fit.nadir_base, NADIR)
        assert np.degrees(error) < limit
        assert error < 4 * np.sqrt(np.trace(fit.cov_nadir_altitude[:3, :3]))


def test_arc_with_known_altitude_and_with_two_cameras_is_better() -> None:
    observations = pair(PINHOLE, 4e5)
    alone = fit_arc(observations[:1], PLANET)
    known = fit_arc(observations[:1], PLANET, altitude_m=4e5)
    both = fit_arc(observations, PLANET)
    error = [np.degrees(angle_rad(fit.nadir_base, NADIR)) for fit in (alone, known, both)]
    assert error[1] < 0.3 * error[0]
    assert error[2] < 0.1
    assert known.altitude_m == pytest.approx(4e5)


def test_arc_of_a_whole_disc_seen_from_straight_above() -> None:
    rho = PLANET.rho_from_altitude(1.5e7)
    camera = Camera(600, 600, 600.0, 600.0, 299.5, 299.5)
    view = CameraView("camera_1", camera, np.eye(3))
    fit = fit_horizon([observe(view, np.array([0, 0, 1.0]), rho)], PLANET, "arc")
    assert fit.ok
    assert angle_rad(fit.nadir_base, np.array([0, 0, 1.0])) < 1e-6
    assert fit.altitude_m == pytest.approx(1.5e7, rel=1e-6)


# ---------------------------------------------------------------- paper C: Gauss-Newton

PAPER_C = [
    (3e6, 20, 30, 60, 400),
    (6e6, 20, 30, 40, 400),
    (6e6, 20, 30, 80, 400),
    (6e6, 20, 30, 40, 50),
    (6e6, 20, 30, 80, 50),
]


@pytest.mark.parametrize(("altitude", "roll", "pitch", "field_of_view", "size"), PAPER_C)
@pytest.mark.parametrize("whole_pixels", [False, True])
def test_paper_c_converges_in_five_steps_from_zero(
    altitude: float, roll: float, pitch: float, field_of_view: float, size: int, whole_pixels: bool
) -> None:
    rho = PLANET.rho_from_altitude(altitude)
    nadir = Rotation.from_euler("ZYX", [0, pitch, roll], degrees=True).inv().apply([0, 0, 1])
    focal = size / 2 / np.tan(np.radians(field_of_view / 2))
    middle = (size - 1) / 2
    view = CameraView("c", Camera(size, size, focal, focal, middle, middle), np.eye(3))
    observation = observe(view, nadir, rho, 0.3, None, 1.0)
    px = np.round(observation.limb.px) if whole_pixels else observation.limb.px
    states, converged = solve_roll_pitch_rho(view.camera.rays(px))
    assert converged
    assert states[0] == pytest.approx([0, 0, np.pi / 2])
    assert len(states) - 1 <= 5
    tolerance_deg = (0.5 if size == 50 else 0.1) if whole_pixels else 1e-7
    assert np.degrees(states[-1, :2]) == pytest.approx([roll, pitch], abs=tolerance_deg)
    limb = LimbPoints(Status.OK, "", px, observation.limb.normal_px, observation.limb.sigma_px)
    fit = fit_horizon([LimbObservation(view, limb)], PLANET, "gauss_newton")
    assert fit.ok, fit.reason
    assert len(fit.history) - 1 <= 5
    assert fit.history[-1, :3] == pytest.approx(fit.nadir_base)
    assert angle_rad(fit.nadir_base, nadir) < np.radians(2 * tolerance_deg)
    assert fit.altitude_m == pytest.approx(altitude, rel=0.03 if whole_pixels else 1e-8)


def test_gauss_newton_has_no_forbidden_pitch() -> None:
    rho = PLANET.rho_from_altitude(5e5)
    for nadir in (np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]), np.array([0, 0, -1.0])):
        view = view_at_limb(PINHOLE, nadir, rho, 1.0, 0.3)
        fit = fit_horizon([observe(view, nadir, rho)], PLANET, "gauss_newton")
        assert fit.ok, fit.reason
        assert angle_rad(fit.nadir_base, nadir) < 1e-9


# ---------------------------------------------------------------- bad data never raises


@pytest.mark.parametrize("method", METHODS)
def test_nothing_to_fit(method: str) -> None:
    view = view_at_limb(PINHOLE, NADIR, 1.2, 0.0)
    none = LimbObservation(view, LimbPoints.none(Status.NO_LIMB, "dark"))
    bad = np.full((20, 2), np.nan)
    nan = LimbObservation(view, LimbPoints(Status.OK, "", bad, bad, np.ones(20)))
    for observations in ([], [none], [none, none], [nan], [nan, none]):
        fit = fit_horizon(observations, PLANET, method)
        assert fit.status is Status.TOO_FEW_POINTS
        assert fit.method == method
        assert_no_estimate(fit)


@pytest.mark.parametrize("method", METHODS)
def test_unusable_points_are_left_out(method: str) -> None:
    observations = pair(BARREL, 6e5)
    limb = observations[0].limb
    px, normal, sigma = limb.px.copy(), limb.normal_px.copy(), limb.sigma_px.copy()
    px[3], px[4, 1], normal[5], sigma[6], sigma[7] = np.nan, np.inf, np.nan, 0.0, np.nan
    normal[8] = 0.0
    spoilt = LimbObservation(observations[0].view, LimbPoints(Status.OK, "", px, normal, sigma))
    fit = fit_horizon([spoilt, observations[1]], PLANET, method)
    assert fit.ok, fit.reason
    assert fit.num_points == len(limb.px) + len(observations[1].limb.px)
    assert fit.num_inliers <= fit.num_points - 6
    reference = fit_horizon(observations, PLANET, method)
    assert angle_rad(fit.nadir_base, reference.nadir_base) < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_a_blind_camera_changes_nothing_for_the_others(method: str) -> None:
    observations = pair(PINHOLE, 6e5)
    blind_view = view_at_limb(PINHOLE, NADIR, 0.3, 0.0, 0.0, 0.0, "blind")
    blind = LimbObservation(blind_view, LimbPoints.none(Status.NO_LIMB, "dark"))
    with_blind = fit_horizon([blind, *observations], PLANET, method)
    without = fit_horizon(observations, PLANET, method)
    assert with_blind.cameras == without.cameras == ("camera_1", "camera_2")
    assert with_blind.nadir_base == pytest.approx(without.nadir_base, abs=1e-12)


degenerate = {
    "one place": np.tile([[200.0, 200.0]], (50, 1)),
    "a straight line": np.column_stack((np.linspace(100, 500, 50), np.full(50, 238.9))),
    "two clusters": np.repeat([[100.0, 100.0], [400.0, 300.0]], 25, axis=0),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", degenerate)
def test_degenerate_points_give_a_status_or_large_uncertainty(method: str, name: str) -> None:
    px = degenerate[name]
    normal = np.tile([[0.0, -1.0]], (len(px), 1))
    limb = LimbPoints(Status.OK, "", px, normal, np.full(len(px), 0.1))
    view = view_at_limb(PINHOLE, NADIR, 1.2, 0.0)
    assert_no_estimate(fit_horizon([LimbObservation(view, limb)], PLANET, method))


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.floats(0, 640), st.floats(0, 480), angles), min_size=1, max_size=60),
    st.sampled_from(list(METHODS)),
)
def test_any_rubbish_is_survived(points: list[tuple[float, float, float]], method: str) -> None:
    array = np.array(points)
    normal = np.column_stack((np.cos(array[:, 2]), np.sin(array[:, 2])))
    limb = LimbPoints(Status.OK, "", array[:, :2], normal, np.full(len(array), 0.2))
    views = [view_at_limb(camera, NADIR, 1.2, k, 0.1, 0, str(k))
             for k, camera in enumerate((BARREL, FISHEYE))]  # fmt: skip
    fit = fit_horizon([LimbObservation(view, limb) for view in views], PLANET, method)
    if fit.ok:
        assert np.all(np.isfinite(fit.cov_nadir_altitude))
        assert np.isfinite(fit.altitude_m)
    else:
        assert_no_estimate(fit)


@pytest.mark.parametrize("method", METHODS)
def test_normals_pointing_into_the_planet_are_the_wrong_polarity(method: str) -> None:
    turned = [
        LimbObservation(
            o.view, LimbPoints(Status.OK, "", o.limb.px, -o.limb.normal_px, o.limb.sigma_px)
        )
        for o in pair(PINHOLE, 2e6)
    ]
    fit = fit_horizon(turned, PLANET, method)
    assert fit.status is Status.WRONG_POLARITY
    assert_no_estimate(fit)


@pytest.mark.parametrize("method", ["gauss_newton", "cone", "ml"])
def test_points_all_over_the_place_are_a_poor_fit(method: str) -> None:
    rng = np.random.default_rng(5)
    scattered = [moved(o, rng.normal(0, 25, len(o.limb.px))) for o in pair(PINHOLE, 5e5)]
    fit = fit_horizon(scattered, PLANET, method)
    assert fit.status is Status.POOR_FIT
    assert_no_estimate(fit)


def test_an_unknown_method_is_the_callers_bug() -> None:
    with pytest.raises(ValueError, match="unknown method 'magic'"):
        fit_horizon([], PLANET, "magic")


def test_history_of_closed_forms_is_empty_and_of_iterations_ends_at_the_answer() -> None:
    observations = pair(BARREL, 5e5, noise=np.random.default_rng(1))
    for method in METHODS:
        fit = fit_horizon(observations, PLANET, method)
        if method in ("gauss_newton", "ml"):
            assert fit.history.shape[0] > 1
            assert fit.history[-1] == pytest.approx(np.append(fit.nadir_base, fit.rho_rad))
        else:
            assert fit.history.shape == (0, 4)


def test_sampler_itself_lies_on_the_cone() -> None:
    azimuth = np.linspace(-3, 3, 7)
    assert cone_rays(NADIR, 0.7, azimuth) @ NADIR == pytest.approx(np.full(7, np.cos(0.7)))


def _factors(number: int, correlation: float, times: int = 400) -> np.ndarray:
    rng = np.random.default_rng(6)
    drawn = rng.standard_normal((times, number))
    for i in range(1, number):
        drawn[:, i] = correlation * drawn[:, i - 1] + np.sqrt(1 - correlation**2) * drawn[:, i]
    design = np.vander(np.linspace(-1.0, 1.0, number), 3)
    left = drawn - drawn @ design @ np.linalg.pinv(design)
    cameras = np.zeros(number, dtype=int)
    return np.array([max(correlation_factor(each, cameras), 1.0) for each in left])


def test_correlation_of_few_residuals_counts_where_it_is_more_than_chance() -> None:
    """Against autoregressive residuals, what three unknowns fit taken out of them; sums of three
    of correlation r have 1 + 4/3 r + 2/3 r^2 times the variance of independent ones.
    """
    assert np.all(_factors(23, 0.6) == 1.0)
    assert _factors(31, 0.0).mean() < 1.1
    assert 1.1 < np.median(_factors(31, 0.7)) < 1.0 + 4.0 / 3.0 * 0.7 + 2.0 / 3.0 * 0.49
    assert np.median(_factors(240, 0.5)) == pytest.approx(3.0, abs=0.4)  # (1 + r) / (1 - r)

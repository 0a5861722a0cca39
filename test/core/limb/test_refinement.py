"""The limb to a small part of a pixel: against drawn limbs, analytic edges and a second method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import CAMERA, PLANET, as_frames, clouds, distance_px, draw, limb_views
from limb_samples import BARREL, cone_rays
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import map_coordinates
from scipy.special import ndtr

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.limb_rays import rays_of
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge import model as edge_model
from horizon_sensor_ros.core.limb.edge.model import (
    EdgeLook,
    Texture,
    edge_profile,
    tables_of,
    texture_covariance,
)
from horizon_sensor_ros.core.limb.edge.places import place_edges
from horizon_sensor_ros.core.limb.edge.steepest import steepest_fall
from horizon_sensor_ros.core.limb.edge_by_edge.modelled import _drift_px
from horizon_sensor_ros.core.limb.profiles import (
    Bundles,
    EdgePlaces,
    ProfileGrid,
    pixel_noise,
    sample_profiles,
)
from horizon_sensor_ros.core.limb.refinement import refine_limb
from horizon_sensor_ros.core.limb.sample import RefinePass
from horizon_sensor_ros.core.limb.search.working_image import reduce_image
from horizon_sensor_ros.core.limb_curve import LimbCurve
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.earth_scene import Imaging

NADIR = np.array([0.0, 0.0, 1.0])
SEARCH = RefinePass(reach_px=8.0, grid_px=0.5, spacing_px=4.0)
APPROACH = RefinePass(reach_px=2.0, grid_px=0.25, spacing_px=2.0)
FINAL = RefinePass(reach_px=1.0, grid_px=0.125, spacing_px=1.0)
GRID = ProfileGrid(-8.0, 17, 2.0, 0.25)
# PSF of 0.7 px and the pixel's own width
BLUR_PX = np.hypot(0.7, 1 / np.sqrt(12))
SHARP = EdgeLook(float(BLUR_PX), 0.0)


def refine(
    image: np.ndarray, view: CameraView, altitude_m: float, turn_rad: float = 0.0
) -> LimbPoints:
    """The three passes, each around a limb that is off by `turn_rad` about the base's x axis."""
    rho = PLANET.rho_from_altitude(altitude_m)
    nadir = np.array([0.0, np.sin(turn_rad), np.cos(turn_rad)])
    _, looks = refine_limb(image, view, nadir, rho, SEARCH)
    assert looks
    for step in (APPROACH, FINAL):
        limb, looks = refine_limb(image, view, NADIR, rho, step, looks)
    return limb


def blurred_edges(
    offset_px: np.ndarray, d_px: np.ndarray, step: float, psf_px: float = float(BLUR_PX)
) -> np.ndarray:
    return 5.0 + step * ndtr((offset_px[:, None] - d_px) / psf_px)


# ---------------------------------------------------------------- drawn limbs


@pytest.mark.parametrize("altitude_m", [350e3, 3000e3])
@pytest.mark.parametrize("camera", [CAMERA, BARREL], ids=["pinhole", "barrel"])
def test_uniform_planet_to_hundredths_of_a_pixel(altitude_m: float, camera: object) -> None:
    views = limb_views(altitude_m, camera)  # type: ignore[arg-type]
    scatter = []
    for noise in (0.0, 2.0, 5.0):
        imaging = Imaging(noise_dn=noise, bits=12)
        frame = draw(views, altitude_m, None, imaging)[0]
        limb = refine(frame.image, views[0], altitude_m)
        assert limb.status is Status.OK
        assert len(limb.px) * limb.spacing_px > 350
        distance = distance_px(frame.truth.limb, limb.px)
        assert abs(distance.mean()) < 0.02
        scatter.append(distance.std())
        # the claimed sigmas are what the points scatter by
        if noise > 0:
            assert 0.6 < np.sqrt(np.mean((distance / limb.sigma_px) ** 2)) < 1.4
    # without noise interpolation and the drawing's own sub-samples remain
    assert scatter[0] < 0.045
    assert scatter[1] < 0.045
    assert scatter[2] < 0.1


def test_error_grows_with_noise_as_claimed() -> None:
    """Noise is measured in space, which must not be clipped at zero; where it is, the fit's own
    residuals say more than these sigmas.
    """
    views = limb_views(600e3)
    claimed, actual = [], []
    for noise in (2.0, 4.0, 8.0):
        frame = draw(views, 600e3, None, Imaging(noise_dn=noise, background_dn=30.0))[0]
        limb = refine(frame.image, views[0], 600e3)
        claimed.append(np.median(limb.sigma_px))
        actual.append(1.4826 * np.median(np.abs(distance_px(frame.truth.limb, limb.px))))
    assert claimed[2] / claimed[0] == pytest.approx(4.0, rel=0.4)
    assert np.all(np.array(actual) < 1.3 * np.array(claimed))
    assert np.all(np.array(actual) > 0.6 * np.array(claimed))


def clouded_distances(noise_dn: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Distance and sigma of limb points of six clouded frames, none of them saturated."""
    out = []
    for seed in range(6):
        altitude = (400e3, 800e3, 2000e3)[seed % 3]
        views = limb_views(altitude, azimuths_rad=(0.9 * seed,))
        scene = replace(clouds(seed), cloud_dn=215.0)
        frame = draw(views, altitude, scene, Imaging(noise_dn=noise_dn), seed)[0]
        limb = refine(frame.image, views[0], altitude)
        assert limb.status is Status.OK
        out.append((distance_px(frame.truth.limb, limb.px), limb.sigma_px))
    return out


def test_texture_beside_the_limb_moves_it_little() -> None:
    """The claim for clouds: a bias of a small part of a pixel, and sigmas that say so."""
    measured = clouded_distances(3.0)
    bias = [np.average(distance, weights=sigma**-2.0) for distance, sigma in measured]
    assert np.max(np.abs(bias)) < 0.26
    assert abs(np.mean(bias)) < 0.12
    for distance, sigma in measured:
        assert np.median(np.abs(distance)) < 0.3
        assert np.median(np.abs(distance / sigma)) < 2.5 * 0.6745
        assert np.median(sigma) > 0.02  # not that of a clean edge


def test_clouds_of_full_contrast_move_a_whole_limb_as_far_as_claimed() -> None:
    """Each camera's limb is off by what no other point of it shows: two cameras' nadir turns."""
    squares = []
    for seed in range(12):
        altitude_m = 350e3 + 60e3 * seed
        views = limb_views(altitude_m, azimuths_rad=(0.0, 1.5), above_rad=0.05)
        scene = clouds(seed, 0.35 + 0.05 * (seed % 6))
        drawn = draw(views, altitude_m, scene, Imaging(noise_dn=3.0), seed)
        fix = HorizonSensor().process(as_frames(views, drawn))
        for frame, limb in zip(drawn, fix.limbs, strict=True):
            if limb.status is not Status.OK:
                continue
            weight = limb.sigma_px**-2.0
            off_px = np.average(distance_px(frame.truth.limb, limb.px), weights=weight)
            own2 = 1.0 / weight.sum() + limb.shared.coherent_px**2 / 6.0
            squares.append(off_px**2 / (limb.shared.shift_px**2 + own2))
    assert len(squares) >= 20
    assert 0.2 < np.mean(squares) < 3.0


def test_no_point_claims_more_than_its_noise_allows() -> None:
    """A step over noise of some hundred at most places no edge to a thousandth of a pixel."""
    for distance, sigma in clouded_distances(2.0):
        assert len(distance) == len(sigma)
        assert sigma.min() > 1e-3


def test_prediction_may_be_pixels_off() -> None:
    views = limb_views(500e3)
    frame = draw(views, 500e3)[0]
    exact = refine(frame.image, views[0], 500e3)
    for turn_px in (-5.0, 5.0):
        limb = refine(frame.image, views[0], 500e3, turn_px / CAMERA.fx)
        assert abs(distance_px(frame.truth.limb, limb.px).mean()) < 0.02
        assert len(limb.px) > 0.95 * len(exact.px)


def test_search_finds_the_limb_from_afar_in_a_reduced_image() -> None:
    """The first pass in an image of half the size; its pixels come back in the full image's."""
    views = limb_views(500e3)
    frame = draw(views, 500e3)[0]
    small = frame.image.reshape(240, 2, 320, 2).mean(axis=(1, 3))
    small = np.rint(small).astype(np.uint8)
    rho = PLANET.rho_from_altitude(500e3) + 9.0 / CAMERA.fx
    limb, _ = refine_limb(small, views[0], NADIR, rho, replace(SEARCH, factor=2))
    distance = distance_px(frame.truth.limb, limb.px)
    assert abs(np.median(distance)) < 0.1
    assert np.percentile(np.abs(distance), 95) < 0.5
    assert np.median(np.linalg.norm(np.diff(limb.px, axis=0), axis=1)) == pytest.approx(
        8.0, rel=0.1
    )


def test_gray_levels_of_16_bits_give_the_same_points() -> None:
    views = limb_views(700e3)
    frame = draw(views, 700e3, clouds(4), Imaging(noise_dn=2.0))[0]
    rho = PLANET.rho_from_altitude(700e3)
    for image in (frame.image.astype(np.uint16) * np.uint16(f) for f in (16, 257)):
        first, looks = refine_limb(frame.image, views[0], NADIR, rho, APPROACH, (SHARP,))
        other, other_looks = refine_limb(image, views[0], NADIR, rho, APPROACH, (SHARP,))
        assert looks == other_looks
        assert len(other.px) == len(first.px)
        assert np.abs(other.px - first.px).max() < 5e-3
        np.testing.assert_allclose(other.sigma_px, first.sigma_px, rtol=0.01)


def test_normals_and_order_are_the_limbs() -> None:
    views = limb_views(500e3)
    frame = draw(views, 500e3)[0]
    limb = refine(frame.image, views[0], 500e3)
    truth = frame.truth.limb
    nearest = np.argmin(((limb.px[:, None] - truth.px[None]) ** 2).sum(axis=2), axis=1)
    np.testing.assert_allclose(limb.normal_px, truth.normal_px[nearest], atol=2e-3)
    apart = limb.spacing_px / np.median(np.linalg.norm(np.diff(truth.px, axis=0), axis=1))
    np.testing.assert_allclose(np.diff(nearest), apart, rtol=0.4)


def hidden_limb(frame: SimFrame) -> np.ndarray:
    image = frame.image.copy()
    image[:] = 4
    return image


def test_no_edge_where_one_should_be() -> None:
    views = limb_views(500e3)
    frame = draw(views, 500e3)[0]
    rho = PLANET.rho_from_altitude(500e3)
    rng = np.random.default_rng(0)
    noise = np.rint(rng.normal(20.0, 3.0, frame.image.shape)).astype(np.uint8)
    for image in (hidden_limb(frame), np.full_like(frame.image, 255), noise):
        for looks in ((), (SHARP,)):
            limb, seen = refine_limb(image, views[0], NADIR, rho, APPROACH, looks)
            assert limb.status is Status.NO_LIMB
            assert limb.reason
            assert len(limb.px) == 0
            assert seen == ()


def test_inverted_planet_is_no_limb() -> None:
    """Dark inside, bright outside: an edge, but none of a planet."""
    views = limb_views(500e3)
    frame = draw(views, 500e3)[0]
    rho = PLANET.rho_from_altitude(500e3)
    for looks in ((), (SHARP,)):
        limb, _ = refine_limb(255 - frame.image, views[0], NADIR, rho, APPROACH, looks)
        assert limb.status is Status.NO_LIMB


def test_limb_out_of_the_frame() -> None:
    views = limb_views(500e3, above_rad=1.0)
    frame = draw(views, 500e3)[0]
    limb, looks = refine_limb(frame.image, views[0], NADIR, PLANET.rho_from_altitude(500e3), FINAL)
    assert limb.status is Status.NO_LIMB
    assert "not in the frame" in limb.reason
    assert looks == ()


# ---------------------------------------------------------------- profiles


def straight_curve(count: int, angle_rad: float) -> LimbCurve:
    """Points along a line through (100, 80), with the normal at an angle."""
    normal = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    along = np.array([-normal[1], normal[0]])
    px = np.array([100.0, 80.0]) + np.arange(-count // 2, count // 2)[:, None] * along
    return LimbCurve(px, np.tile(normal, (len(px), 1)), spacing_px=1.0)


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0, -1.3])
def test_profiles_against_a_spline(angle: float) -> None:
    y, x = np.mgrid[:160, :200]
    image = 30000.0 + 9000.0 * np.sin(0.7 * x + 0.3 * y) + 12000.0 * np.cos(0.2 * x - 0.5 * y)
    gray = np.rint(image).astype(np.uint16)
    curve, d_px = straight_curve(40, angle), np.arange(-7.0, 8.0)
    got, valid = sample_profiles(gray, curve, d_px)
    assert valid.all()
    where = curve.px[:, None] + d_px[None, :, None] * curve.normal_px[:, None]
    spline = map_coordinates(gray.astype(float), [where[..., 1], where[..., 0]], order=5)
    assert np.abs(got - spline).max() < 0.008 * np.ptp(image)


def test_profiles_in_a_reduced_image_lie_where_the_full_ones_do() -> None:
    """A ramp is the same ramp in blocks: only right offsets give its value at the place."""
    y, x = np.mgrid[:480, :640]
    gray = (100 + 40 * x + 60 * y).astype(np.uint16)
    curve = replace(straight_curve(30, 0.4), px=straight_curve(30, 0.4).px * 2.0 + 50.3)
    for factor in (2, 3):
        height, width = 480 // factor, 640 // factor
        blocks = gray[: height * factor, : width * factor].reshape(height, factor, width, factor)
        small = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint16)
        d_px = np.arange(-4.0, 5.0)
        got, valid = sample_profiles(small, curve, d_px, factor)
        assert valid.all()
        at = curve.px[:, None] + factor * d_px[None, :, None] * curve.normal_px[:, None]
        np.testing.assert_allclose(got, 100 + 40 * at[..., 0] + 60 * at[..., 1], atol=12.0)
    small, factor = reduce_image(gray)
    assert factor == 2
    np.testing.assert_allclose(small[10, 20], 100 + 40 * 40.5 + 60 * 20.5, atol=1.0)


def test_profiles_that_leave_the_frame_are_marked() -> None:
    gray = np.zeros((160, 200), np.uint8)
    curve = straight_curve(220, 0.0)
    inside, d_px = curve.px[:, 1], np.arange(-7.0, 8.0)
    _, valid = sample_profiles(gray, curve, d_px)
    assert np.array_equal(valid, (inside >= 1) & (inside <= 158))


@pytest.mark.parametrize("sigma", [2.0, 10.0, 300.0])
def test_pixel_noise_is_that_of_the_samples(sigma: float) -> None:
    """No less than the true noise of uncorrelated samples, and no more than half as much again."""
    rng = np.random.default_rng(0)
    d_px = GRID.d_px
    profiles = blurred_edges(np.zeros(400), d_px, 40 * sigma) + rng.normal(0, sigma, (400, 17))
    assert 1.0 < pixel_noise(profiles) / sigma < 1.5
    assert pixel_noise(np.full((30, 17), 7.0)) > 0


# ---------------------------------------------------------------- steepest fall


def test_steepest_fall_of_a_flat_planet_is_unbiased() -> None:
    rng = np.random.default_rng(1)
    offset = rng.uniform(-1.5, 1.5, 2000)
    clean = blurred_edges(offset, GRID.d_px, 150.0)
    places = steepest_fall(clean, 1.0, GRID)
    assert not places.at_border.any()
    error = places.offset_px - offset
    assert abs(error.mean()) < 0.005
    assert np.abs(error).max() < 0.08
    noisy = steepest_fall(clean + rng.normal(0, 2.0, clean.shape), 2.0, GRID)
    assert abs(np.mean(noisy.offset_px - offset)) < 0.01
    assert np.std(noisy.offset_px - offset) < np.median(noisy.sigma_px)
    np.testing.assert_allclose(places.step, 150.0, rtol=0.15)
    assert np.all(places.significance > 20)


def test_steepest_fall_takes_the_outermost_edge() -> None:
    """A bright cloud's edge inside, the dimmer ground's limb outside."""
    grid = ProfileGrid(-12.0, 25, 6.0, 0.5)
    cloud, limb = np.full(50, -4.2), np.linspace(1.0, 2.0, 50)
    profiles = blurred_edges(cloud, grid.d_px, 120.0) + blurred_edges(limb, grid.d_px, 80.0)
    places = steepest_fall(profiles, 1.0, grid)
    assert np.abs(places.offset_px - limb).max() < 0.1
    # ... unless it is nothing beside the other
    profiles = blurred_edges(cloud, grid.d_px, 120.0) + blurred_edges(limb, grid.d_px, 5.0)
    assert np.abs(steepest_fall(profiles, 1.0, grid).offset_px - cloud).max() < 0.1


def test_steepest_fall_finds_none_in_noise_or_out_of_reach() -> None:
    rng = np.random.default_rng(3)
    flat = steepest_fall(rng.normal(10, 2.0, (500, 17)), 2.0, GRID)
    assert np.mean(flat.at_border | (flat.significance < 5)) > 0.97
    far = steepest_fall(blurred_edges(np.full(5, -4.5), GRID.d_px, 100.0), 1.0, GRID)
    assert far.at_border.all()
    rising = steepest_fall(blurred_edges(np.zeros(5), GRID.d_px, -100.0) + 100.0, 1.0, GRID)
    assert rising.at_border.all()


# ---------------------------------------------------------------- the edge model


@pytest.mark.parametrize("rough", [False, True])
def test_texture_covariance_by_brute_force(rough: bool) -> None:
    """Sampled: a Gaussian process on the planet's side, correlated in the root of the depth."""
    x = np.arange(-5.0, 3.01, 1.0)
    depth = np.arange(0.02, 12.0, 0.02)[:700:2] + 0.01
    root = np.sqrt(depth)
    apart = np.abs(root[:, None] - root)
    if rough:
        law = np.exp(-apart / edge_model._ROUGH_ROOT_LENGTH)
    else:
        apart *= np.sqrt(3.0) / edge_model._SMOOTH_ROOT_LENGTH
        law = (1.0 + apart) * np.exp(-apart)
    rng = np.random.default_rng(0)
    drawn = np.linalg.cholesky(law + 1e-9 * np.eye(len(law))) @ rng.normal(size=(len(law), 6000))
    psf = 0.8
    width = depth[1] - depth[0]
    weight = np.exp(-0.5 * ((x[:, None] + depth) / psf) ** 2) * width / psf / np.sqrt(2 * np.pi)
    sampled = np.cov(weight @ drawn)
    ours = texture_covariance(x, psf, rough)
    np.testing.assert_allclose(ours, sampled, atol=0.06)
    assert np.linalg.eigvalsh(ours).min() > -1e-9
    # deep inside it is the texture's own, far outside there is none
    assert ours[-1, -1] < 1e-3
    assert np.all(np.diff(np.diag(ours)[3:]) < 0)


def test_edge_profile_is_a_blurred_step_with_blurred_glow() -> None:
    fine = np.arange(-60.0, 60.0, 0.01)
    look = EdgeLook(0.8, 3.0)
    for glow in (0.0, 0.4, 1.0):
        raw = np.where(fine < 0, 1.0, glow * np.exp(-np.maximum(fine, 0) / look.glow_px))
        for x in (-2.0, -0.3, 0.0, 0.5, 2.0, 6.0):
            blur = np.exp(-0.5 * ((x - fine) / 0.8) ** 2) / 0.8 / np.sqrt(2 * np.pi)
            assert edge_profile(np.array([x]), look, glow)[0] == pytest.approx(
                np.sum(blur * raw) * 0.01, abs=5e-3
            )


@pytest.mark.parametrize("texture", [Texture(0.0), Texture(0.25), Texture(0.25, rough=True)])
def test_likelihood_against_generalised_least_squares(texture: Texture) -> None:
    """One noisy profile: restricted log-likelihood of every place, by dense matrices."""
    level = 64.0
    table = tables_of(SHARP, (texture,), (0.0,), level, GRID)
    rng = np.random.default_rng(4)
    d_px = GRID.d_px
    profile = blurred_edges(np.array([0.6]), d_px, level)[0] + rng.normal(0, 1.0, len(d_px))
    cost = np.sum((table.residual[0] @ profile) ** 2, axis=1) + table.log_det[0]
    want, steps = [], []
    for place in GRID.e_px:
        x = d_px - place
        rise = ndtr(-x / SHARP.psf_px)
        cov = np.eye(len(x)) + np.diag((edge_model.SHAPE_ERROR * level * rise) ** 2)
        unit = texture_covariance(x, SHARP.psf_px, texture.rough)
        cov += (texture.amplitude * level) ** 2 * unit
        design = np.column_stack([np.ones_like(x), rise])
        factor = cho_factor(cov)
        normal = design.T @ cho_solve(factor, design)
        solution = np.linalg.solve(normal, design.T @ cho_solve(factor, profile))
        rest = profile - design @ solution
        want.append(
            rest @ cho_solve(factor, rest)
            + np.linalg.slogdet(cov)[1]
            + np.linalg.slogdet(normal)[1]
        )
        steps.append(solution[1])
    want = np.array(want)
    np.testing.assert_allclose(cost - cost.min(), want - want.min(), rtol=2e-3, atol=0.03)
    np.testing.assert_allclose(table.step[0] @ profile, steps, rtol=1e-3, atol=0.02)


def test_likeliest_place_is_unbiased_and_as_certain_as_it_says() -> None:
    rng = np.random.default_rng(5)
    for step, noise in ((150.0, 2.0), (40.0, 2.0), (20.0, 2.0)):
        offset = rng.uniform(-1.2, 1.2, 1500)
        profiles = blurred_edges(offset, GRID.d_px, step)
        profiles += rng.normal(0, noise, profiles.shape)
        places = place_edges(profiles, noise, SHARP, GRID)
        error = places.offset_px - offset
        assert abs(error.mean()) < 0.004 + 3 * error.std() / np.sqrt(len(error))
        assert 0.75 < np.sqrt(np.mean((error / places.sigma_px) ** 2)) < 1.25
        np.testing.assert_allclose(places.step.mean(), step, rtol=0.03)
        assert np.median(places.misfit) == pytest.approx(1.0, abs=0.25)
        # Cramer-Rao for samples a pixel apart: noise / (step sqrt(sum of squared slopes))
        slope = 1.0 / np.sqrt(2.0 * np.sqrt(np.pi) * BLUR_PX)
        bound = noise / step / slope
        assert error.std() > 0.8 * bound
        assert error.std() < 1.8 * bound


def test_likeliest_place_beside_texture_follows_its_outer_flank() -> None:
    """Profiles drawn from the model itself with strong texture: still unbiased and honest."""
    rng = np.random.default_rng(6)
    d_px, level, noise = GRID.d_px, 100.0, 2.0
    offset = rng.uniform(-0.9, 0.9, 600)
    profiles = np.empty((len(offset), len(d_px)))
    for i, place in enumerate(offset):
        x = d_px - place
        cov = (0.3 * level) ** 2 * texture_covariance(x, SHARP.psf_px, rough=True)
        root = np.linalg.cholesky(cov + 1e-6 * np.eye(len(x)))
        profiles[i] = 5 + level * ndtr(-x / SHARP.psf_px) + root @ rng.normal(size=len(x))
    profiles += rng.normal(0, noise, profiles.shape)
    places = place_edges(profiles, noise, SHARP, GRID)
    error = places.offset_px - offset
    assert abs(np.median(error)) < 0.05
    ratio = 1.4826 * np.median(np.abs(error / places.sigma_px))
    assert 0.6 < ratio < 1.5
    # where the fall is steepest is farther off
    steepest = steepest_fall(profiles, noise, GRID)
    found = ~steepest.at_border
    assert np.mean(error**2) < np.mean((steepest.offset_px - offset)[found] ** 2)


def test_rising_edges_are_not_taken() -> None:
    profiles = blurred_edges(np.zeros(20), GRID.d_px, -100.0) + 100.0
    places = place_edges(profiles, 1.0, SHARP, GRID)
    assert np.all((places.misfit > 6) | (places.significance < 5) | places.at_border)


def test_places_taken_by_mask() -> None:
    offset = np.linspace(-1, 1, 9)
    places = place_edges(blurred_edges(offset, GRID.d_px, 90.0), 1.0, SHARP, GRID)
    some = places.take(np.arange(9) % 2 == 0)
    np.testing.assert_array_equal(some.offset_px, places.offset_px[::2])
    assert len(some.misfit) == 5
    assert len(cone_rays(NADIR, 1.0, np.zeros(2))) == 2


# ---------------------------------------------------------------- a limb that is expected

EXPECTED = replace(FINAL, expected=True, inner_px=4.0)


@pytest.mark.parametrize("texture", ["uniform", "clouds"])
@pytest.mark.parametrize("off_px", [0.0, 0.05, 0.5])
def test_an_expected_limb_is_the_same_limb(texture: str, off_px: float) -> None:
    """Where it lies as predicted, and where it has to be looked for as always."""
    altitude_m = 600e3
    view = limb_views(altitude_m)[0]
    scene = clouds(4) if texture == "clouds" else None
    image = draw((view,), altitude_m, scene)[0].image
    true_rho = PLANET.rho_from_altitude(altitude_m)
    rho = true_rho + off_px / view.camera.fx
    looks = (SHARP,)
    always, _ = refine_limb(image, view, NADIR, rho, FINAL, looks)
    expected, kept = refine_limb(image, view, NADIR, rho, EXPECTED, looks)
    assert expected.status is always.status is Status.OK
    assert kept == looks
    nearest = np.linalg.norm(always.px[:, None] - expected.px, axis=2).argmin(axis=1)
    same = np.linalg.norm(always.px - expected.px[nearest], axis=1) < 2.0
    assert same.mean() > 0.9
    apart = (always.offset_px - expected.offset_px[nearest])[same]
    assert np.abs(apart).mean() < np.median(always.sigma_px)
    off_always, off = (
        rays_of(view, limb).residuals_px(NADIR, true_rho) for limb in (always, expected)
    )
    sigma_px = np.median(always.sigma_px)
    assert abs(np.median(off)) < abs(np.median(off_always)) + 0.01 + 0.1 * sigma_px
    assert np.linalg.norm(off) < 1.25 * np.linalg.norm(off_always)


def test_points_come_in_order_along_the_limb() -> None:
    altitude_m = 600e3
    view = limb_views(altitude_m)[0]
    image = draw((view,), altitude_m, clouds(2))[0].image
    rho = PLANET.rho_from_altitude(altitude_m)
    limb, _ = refine_limb(image, view, NADIR, rho, FINAL, (SHARP,))
    rays = rays_of(view, limb)
    assert rays.ordered
    order = replace(rays, ordered=False).along_limb(NADIR)
    if order[0] > order[-1]:
        order = order[::-1]
    np.testing.assert_array_equal(rays.along_limb(NADIR), order)
    predicted = limb.predicted
    assert predicted is not None
    where = np.linalg.norm(predicted.px[:, None] - limb.px, axis=2)
    np.testing.assert_allclose(where.min(axis=0), np.abs(limb.offset_px), atol=1e-6)


@pytest.mark.parametrize("off_px", [0.25, 2.0, 3.0])
def test_a_limb_that_is_not_where_it_is_expected_is_found_where_it_is(off_px: float) -> None:
    """Kriging about a place in space takes the ground that is missing there for dark texture."""
    altitude_m = 600e3
    view = limb_views(altitude_m)[0]
    image = draw((view,), altitude_m)[0].image
    rho = PLANET.rho_from_altitude(altitude_m)
    for direction in np.random.default_rng(7).normal(size=(25, 3)):
        step = off_px / view.camera.fx * direction / np.linalg.norm(direction)
        nadir = np.array([step[0], step[1], 1.0])
        nadir /= np.linalg.norm(nadir)
        limb, looks = refine_limb(image, view, nadir, rho + step[2], EXPECTED, (SHARP,))
        if looks and looks[0].glow_px == 0.0:
            off = rays_of(view, limb).residuals_px(NADIR, rho)
            assert np.abs(off).max() < 0.1
        else:  # A wider look follows.
            assert off_px >= 2.0


def test_means_of_a_part_are_the_parts_of_the_means() -> None:
    rng = np.random.default_rng(2)
    values = rng.standard_normal((60, 3))
    bundles = Bundles.of(rng.random(60) < 0.8, 5)
    some = bundles.part(slice(2, 7))
    np.testing.assert_allclose(some.mean(values), bundles.mean(values)[2:7])
    np.testing.assert_array_equal(some.middle, bundles.middle[2:7])


@pytest.mark.parametrize("num", [1, 5, 6, 7, 17, 26])
def test_triangular_matrices_are_inverted_by_halves(num: int) -> None:
    rng = np.random.default_rng(num)
    lower = np.tril(rng.normal(size=(3, 2, num, num))) + 4.0 * np.eye(num)
    inverse = edge_model.inverse_of_lower(lower)
    np.testing.assert_allclose(
        inverse @ lower, np.broadcast_to(np.eye(num), lower.shape), atol=1e-12
    )


def test_tables_are_kept_up_to_a_bound_of_memory() -> None:
    """The one used longest ago goes first; one that is larger than the bound is kept alone."""
    one = edge_model.tables_of(SHARP, SHARP.textures, SHARP.glows, 8.0, GRID)
    kept = edge_model.KeptTables(2.5 * one.nbytes)
    first = kept.of(SHARP, 8.0, GRID)
    kept.of(SHARP, 16.0, GRID)
    assert kept.of(SHARP, 8.0, GRID) is first
    kept.of(SHARP, 32.0, GRID)
    assert kept.nbytes <= 2.5 * one.nbytes
    assert kept.of(SHARP, 8.0, GRID) is first
    small = edge_model.KeptTables(1.0)
    assert small.of(SHARP, 8.0, GRID) is small.of(SHARP, 8.0, GRID)


def test_a_model_after_which_no_edge_is_left_is_moved_too_far() -> None:
    places = EdgePlaces(*np.ones((5, 26)), at_border=np.zeros(26, dtype=bool))
    assert _drift_px(places, places, np.ones(26, dtype=bool)) == 0.0
    assert _drift_px(places, places, np.zeros(26, dtype=bool)) == np.inf

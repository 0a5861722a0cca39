"""The airglow's upper edge as a limb of its own: against the renderer's layer, scenes in which the
ground's own limb misled, and the closed form of how covariances shrink.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import limb_frames
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limb_frames import CAMERA, PLANET, as_frames, clouds, limb_views, photograph
from limb_samples import nadir_nees
from scipy.ndimage import gaussian_filter1d

from horizon_sensor_ros.core.aiding import NOTHING_KNOWN, Aiding, AltitudeMeasurement
from horizon_sensor_ros.core.airglow.edge import airglow_edge
from horizon_sensor_ros.core.airglow.nadir import fit_airglow, with_airglow
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.search.stars import count_stars
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.measurement import camera_horizon
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.air import airglow_layer
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.hard_scenes import hard_scene
from horizon_sensor_ros.sim.poses import camera_from_fov

ALTITUDE_M = 420e3
DOWN = np.array([0.0, 0.0, 1.0])
RHO = PLANET.rho_from_altitude(ALTITUDE_M)
VIEW = limb_views(ALTITUDE_M, above_rad=0.05)[0]
NOISE = Imaging(noise_dn=1.5)
# A third of the frames are looked at more than once.
draw = lru_cache(maxsize=40)(limb_frames.draw)


def moonlit(seed: int, airglow_dn: float = 45.0, **changes: float) -> EarthScene:
    """Clouds by moonlight, stars, and a layer whose light falls off most steeply at 99.2 km."""
    dark = replace(clouds(seed), sun_direction=(-0.6, -0.64, -0.48), star_count=3000)
    return replace(dark, airglow_dn=airglow_dn, night_light=0.4, **changes)  # type: ignore[arg-type]


def image(scene: EarthScene, view: CameraView = VIEW, altitude_m: float = ALTITUDE_M) -> np.ndarray:
    return draw((view,), altitude_m, scene, NOISE)[0].image


def heights_m(edge: LimbPoints, altitude_m: float = ALTITUDE_M) -> np.ndarray:
    rays = VIEW.camera.rays(edge.px) @ VIEW.rot_base_from_cam.T
    sine = np.linalg.norm(np.cross(rays, DOWN), axis=1)
    return (PLANET.radius_m + altitude_m) * sine - PLANET.radius_m


@pytest.mark.parametrize("airglow_dn", [20.0, 45.0, 120.0])
@pytest.mark.parametrize("off_m", [-15e3, 0.0, 15e3])
def test_the_edge_is_found_where_the_layers_light_falls_off(
    airglow_dn: float, off_m: float
) -> None:
    """However bright it is, and wherever the limb below it was thought to be."""
    near = DOWN, PLANET.rho_from_altitude(ALTITUDE_M + off_m)
    edge = airglow_edge(image(moonlit(1, airglow_dn)), VIEW, *near, PLANET)
    assert edge.status is Status.OK
    height_m = heights_m(edge)
    # The layer as it is drawn, as blurred as lens, pixels and the detector blur it.
    shown_m = np.arange(0.0, 200e3, 50.0)
    px_m = (PLANET.radius_m + ALTITUDE_M) * np.cos(RHO) * CAMERA.pixel_rad
    blur_px = np.sqrt(0.7**2 + 1.0 / 12.0 + 1.0**2)
    light = gaussian_filter1d(airglow_layer(shown_m, 95e3, 6e3), blur_px * px_m / 50.0)
    steepest_m = shown_m[np.argmin(np.gradient(light))]
    assert steepest_m == pytest.approx(95e3 + 6e3 / np.sqrt(2.0), abs=2.5e3)
    assert np.median(height_m) == pytest.approx(steepest_m, abs=0.6e3)
    assert np.quantile(np.abs(height_m - np.median(height_m)), 0.9) < 2.5e3
    assert 0.0 < edge.shared.coherent_px < edge.shared.slope_px


@pytest.mark.parametrize(
    "scene",
    [
        clouds(3),
        replace(clouds(3), air_dn=100.0),
        replace(moonlit(3), airglow_dn=0.0),
        replace(clouds(3), air_dn=120.0, air_depth=7.0),
    ],
    ids=["day", "air", "night", "haze"],
)
def test_no_airglow_no_edge(scene: EarthScene) -> None:
    edge = airglow_edge(image(scene), VIEW, DOWN, RHO, PLANET)
    assert edge.status is Status.NO_LIMB
    assert edge.reason == "no edge of airglow"


def test_no_edge_from_too_low_too_far_or_out_of_the_frame() -> None:
    gray = image(moonlit(1))
    for altitude_m in (30e3, 96e3):
        low = airglow_edge(gray, VIEW, DOWN, PLANET.rho_from_altitude(altitude_m), PLANET)
        assert "in the airglow or below" in low.reason
    far = limb_views(8e6, camera_from_fov(320, 240, np.radians(60.0)))[0]
    edge = airglow_edge(gray[::2, ::2], far, DOWN, PLANET.rho_from_altitude(8e6), PLANET)
    assert "too far" in edge.reason
    below = limb_views(ALTITUDE_M, above_rad=-0.5)[0]
    assert "in the frame" in airglow_edge(gray, below, DOWN, RHO, PLANET).reason


def test_what_the_mask_hides_is_no_edge() -> None:
    use = np.ones((CAMERA.height, CAMERA.width), dtype=np.uint8)
    use[:, :200] = 0
    view = replace(VIEW, mask=Mask(use))
    edge = airglow_edge(image(moonlit(1)), view, DOWN, RHO, PLANET)
    assert edge.status is Status.OK
    assert edge.px[:, 0].min() > 200.0


@pytest.mark.parametrize("uneven_m", [0.0, pytest.param(2e3, marks=pytest.mark.slow), 4e3])
def test_the_layers_nadir_is_as_far_off_as_claimed(uneven_m: float) -> None:
    """Also where its height changes by kilometres along the limb."""
    nees = []
    for seed in range(12):
        frame = image(moonlit(seed, airglow_uneven_m=uneven_m))
        ground = LimbObservation(VIEW, LimbPoints.none(Status.NO_LIMB, "not looked at"))
        about = replace(
            HorizonFit(Status.OK, "", "ml"), nadir_base=DOWN, rho_rad=RHO, cameras=("camera_1",)
        )
        airglow = fit_airglow([(frame, ground)], about, PLANET)
        assert airglow is not None
        nees.append(nadir_nees(airglow, DOWN))
    # Claimed for what photographs show: simulated waves are up to twice as gentle.
    assert max(nees) < 11.8
    assert np.mean(nees) < 2.4


def test_a_layer_elsewhere_is_none_of_a_fit_that_did_not_use_the_camera() -> None:
    ground = LimbObservation(VIEW, LimbPoints.none(Status.NO_LIMB, "dark"))
    other = HorizonFit(Status.OK, "", "ml", DOWN, RHO, cameras=("camera_2",))
    assert fit_airglow([(image(moonlit(1)), ground)], other, PLANET) is None


def test_one_camera_by_moonlight_gains_by_the_layer() -> None:
    """The ground's short arc alone was .9 to 2.1 deg off."""
    off_deg, nees = [], []
    for index in (4, 5, 7, 12, 30, 50):
        scene = hard_scene("moonlit", index, 41)
        camera = 0 if index in (12, 50) else 1
        view, frame = scene.views[camera], scene.frames[camera]
        fix = HorizonSensor().process([Frame(view, frame.image)])
        if fix.ok:
            assert fix.airglow is not None
            cosine = fix.fit.nadir_base @ frame.truth.nadir_base
            off_deg.append(np.degrees(np.arccos(min(cosine, 1.0))))
            nees.append(nadir_nees(fix.fit, frame.truth.nadir_base))
    assert len(off_deg) >= 4
    assert max(off_deg) < 0.5
    assert max(nees) < 11.8


@pytest.mark.parametrize(
    ("index", "seed", "cameras"), [(16, 9, [0]), (46, 2718, [1]), (401, 31415, [0, 1])]
)
def test_the_layer_is_told_from_the_limb_where_candidates_are_of_both(
    index: int, seed: int, cameras: list[int]
) -> None:
    """The altitude was 105 to 120 km too small, at a sigma of one or two."""
    scene = hard_scene("moonlit", index, seed)
    frames = [Frame(scene.views[i], scene.frames[i].image) for i in cameras]
    fix = HorizonSensor().process(frames)
    if fix.ok:
        assert fix.fit.altitude_m == pytest.approx(scene.frames[0].truth.altitude_m, abs=25e3)
    else:
        assert fix.status in (Status.POOR_FIT, Status.NO_LIMB, Status.UNCERTAIN)


# Mounted so badly that airglow has something to say.
LOOSE = HorizonConfig(mounting_sigma_rad=np.radians(0.1))


def test_the_layer_is_followed_with_the_limb() -> None:
    scene = replace(moonlit(2), texture="smooth")
    sensor = HorizonSensor(LOOSE)
    following = []
    for seed in range(4):
        frames = as_frames((VIEW,), draw((VIEW,), ALTITUDE_M, scene, NOISE, seed))
        fix = sensor.process(frames)
        following.append(sensor.following)
        assert fix.ok
        assert fix.airglow is not None
        assert nadir_nees(fix.fit, DOWN) < 11.8
    assert following[1:] == [True] * 3


def test_by_day_nobody_looks_for_it_in_followed_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(
        "horizon_sensor_ros.core.horizon.estimator.fit_airglow", lambda *_: asked.append(1)
    )
    sensor = HorizonSensor(LOOSE)
    for seed in range(3):
        frames = draw((VIEW,), ALTITUDE_M, clouds(4), NOISE, seed)
        assert sensor.process(as_frames((VIEW,), frames)).ok
    assert sensor.following
    assert len(asked) == 1


def test_a_layer_about_another_nadir_is_a_contradiction() -> None:
    """What shines above the limb is turned by 3.6 deg against it: neither is believed."""
    narrow = camera_from_fov(640, 480, np.radians(20.0))
    view = limb_views(ALTITUDE_M, narrow, above_rad=0.02)[0]
    turned = limb_views(ALTITUDE_M, narrow, above_rad=0.02, roll_rad=0.3 + np.radians(3.6))[0]
    layer = replace(moonlit(5, 60.0), night_light=0.0)
    limb = replace(moonlit(5, 0.0), texture="smooth")
    both = np.maximum(image(limb, view), image(layer, turned))
    fix = HorizonSensor(LOOSE).process([Frame(view, both)])
    assert fix.status is Status.POOR_FIT
    assert "the airglow above it has its nadir" in fix.reason
    assert HorizonSensor(LOOSE).process([Frame(view, image(limb, view))]).ok


def fit_of(seed: int) -> HorizonFit:
    rng = np.random.default_rng(seed)
    nadir = rng.normal(size=3)
    nadir /= np.linalg.norm(nadir)
    to = np.zeros((4, 3))
    to[:3, :2], to[3, 2] = tangent_basis(nadir), 1e6
    root = rng.normal(size=(3, 3)) * 3e-3
    cov = to @ root @ root.T @ to.T
    return HorizonFit(Status.OK, "", "ml", nadir, RHO, ALTITUDE_M, cov)


@given(st.integers(0, 10**6), st.floats(1e-4, 1e-2), st.floats(0.0, 5e-3), st.floats(0.0, 8.0))
@settings(max_examples=60)
def test_nadirs_join_as_information_adds(
    seed: int, sigma_rad: float, common_rad: float, apart_sigmas: float
) -> None:
    fit = fit_of(seed)
    basis = tangent_basis(fit.nadir_base)
    to = np.zeros((3, 4))
    to[:2, :3], to[2, 3] = basis.T, 1.0
    own = to @ fit.cov_nadir_altitude @ to.T
    direction = np.random.default_rng(seed + 1).normal(size=2)
    together = own[:2, :2] + sigma_rad**2 * np.eye(2)
    direction /= np.sqrt(direction @ np.linalg.solve(together, direction))
    apart = apart_sigmas * direction
    nadir = fit.nadir_base + basis @ apart
    airglow = replace(
        fit,
        nadir_base=nadir,
        cov_nadir_altitude=np.diag([sigma_rad**2] * 3 + [0.0]),
    )
    common = np.zeros((4, 4))
    common[:3, :3] = common_rad**2 * basis @ basis.T
    told = replace(fit, cov_nadir_altitude=fit.cov_nadir_altitude + common)
    both = with_airglow(told, airglow, common, PLANET)
    scale = np.array([1e3, 1e3, 1e-3])  # milliradians, kilometres
    information = np.linalg.inv(own * np.outer(scale, scale))
    information[:2, :2] += np.eye(2) / (1e3 * sigma_rad) ** 2
    want = np.linalg.inv(information)
    birge = max(1.0, 0.5 * apart_sigmas**2)
    step = want[:, :2] @ (1e3 * apart) / (1e3 * sigma_rad) ** 2
    if not np.isfinite(PLANET.rho_from_altitude(ALTITUDE_M + 1e3 * step[2])):
        assert both is told
        return
    assert both.altitude_m == pytest.approx(ALTITUDE_M + 1e3 * step[2], rel=1e-6)
    moved = 1e3 * (basis.T @ (both.nadir_base - fit.nadir_base))
    np.testing.assert_allclose(moved, step[:2], atol=1e-3 + 0.01 * np.abs(step).max())
    got = to @ both.cov_nadir_altitude @ to.T * np.outer(scale, scale)
    want = birge * want + np.diag([1e6 * common_rad**2] * 2 + [0.0])
    # To a turn of the tangent plane by the update.
    np.testing.assert_allclose(got, want, rtol=0.05, atol=0.02 * np.abs(want).max())
    assert both.rho_rad == pytest.approx(PLANET.rho_from_altitude(both.altitude_m))


def test_an_estimate_below_the_ground_is_left_as_it_was() -> None:
    fit = replace(fit_of(3), altitude_m=1.0)
    basis = tangent_basis(fit.nadir_base)
    to = np.zeros((4, 3))
    to[:3, :2], to[3, 2] = basis, 1.0
    # A step along the first tangent direction takes the altitude down with it.
    root = np.array([[1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0], [-900.0, 0.0, 100.0]])
    fit = replace(fit, cov_nadir_altitude=to @ root @ root.T @ to.T)
    airglow = replace(
        fit,
        nadir_base=fit.nadir_base + 1e-3 * basis[:, 0],
        cov_nadir_altitude=np.diag([1e-8] * 3 + [0.0]),
    )
    assert with_airglow(fit, airglow, np.zeros((4, 4)), PLANET) is fit


def test_the_ellipsoids_error_is_the_layers_too() -> None:
    """Taken for a sphere it misleads both alike: the layer makes nadir no surer than that."""
    ellipsoid = replace(LOOSE, planet=Planet.wgs84())
    frames = as_frames((VIEW,), draw((VIEW,), ALTITUDE_M, moonlit(2), NOISE))
    sphere, wide = (HorizonSensor(config).process(frames) for config in (LOOSE, ellipsoid))
    assert sphere.airglow is not None
    assert wide.airglow is not None
    more = wide.fit.cov_nadir_altitude - sphere.fit.cov_nadir_altitude
    # Of the order of the flattening: a tenth of a degree.
    assert np.sqrt(np.linalg.eigvalsh(more[:3, :3])[-1]) > np.radians(0.05)


# ---------------------------------------------------------------- by the layer alone


def dark(seed: int, **changes: float) -> EarthScene:
    """The layer above ground that does not show."""
    return replace(moonlit(seed, **changes), night_light=0.0)


PAIR = limb_views(ALTITUDE_M, azimuths_rad=(0.0, np.pi / 2), above_rad=0.05)
REASON = "by the airglow's edge alone: no limb of the ground's shows below it"


def fix_by_layer(
    scene: EarthScene,
    views: tuple[CameraView, ...] = (VIEW,),
    config: HorizonConfig | None = None,
    aiding: Aiding = NOTHING_KNOWN,
) -> HorizonFix:
    frames = as_frames(views, draw(views, ALTITUDE_M, scene, NOISE))
    return HorizonSensor(config).process(frames, aiding)


@pytest.mark.parametrize(
    ("views", "uneven_m"),
    [
        ((VIEW,), 3e3),
        (PAIR, 0.0),
        pytest.param((VIEW,), 0.0, marks=pytest.mark.slow),
        pytest.param(PAIR, 3e3, marks=pytest.mark.slow),
    ],
)
def test_nadir_and_altitude_by_the_layer_alone(
    views: tuple[CameraView, ...], uneven_m: float
) -> None:
    nees, off = [], []
    for seed in range(8):
        fix = fix_by_layer(dark(seed, airglow_uneven_m=uneven_m), views)
        assert fix.ok, fix.reason
        assert fix.airglow_alone
        assert fix.airglow is not None
        assert fix.reason == REASON
        assert fix.cameras_used == tuple(view.name for view in views)
        nees.append(nadir_nees(fix.fit, DOWN))
        sigma_m = np.sqrt(fix.fit.cov_nadir_altitude[3, 3])
        assert sigma_m > 5e3, "how high the layer is"
        off.append((fix.fit.altitude_m - ALTITUDE_M) / sigma_m)
        # Its points lie on the cone that the frames show, which is not that of the ground.
        for view, limb in zip(views, fix.limbs, strict=True):
            assert fix.residual_px(view, limb) < 1.5
    assert max(nees) < 11.8
    assert np.mean(nees) < 2.4
    assert np.abs(off).max() < 3.0


def test_a_known_altitude_is_joined_with_the_layers() -> None:
    known = AltitudeMeasurement(ALTITUDE_M, 200.0)
    alone, aided = (
        fix_by_layer(dark(1), aiding=aiding) for aiding in (NOTHING_KNOWN, Aiding(altitude=known))
    )
    assert alone.airglow_alone
    assert aided.airglow_alone
    assert aided.fit.altitude_m == pytest.approx(ALTITUDE_M, abs=1e3)
    assert np.trace(aided.fit.cov_nadir_altitude[:3, :3]) < np.trace(
        alone.fit.cov_nadir_altitude[:3, :3]
    )
    assert nadir_nees(aided.fit, DOWN) < 11.8


def test_by_the_layer_alone_the_ellipsoids_error_and_the_mountings_are_claimed() -> None:
    plain = fix_by_layer(dark(2))
    for config in (HorizonConfig(planet=Planet.wgs84()), LOOSE):
        wide = fix_by_layer(dark(2), config=config)
        assert wide.airglow_alone
        more = (wide.fit.cov_nadir_altitude - plain.fit.cov_nadir_altitude)[:3, :3]
        assert np.sqrt(np.linalg.eigvalsh(more)[-1]) > np.radians(0.05)


def test_a_short_arc_of_the_layer_says_how_little_it_knows() -> None:
    camera = camera_from_fov(640, 480, np.radians(20.0))
    view = limb_views(ALTITUDE_M, camera, above_rad=0.05)[0]
    fix = fix_by_layer(dark(1), (view,))
    assert fix.status is Status.UNCERTAIN
    assert fix.reason.endswith("by the airglow's edge alone")
    loose = fix_by_layer(dark(1), (view,), HorizonConfig(max_nadir_sigma_rad=np.radians(5.0)))
    assert loose.airglow_alone
    assert nadir_nees(loose.fit, DOWN) < 11.8


def test_an_altitude_out_of_bounds_is_none_by_the_layer_either() -> None:
    assert not fix_by_layer(dark(1), config=HorizonConfig(altitude_min_m=6e5)).ok


def test_bright_air_over_a_dark_sea_is_not_the_layer() -> None:
    """By day, when no stars show."""
    for seed in range(4):
        assert not fix_by_layer(replace(dark(seed), star_count=0)).airglow_alone


@pytest.mark.parametrize("height_px", [8.0, 15.0])
def test_a_band_that_undulates_is_not_the_layer(height_px: float) -> None:
    """As aurora does."""
    for seed in range(4):
        gray = image(dark(seed))
        along = np.arange(gray.shape[1])
        shift = np.rint(height_px * np.sin(along / 25.0 + seed)).astype(int)
        gray = np.stack([np.roll(gray[:, x], by) for x, by in zip(along, shift, strict=True)], 1)
        assert not HorizonSensor().process([Frame(VIEW, gray)]).ok


def test_the_layer_alone_is_searched_for_in_every_frame() -> None:
    frames = as_frames((VIEW,), draw((VIEW,), ALTITUDE_M, dark(1), NOISE))
    sensor = HorizonSensor()
    for _ in range(3):
        assert sensor.process(frames).airglow_alone
        assert not sensor.following


@pytest.mark.parametrize("change", [{"method": "arc"}, {"limb": "canny"}])
def test_other_methods_stay_what_their_papers_say(change: dict[str, str]) -> None:
    config = replace(HorizonConfig(), **change)  # type: ignore[arg-type]
    assert not fix_by_layer(dark(1), config=config).ok


def test_self_calibration_takes_no_limb_of_the_layer() -> None:
    fix = fix_by_layer(dark(1))
    assert fix.airglow_alone
    assert camera_horizon(VIEW, fix, PLANET) is None


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_noise_is_no_stars_whatever_the_frames_type(kind: type) -> None:
    """Of a followed frame the working image has the frame's own type, which has no sign."""
    gray = np.random.default_rng(0).integers(0, 6, (48, 64)).astype(kind)
    star = gray.copy()
    star[20, 30] = 60
    view = CameraView("camera_1", Camera(64, 48, 60.0, 60.0, 31.5, 23.5), np.eye(3))
    for image, stars in ((gray, 0), (star, 1)):
        assert count_stars(view, WorkingImage(image, 1, 2.0, 1.5), -DOWN, 0.5) == stars


def test_without_stars_an_edge_above_the_limb_is_not_the_airglows() -> None:
    """In photographs by day haze, ghosts and compression were taken for it."""
    lit = moonlit(2, airglow_dn=8.0)
    by_night, by_day = (
        fix_by_layer(replace(lit, star_count=stars), config=LOOSE) for stars in (3000, 0)
    )
    assert by_night.ok
    assert by_day.ok
    assert by_night.airglow is not None
    assert by_day.airglow is None


# ---------------------------------------------------------------- photographs


@pytest.mark.parametrize(("name", "focal_length_mm"), [("iss044e045576.jpg", 28.0)])
def test_a_photograph_with_nothing_but_the_layer(
    name: str, focal_length_mm: float, shared_data: Path
) -> None:
    """City lights, lightning and the Moon. It was cropped to three quarters: with the whole frame's
    lens the altitude comes out too low, which nothing in the frame tells.
    """
    frame = photograph(shared_data / "earth_real" / name, focal_length_mm)
    fix = HorizonSensor().process([frame])
    assert fix.ok, fix.reason
    assert fix.airglow_alone
    assert 250e3 < fix.fit.altitude_m < 600e3


@pytest.mark.parametrize(
    ("name", "focal_length_mm"),
    [
        ("iss028e031144.jpg", 22.0),
        ("iss031e010712.jpg", 24.0),
        ("iss053e162584.jpg", 24.0),
        ("ISS028-E-33400.JPG", 15.0),
        ("ISS028-E-33445.JPG", 15.0),
    ],
)
def test_photographs_by_moonlight(name: str, focal_length_mm: float, shared_data: Path) -> None:
    """The first was refused by its ground alone, which made 290 km of it."""
    frame = photograph(shared_data / "earth_real" / name, focal_length_mm)
    fix = HorizonSensor().process([frame])
    assert fix.ok, fix.reason
    assert fix.airglow is not None
    assert 300e3 < fix.fit.altitude_m < 450e3


@pytest.mark.parametrize(
    ("texture", "ground_dn", "air_dn", "altitude_km"),
    [
        ("uniform", 40.0, 100.0, 700.0),
        ("uniform", 13.0, 77.0, 309.0),  # the sea deep below is as dark as below a layer
        ("uniform", 15.0, 127.0, 2206.0),
        ("uniform", 14.0, 127.0, 743.0),  # taken for a layer: no part of its light is hidden
        ("uniform", 12.0, 128.0, 893.0),
        ("smooth", 22.0, 61.0, 2111.0),
        ("smooth", 37.0, 127.0, 1018.0),
    ],
)
def test_daylit_air_over_dark_sea_under_stars_is_no_airglow(
    texture: str, ground_dn: float, air_dn: float, altitude_km: float
) -> None:
    """Taken for a layer its altitude was 95 to 125 km too high, at a tenth of that claimed."""
    scene = EarthScene(
        texture=texture,
        uniform_dn=ground_dn,
        smooth_contrast=0.2,
        texture_seed=1,
        air_dn=air_dn,
        star_count=3000,
    )
    views = limb_views(1e3 * altitude_km, azimuths_rad=(0.0, 1.5))
    frames = as_frames(views, draw(views, 1e3 * altitude_km, scene, NOISE))
    for seen in (frames, frames[:1]):
        fix = HorizonSensor().process(seen)
        assert fix.ok, fix.reason
        assert not fix.airglow_alone
        off_m = fix.fit.altitude_m - 1e3 * altitude_km
        assert abs(off_m) < 4.0 * np.sqrt(fix.fit.cov_nadir_altitude[3, 3])
        assert abs(off_m) < 30e3

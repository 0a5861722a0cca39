"""The whole chain: frames in, nadir and altitude out, or a refusal with its reason."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from limb_frames import (
    CAMERA,
    PLANET,
    as_frames,
    clouds,
    draw,
    limb_views,
    photograph,
    shared_frames,
    shared_truths,
    unlike_any_limb,
)
from limb_samples import BARREL, FISHEYE, angle_between
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import Aiding, AltitudeMeasurement
from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.camera import Camera
from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.horizon_config import HorizonConfig
from horizon_sensor_ros.core.horizon_fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon_sensor import HorizonSensor
from horizon_sensor_ros.core.judgement import full_scale
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging, Occluder
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scene, hard_scenes
from horizon_sensor_ros.sim.poses import (
    camera_from_fov,
    random_direction,
    rot_from_axis,
    side_views,
)
from horizon_sensor_ros.sim.scene_sets import SceneCase, set_a, set_b, two_camera_set

NADIR = np.array([0.0, 0.0, 1.0])
SENSOR = HorizonSensor()
SQUARE = (0.0, 1.5)  # azimuths of two cameras whose axes are nearly perpendicular in low orbit


def error_deg(fix: HorizonFix, nadir: np.ndarray) -> float:
    return float(np.degrees(angle_between(fix.fit.nadir_base, nadir)))


def sigma_deg(fix: HorizonFix) -> float:
    return float(np.degrees(np.sqrt(np.linalg.eigvalsh(fix.fit.cov_nadir_altitude[:3, :3])[-1])))


def nees(fix: HorizonFix, nadir: np.ndarray) -> float:
    """Two degrees of freedom: the error across nadir over its covariance."""
    basis = tangent_basis(nadir)
    error = basis.T @ fix.fit.nadir_base
    return float(
        error @ np.linalg.solve(basis.T @ fix.fit.cov_nadir_altitude[:3, :3] @ basis, error)
    )


def fix_of_one(scene: HardScene, index: int) -> HorizonFix:
    """What one camera of a scene says without the other."""
    one = slice(index, index + 1)
    return SENSOR.process(as_frames(scene.views[one], scene.frames[one]))


def assert_refused(fix: HorizonFix, frames: int) -> None:
    """No estimate anywhere, and a reason."""
    assert not fix.ok
    assert fix.status is not Status.OK
    assert fix.reason
    assert fix.cameras_used == ()
    assert len(fix.limbs) == frames
    assert np.isnan(fix.fit.nadir_base).all()
    assert np.isnan([fix.fit.rho_rad, fix.fit.altitude_m]).all()
    assert np.isnan(fix.fit.cov_nadir_altitude).all()


@lru_cache(maxsize=1)
def clouded_pair() -> tuple[Frame, ...]:
    altitude_m = 500e3
    views = limb_views(altitude_m, azimuths_rad=SQUARE)
    return tuple(as_frames(views, draw(views, altitude_m, clouds(1), Imaging(noise_dn=1.5))))


@lru_cache(maxsize=1)
def clouded_fix() -> HorizonFix:
    return SENSOR.process(clouded_pair())


# ---------------------------------------------------------------- estimates


@pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
@pytest.mark.parametrize("altitude_m", [350e3, 4000e3])
def test_uniform_planet_in_two_cameras(camera: Camera, altitude_m: float) -> None:
    views = limb_views(altitude_m, camera, SQUARE)
    fix = SENSOR.process(as_frames(views, draw(views, altitude_m, None, Imaging(noise_dn=2.0))))
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_1", "camera_2")
    assert error_deg(fix, NADIR) < 0.01
    assert fix.fit.altitude_m == pytest.approx(altitude_m, rel=2e-3)
    assert sigma_deg(fix) < 0.01
    cov = fix.fit.cov_nadir_altitude
    assert np.abs(cov[:3] @ np.append(fix.fit.nadir_base, 0.0)).max() < 1e-12
    assert [limb.status for limb in fix.limbs] == [Status.OK] * 2
    assert fix.fit.rms_residual_px < 0.1


@pytest.mark.parametrize("psf", [0.0, 0.3, 0.7, 1.5])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_sharp_blurred_and_clean_images(psf: float, noise: float) -> None:
    """The papers' own drawings have no blur and no noise at all."""
    views = limb_views(300e3, azimuths_rad=SQUARE)
    frames = as_frames(views, draw(views, 300e3, None, Imaging(noise_dn=noise, psf_sigma_px=psf)))
    fix = SENSOR.process(frames)
    assert fix.ok, fix.reason
    assert error_deg(fix, NADIR) < 0.05
    assert fix.fit.altitude_m == pytest.approx(300e3, rel=0.02)


@pytest.mark.parametrize(("altitude_m", "fov_deg"), [(3000e3, 60.0), (6000e3, 40.0)])
@pytest.mark.parametrize("psf", [0.0, 0.3, 0.5])
def test_drawings_sharper_than_their_pixels(altitude_m: float, fov_deg: float, psf: float) -> None:
    """Paper C's, one camera: its own error is 0.005 and 0.036 deg."""
    views = limb_views(altitude_m, camera_from_fov(400, 400, np.radians(fov_deg)))
    drawn = draw(views, altitude_m, None, Imaging(noise_dn=0.0, psf_sigma_px=psf))
    fix = SENSOR.process(as_frames(views, drawn))
    assert fix.ok, fix.reason
    assert error_deg(fix, NADIR) < 0.004


def test_whole_disc_in_one_frame() -> None:
    views = limb_views(12000e3, azimuths_rad=(0.0,), above_rad=-0.33)
    for psf in (0.0, 0.7):
        drawn = draw(views, 12000e3, None, Imaging(noise_dn=1.0, psf_sigma_px=psf))
        fix = SENSOR.process(as_frames(views, drawn))
        assert fix.ok, fix.reason
        assert error_deg(fix, NADIR) < 0.01


def test_a_clean_image_of_hard_pixels() -> None:
    """Whole pixels, black and white: a disc of 150 px as drawn with no anti-aliasing."""
    y, x = np.mgrid[:480, :640]
    disc = (((y - 240) ** 2 + (x - 320) ** 2 < 150.3**2) * 200).astype(np.uint8)
    camera = Camera(640, 480, 554.0, 554.0, 320.0, 240.0)
    fix = SENSOR.process([Frame(CameraView("camera", camera, np.eye(3)), disc)])
    assert fix.ok, fix.reason
    assert error_deg(fix, NADIR) < 0.02
    assert np.tan(fix.fit.rho_rad) == pytest.approx(150.3 / 554.0, rel=5e-3)


@pytest.mark.parametrize("factor", [16, 257])
def test_gray_levels_of_16_bits_give_the_same_fix(factor: int) -> None:
    eight = clouded_fix()
    sixteen = SENSOR.process(
        [replace(f, gray=f.gray.astype(np.uint16) * np.uint16(factor)) for f in clouded_pair()]
    )
    assert eight.ok
    assert sixteen.ok
    assert sixteen.cameras_used == eight.cameras_used
    assert error_deg(eight, sixteen.fit.nadir_base) < sigma_deg(eight)
    # Rounding decides which edges beside cloud the robust fit leaves out, and so its scatter.
    assert sigma_deg(sixteen) == pytest.approx(sigma_deg(eight), rel=0.6)


def test_the_same_frames_give_the_same_fix() -> None:
    first = clouded_fix()
    sensor = HorizonSensor()
    sensor.process(clouded_pair()[1:])
    sensor.reset()
    again = sensor.process(clouded_pair())
    np.testing.assert_array_equal(first.fit.nadir_base, again.fit.nadir_base)
    np.testing.assert_array_equal(first.fit.cov_nadir_altitude, again.fit.cov_nadir_altitude)
    np.testing.assert_array_equal(first.limbs[0].px, again.limbs[0].px)


def test_the_base_frame_turns_the_answer_with_it() -> None:
    turn = Rotation.from_euler("zyx", [0.4, -1.0, 2.0]).as_matrix()
    fix = clouded_fix()
    turned = SENSOR.process(
        [
            replace(f, view=replace(f.view, rot_base_from_cam=turn @ f.view.rot_base_from_cam))
            for f in clouded_pair()
        ]
    )
    assert error_deg(turned, turn @ fix.fit.nadir_base) < 1e-3
    assert turned.fit.altitude_m == pytest.approx(fix.fit.altitude_m, rel=1e-3)


@pytest.mark.parametrize("method", ["chord", "arc", "gauss_newton", "cone", "ml"])
@pytest.mark.parametrize("limb", ["subpixel", "canny"])
def test_every_method(method: str, limb: str) -> None:
    views = limb_views(500e3, azimuths_rad=SQUARE)
    frames = as_frames(views, draw(views, 500e3, None, Imaging(noise_dn=1.0)))
    fix = HorizonSensor(HorizonConfig(method=method, limb=limb)).process(frames)
    assert fix.ok, fix.reason
    assert fix.fit.method == method
    assert error_deg(fix, NADIR) < (0.3 if method in ("chord", "arc") else 0.05)


# ---------------------------------------------------------------- statistics on drawn sets


def statistics(
    cases: Iterable[SceneCase],
) -> tuple[np.ndarray, np.ndarray, int]:
    """Errors (deg), NEES, and how many gave no fix."""
    errors, ratios, refused = [], [], 0
    for case in cases:
        fix = SENSOR.process(as_frames(case.views, case.frames))
        nadir = case.frames[0].truth.nadir_base
        if fix.ok:
            errors.append(error_deg(fix, nadir))
            ratios.append(nees(fix, nadir))
        else:
            refused += 1
    return np.array(errors), np.array(ratios), refused


def test_set_a_sample() -> None:
    errors, ratios, refused = statistics(set_a(8, seed=5))
    assert refused == 0
    assert np.sqrt(np.mean(errors**2)) < 0.004
    assert np.mean(ratios) < 6.0


def test_set_b_sample() -> None:
    errors, ratios, refused = statistics(set_b(8, seed=6))
    assert refused <= 2
    assert np.median(errors) < 0.06
    assert np.sqrt(np.mean(errors**2)) < 0.2
    assert np.median(ratios) < 8.0
    assert ratios.max() < 60.0


def test_two_cameras_on_clouds_sample() -> None:
    errors, ratios, refused = statistics(two_camera_set(4, seed=7))
    assert refused == 0
    assert np.sqrt(np.mean(errors**2)) < 0.06
    assert np.median(ratios) < 25.0


# ---------------------------------------------------------------- frames without a horizon


@pytest.mark.parametrize("name", sorted(unlike_any_limb(48, 64)))
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_frames_without_a_horizon(name: str, dtype: type) -> None:
    gray = unlike_any_limb()[name].astype(dtype) * dtype(1 if dtype is np.uint8 else 257)
    views = side_views(CAMERA)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_refused(SENSOR.process([Frame(views[0], gray)]), 1)
        assert_refused(SENSOR.process([Frame(view, gray) for view in views]), 2)


@pytest.mark.parametrize(
    "shape", [(1, 1), (1, 50), (8, 8), (16, 16), (17, 31), (16, 400), (40, 2000)]
)
def test_tiny_and_thin_images(shape: tuple[int, int]) -> None:
    view = CameraView("camera", camera_from_fov(shape[1], shape[0], 1.0), np.eye(3))
    rng = np.random.default_rng(0)
    step = np.zeros(shape, np.uint8)
    step[shape[0] // 2 :] = 200
    for gray in (np.zeros(shape, np.uint8), rng.integers(0, 255, shape).astype(np.uint8), step):
        fix = SENSOR.process([Frame(view, gray)])
        assert_refused(fix, 1)
        if min(shape) < 16:
            assert fix.status is Status.BAD_IMAGE
            assert f"{shape[1]} x {shape[0]}" in fix.reason


def test_planet_inside_out() -> None:
    frames = [replace(f, gray=255 - f.gray) for f in clouded_pair()]
    assert_refused(SENSOR.process(frames), 2)


@lru_cache(maxsize=8)
def scenes_of(kind: str, n: int, seed: int = 21) -> tuple[HardScene, ...]:
    return tuple(hard_scenes(n, seed, (kind,)))


def test_night_has_no_fix() -> None:
    for scene in scenes_of("night", 2):
        assert scene.expect == "none"
        assert_refused(SENSOR.process(as_frames(scene.views, scene.frames)), 2)


@pytest.mark.parametrize("kind", ["earth", "space"])
def test_a_blind_camera_is_left_out_and_the_other_decides(kind: str) -> None:
    fixes = 0
    for scene in scenes_of(kind, 4):
        assert scene.blind_cameras == ("camera_1",)
        frames = as_frames(scene.views, scene.frames)
        assert_refused(SENSOR.process(frames[:1]), 1)
        fix = SENSOR.process(frames)
        if fix.status is Status.UNCERTAIN:
            continue  # one camera's short arc may be too little, and then it says so
        fixes += 1
        assert fix.ok, fix.reason
        assert fix.cameras_used == fix.fit.cameras == ("camera_2",)
        assert fix.limbs[0].status is not Status.OK
        assert fix.limbs[0].reason
        assert fix.limbs[1].status is Status.OK
        error = error_deg(fix, scene.frames[0].truth.nadir_base)
        assert error < max(0.3, 6.0 * sigma_deg(fix))
    assert fixes > 0


@pytest.mark.parametrize("level", [255, 130])
def test_flooded_frames(level: int) -> None:
    """Stray light all over one camera's frame: the other decides, or there is no fix."""
    one, two = clouded_pair()
    y, x = np.mgrid[:480, :640]
    glare = level * np.exp(-((x - 320.0) ** 2 + (y - 240.0) ** 2) / 3e5)
    flooded = replace(one, gray=np.clip(one.gray + glare, 0, 255).astype(np.uint8))
    alone = SENSOR.process([flooded])
    assert not alone.ok or error_deg(alone, NADIR) < 5.0 * sigma_deg(alone)
    fix = SENSOR.process([flooded, two])
    if fix.ok:
        assert error_deg(fix, NADIR) < max(0.1, 5.0 * sigma_deg(fix))
    else:
        assert_refused(fix, 2)


def test_boom_across_the_limb() -> None:
    views = limb_views(500e3, azimuths_rad=SQUARE, roll_rad=0.1)
    for x, brightness in ((200.0, 40.0), (400.0, 180.0)):
        bar = Occluder(
            ((x, -9.0), (x + 50.0, -9.0), (x + 20.0, 489.0), (x - 30.0, 489.0)), brightness
        )
        imaging = (Imaging(noise_dn=1.5, occluders=(bar,)), Imaging(noise_dn=1.5))
        fix = SENSOR.process(as_frames(views, draw(views, 500e3, clouds(2), imaging)))
        assert fix.ok, fix.reason
        assert "camera_2" in fix.cameras_used
        assert error_deg(fix, NADIR) < max(0.1, 4.0 * sigma_deg(fix))


def test_a_covered_lens() -> None:
    one, two = clouded_pair()
    for level in (0, 255):
        blind = replace(one, gray=np.full_like(one.gray, level))
        fix = SENSOR.process([blind, two])
        assert fix.ok, fix.reason
        assert fix.cameras_used == ("camera_2",)
        assert fix.limbs[0].reason
        assert error_deg(fix, NADIR) < max(0.2, 5.0 * sigma_deg(fix))


# ---------------------------------------------------------------- wrong extrinsics


@pytest.mark.parametrize(
    ("scene", "altitude_m"),
    [(EarthScene(), 400e3), (EarthScene(), 3000e3), (clouds(1), 500e3)],
    ids=["low", "high", "clouds"],
)
def test_a_camera_mounted_a_degree_off_is_no_confident_wrong_answer(
    scene: EarthScene, altitude_m: float
) -> None:
    """Turned about an axis across nadir; about nadir itself a limb does not show it."""
    views = limb_views(altitude_m, azimuths_rad=SQUARE)
    drawn = draw(views, altitude_m, scene)
    for axis in np.eye(3)[:2]:
        turn = Rotation.from_rotvec(np.radians(1.0) * axis).as_matrix()
        wrong = replace(views[1], rot_base_from_cam=turn @ views[1].rot_base_from_cam)
        fix = SENSOR.process(as_frames((views[0], wrong), drawn))
        if fix.ok:
            assert error_deg(fix, NADIR) < max(0.1, 4.0 * sigma_deg(fix))
        else:
            assert_refused(fix, 2)
    right = SENSOR.process(as_frames(views, drawn))
    assert right.ok, right.reason
    assert right.cameras_used == ("camera_1", "camera_2")


def test_the_refusal_names_the_cameras_that_disagree() -> None:
    views = limb_views(900e3, azimuths_rad=SQUARE)
    turn = Rotation.from_rotvec([np.radians(3.0), 0.0, 0.0]).as_matrix()
    wrong = replace(views[1], rot_base_from_cam=turn @ views[1].rot_base_from_cam)
    fix = SENSOR.process(as_frames((views[0], wrong), draw(views, 900e3)))
    assert fix.status is Status.CAMERAS_DISAGREE
    assert "camera_1" in fix.reason
    assert "camera_2" in fix.reason
    assert "3.0 deg" in fix.reason


def test_the_refusal_tells_of_every_camera() -> None:
    """One limb is doubted, and then the other camera has none."""
    one, two = clouded_pair()
    dark = replace(two, gray=np.full_like(two.gray, 5))
    fix = HorizonSensor(HorizonConfig(min_contrast=1e4)).process([one, dark])
    assert_refused(fix, 2)
    assert "camera_1: faint limb" in fix.reason
    assert "camera_2: 0 candidates" in fix.reason


def test_a_limb_below_the_suns_streak() -> None:
    """One camera's; the other one's is hardly lit. The streak was followed in its place."""
    scene = hard_scene("sun", 413, 555)
    fix = SENSOR.process(as_frames(scene.views, scene.frames))
    assert fix.cameras_used == ("camera_1",)
    assert nees(fix, scene.frames[0].truth.nadir_base) < 11.8


def test_two_cameras_outvote_a_third() -> None:
    views = limb_views(600e3, azimuths_rad=(0.0, 1.5, -1.5))
    drawn = draw(views, 600e3)
    turn = Rotation.from_rotvec([0.0, np.radians(2.0), 0.0]).as_matrix()
    wrong = replace(views[2], rot_base_from_cam=turn @ views[2].rot_base_from_cam)
    fix = SENSOR.process(as_frames((*views[:2], wrong), drawn))
    if fix.ok:
        assert error_deg(fix, NADIR) < 0.05
        assert fix.cameras_used == ("camera_1", "camera_2")
    else:
        assert_refused(fix, 3)


def test_a_camera_of_little_noise_claims_what_clouds_take() -> None:
    """Their edges follow no law to a hundredth: with less noise errors stay what they were."""
    nees_of = []
    for seed in range(16):
        altitude_m = 350e3 + 30e3 * seed
        views = limb_views(altitude_m, azimuths_rad=(0.4 * seed,))
        imaging = Imaging(noise_dn=0.4, bits=16)
        (frame,) = draw(views, altitude_m, clouds(seed), imaging, seed)
        fix = SENSOR.process([Frame(views[0], frame.image)])
        nees_of.append(nees(fix, frame.truth.nadir_base))
        SENSOR.reset()
    assert np.mean(nees_of) < 4.0


def test_a_followed_limb_beside_clouds_does_not_stray_into_space() -> None:
    """Where bright cloud thins out along the limb, the dark below a prediction in space was taken
    for texture, and the limb for where it was predicted: 1 deg off after two frames.
    """
    rng = np.random.default_rng([11, 74, 0x71])
    altitude_m = float(np.exp(rng.uniform(np.log(300e3), np.log(1200e3))))
    nadir = random_direction(rng)
    across = np.cross(nadir, random_direction(rng))
    across /= np.linalg.norm(across)
    off = PLANET.rho_from_altitude(altitude_m) + rng.uniform(-0.15, 0.15)
    axis = np.cos(off) * nadir + np.sin(off) * across
    rot_world_from_base = rot_from_axis(axis, float(rng.uniform(0.0, 2.0 * np.pi)))
    scene = clouds(int(rng.integers(2**31)))
    turn_rad = np.radians(0.1) * random_direction(rng)
    view = CameraView("camera_1", CAMERA, np.eye(3))
    sensor = HorizonSensor()
    for step in range(3):
        turned = rot_world_from_base @ Rotation.from_rotvec(step * turn_rad).as_matrix()
        position_m = -nadir * (PLANET.radius_m + altitude_m)
        (frame,) = render_views((view,), turned, position_m, scene, rng, imaging=Imaging())
        fix = sensor.process([Frame(view, frame.image)])
        assert error_deg(fix, frame.truth.nadir_base) < 0.3
        assert nees(fix, frame.truth.nadir_base) < 11.8


# ---------------------------------------------------------------- bad calls and bad frames


@pytest.mark.parametrize(("width", "height"), [(17, 9000), (9000, 17), (15, 15), (4096, 32)])
def test_frames_too_narrow_to_search_are_refused(width: int, height: int) -> None:
    camera = Camera(width, height, 1e3, 1e3, width / 2, height / 2)
    gray = np.random.default_rng(0).integers(0, 200, (height, width)).astype(np.uint8)
    fix = SENSOR.process([Frame(CameraView("camera_1", camera, np.eye(3)), gray)])
    assert_refused(fix, 1)
    assert fix.status is Status.BAD_IMAGE
    assert f"{width} x {height}" in fix.reason


def test_frame_of_another_size_than_its_camera() -> None:
    one, two = clouded_pair()
    half = replace(one, gray=np.ascontiguousarray(one.gray[::2, ::2]))
    alone = SENSOR.process([half])
    assert_refused(alone, 1)
    assert alone.status is Status.BAD_IMAGE
    assert "320 x 240" in alone.reason
    assert "640 x 480" in alone.reason
    both = SENSOR.process([half, two])
    assert both.ok
    assert both.cameras_used == ("camera_2",)
    assert both.limbs[0].status is Status.BAD_IMAGE


@pytest.mark.parametrize(
    "gray",
    [
        np.zeros((480, 640)),
        np.zeros((480, 640), np.int16),
        np.zeros((480, 640, 3), np.uint8),
        np.zeros(480 * 640, np.uint8),
        [[0, 1], [2, 3]],
    ],
    ids=["float", "int16", "colour", "flat", "list"],
)
def test_what_is_no_gray_image_is_the_callers_bug(gray: np.ndarray) -> None:
    one, two = clouded_pair()
    with pytest.raises(ValueError, match="camera_2"):
        SENSOR.process([one, replace(two, gray=gray)])


def test_no_frames_is_the_callers_bug() -> None:
    with pytest.raises(ValueError, match="frames"):
        SENSOR.process([])


def test_frames_are_left_as_they_were() -> None:
    frames = clouded_pair()[:1]
    before = [frame.gray.copy() for frame in frames]
    SENSOR.process(frames)
    for frame, copy in zip(frames, before, strict=True):
        np.testing.assert_array_equal(frame.gray, copy)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("method", "magic"),
        ("limb", "guess"),
        ("altitude_min_m", 0.0),
        ("altitude_min_m", 2e9),
        ("altitude_max_m", np.inf),
        ("altitude_max_m", np.nan),
        ("altitude_max_m", 1.0),
        ("max_nadir_sigma_rad", 0.0),
        ("max_nadir_sigma_rad", np.nan),
        ("max_residual_px", -1.0),
        ("min_contrast", np.inf),
        ("min_limb_share", 1.5),
        ("max_bright_sky", -0.1),
        ("min_clear_sky", np.nan),
        ("max_space_level", 2.0),
    ],
)
def test_configuration_that_makes_no_sense(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=field):
        HorizonConfig(**{field: value})  # type: ignore[arg-type]


def test_limb_above_the_highest_altitude_makes_no_sense() -> None:
    with pytest.raises(ValueError, match="altitude_max_m"):
        HorizonConfig(planet=Planet(limb_height_m=60e3), altitude_max_m=50e3)


def test_full_scale() -> None:
    assert full_scale(np.zeros((2, 2), np.uint8)) == 255
    for bits in (8, 10, 12, 14, 16):
        assert full_scale(np.full((2, 2), 2**bits - 1, np.uint16)) == 2**bits - 1
    assert full_scale(np.zeros((2, 2), np.uint16)) == 255


# ---------------------------------------------------------------- judgement by configuration


def test_a_camera_mounted_upside_down_is_no_fix() -> None:
    """Its nadir is opposite to the other's, as if it were the same line."""
    views = side_views(camera_from_fov(640, 480, np.radians(60.0)))
    flipped = replace(views[1], rot_base_from_cam=views[1].rot_base_from_cam @ np.diag([-1, -1, 1]))
    position = np.array([0.0, 0.0, -(PLANET.radius_m + 400e3)])
    drawn = render_views(
        (views[0], flipped), np.eye(3), position, EarthScene(), np.random.default_rng(1)
    )
    fix = SENSOR.process(as_frames(views, drawn))
    assert fix.status is Status.CAMERAS_DISAGREE
    assert "180.0 deg" in fix.reason


@pytest.mark.parametrize("cameras", [1, 2])
def test_a_known_altitude_leaves_the_limb_where_the_frames_show_it(cameras: int) -> None:
    """A limb higher than thought is that of another altitude, and no less a limb for it."""
    planet = replace(PLANET, limb_height_m=10e3)
    views = limb_views(500e3, azimuths_rad=SQUARE[:cameras])
    drawn = draw(views, 500e3, EarthScene(planet=planet))
    sensor = HorizonSensor(HorizonConfig(limb_height_sigma_m=10e3))
    aiding = Aiding(altitude=AltitudeMeasurement(500e3, 100.0))
    for _ in range(2):
        fix = sensor.process(as_frames(views, drawn), aiding)
        assert fix.ok, fix.reason
        assert fix.fit.altitude_m == pytest.approx(500e3, abs=100.0)
        assert error_deg(fix, NADIR) < 3.0 * sigma_deg(fix)
        for view, limb in zip(views, fix.limbs, strict=True):
            assert fix.residual_px(view, limb) < 0.1
    assert sensor.following


def test_altitude_outside_the_bounds_is_refused() -> None:
    for low, high in ((10e3, 450e3), (550e3, 1e8)):
        config = HorizonConfig(altitude_min_m=low, altitude_max_m=high)
        assert_refused(HorizonSensor(config).process(clouded_pair()), 2)


def test_uncertain_estimates_are_withheld() -> None:
    config = HorizonConfig(max_nadir_sigma_rad=1e-7)
    fix = HorizonSensor(config).process(clouded_pair())
    assert_refused(fix, 2)
    assert fix.status is Status.UNCERTAIN


def test_ragged_limbs_are_withheld() -> None:
    fix = HorizonSensor(HorizonConfig(max_residual_px=1e-3)).process(clouded_pair())
    assert_refused(fix, 2)
    assert fix.status is Status.POOR_FIT


def test_faint_limbs_are_withheld() -> None:
    fix = HorizonSensor(HorizonConfig(min_contrast=1e6)).process(clouded_pair())
    assert_refused(fix, 2)
    assert "faint" in fix.reason


def test_ellipsoid_is_fitted_by_its_mean_sphere_and_says_so() -> None:
    sphere = clouded_fix()
    ellipsoid = HorizonSensor(HorizonConfig(planet=Planet.wgs84())).process(clouded_pair())
    assert ellipsoid.ok
    assert error_deg(ellipsoid, sphere.fit.nadir_base) < 0.02
    assert 0.09 < np.sqrt(sigma_deg(ellipsoid) ** 2 - sigma_deg(sphere) ** 2) < 0.25
    altitude_sigma = [np.sqrt(f.fit.cov_nadir_altitude[3, 3]) for f in (sphere, ellipsoid)]
    assert altitude_sigma[1] > 1.5e3 > altitude_sigma[0]
    # no certainty along nadir is made up, none is taken away
    cov = ellipsoid.fit.cov_nadir_altitude[:3, :3]
    assert ellipsoid.fit.nadir_base @ cov @ ellipsoid.fit.nadir_base < 1e-12


def test_limb_height_goes_into_the_altitude() -> None:
    height = 12e3
    sphere = clouded_fix()
    raised = HorizonSensor(HorizonConfig(planet=Planet(limb_height_m=height)))
    fix = raised.process(clouded_pair())
    assert error_deg(fix, sphere.fit.nadir_base) < 5e-3
    scale = 1.0 + height / PLANET.radius_m
    want = (PLANET.radius_m + sphere.fit.altitude_m) * scale - PLANET.radius_m
    assert fix.fit.altitude_m == pytest.approx(want, abs=300.0)


# ---------------------------------------------------------------- scenes and photographs of others

WITHIN_DEG = {
    **dict.fromkeys(["flat", "clouds", "air", "dim", "sun", "moon", "boom", "lens", "high"], 0.1),
    "wgs84": 0.3,
}


@pytest.mark.parametrize("kind", sorted(WITHIN_DEG))
def test_shared_scenes_with_both_cameras(kind: str, shared_data: Path) -> None:
    truth = shared_truths(shared_data)[f"{kind}0"]
    fix = SENSOR.process(shared_frames(shared_data, truth))
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_1", "camera_2")
    assert error_deg(fix, np.array(truth["nadir_body"])) < WITHIN_DEG[kind]
    if truth["geodetic_nadir_body"] is not None:
        assert error_deg(fix, np.array(truth["geodetic_nadir_body"])) < WITHIN_DEG[kind]
    # glow and clouds stand above the ground
    assert fix.fit.altitude_m == pytest.approx(truth["altitude_km"] * 1e3, abs=30e3, rel=0.02)


@pytest.mark.parametrize("kind", ["terminator", "balloon"])
def test_shared_scenes_within_bounds_or_no_fix(kind: str, shared_data: Path) -> None:
    truth = shared_truths(shared_data)[f"{kind}0"]
    fix = SENSOR.process(shared_frames(shared_data, truth))
    if fix.ok:
        assert error_deg(fix, np.array(truth["nadir_body"])) < 0.3
    else:
        assert_refused(fix, 2)


@pytest.mark.parametrize(("i", "seed"), [(5, 4242), (32, 4242), (76, 6006)])
def test_a_limb_in_even_glow_is_not_held_to_edges_in_the_others_uneven_glow(
    i: int, seed: int
) -> None:
    """Towards the night one camera's glow cannot be told from the limb, the other's can; by edges
    in the glow of both nadir was .09 to .18 deg off.
    """
    kind = "terminator"
    scene = hard_scene(kind, i, seed)
    frames = as_frames(scene.views, scene.frames)
    sensor = HorizonSensor()
    fix = sensor.process(frames)
    assert fix.ok, fix.reason
    assert len(fix.cameras_used) == 1
    assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.06
    assert any("is not told from the glow" in limb.reason for limb in fix.limbs)
    # Followed it is the same limb.
    again = sensor.process(frames)
    assert again.cameras_used == fix.cameras_used
    assert error_deg(again, fix.fit.nadir_base) < 0.5 * sigma_deg(fix)


@pytest.mark.parametrize(
    ("kind", "i", "seed"), [("moon", 84, 0), ("flare", 148, 0), ("balloon", 37, 2718)]
)
def test_cameras_that_agree_when_asked_about_one_anothers_cone(
    kind: str, i: int, seed: int
) -> None:
    """Together they had no fix: by stars, a ghost or thick air a consensus of both was none's."""
    scene = hard_scene(kind, i, seed)
    frames = as_frames(scene.views, scene.frames)
    sensor = HorizonSensor()
    fix = sensor.process(frames)
    assert fix.ok, fix.reason
    assert len(fix.cameras_used) == 2
    assert nees(fix, scene.frames[0].truth.nadir_base) < 9.0


def test_cameras_that_are_not_mounted_as_told_have_no_fix_by_themselves_either() -> None:
    """Each sees its limb well, and the other one's cone is not where it sees it."""
    scene = hard_scene("flare", 148, 0)
    one, two = as_frames(scene.views, scene.frames)
    turned = Rotation.from_rotvec(np.radians([0.0, 0.0, 2.0])).as_matrix()
    view = replace(two.view, rot_base_from_cam=two.view.rot_base_from_cam @ turned)
    fix = HorizonSensor().process([one, Frame(view, two.gray)])
    assert not fix.ok


@pytest.mark.parametrize(
    ("kind", "i", "seed"),
    [("high", 226, 6006), ("high", 81, 6006), ("high", 140, 6006)],
)
def test_a_camera_that_is_surer_alone_is_taken_alone(kind: str, i: int, seed: int) -> None:
    """What the other's limb is off by along all of it drew nadir .04 deg away."""
    scene = hard_scene(kind, i, seed)
    frames = as_frames(scene.views, scene.frames)
    sensor = HorizonSensor()
    fix = sensor.process(frames)
    assert fix.ok, fix.reason
    (used,) = fix.cameras_used
    assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.02
    (other,) = [
        limb for view, limb in zip(scene.views, fix.limbs, strict=True) if view.name != used
    ]
    assert (other.status, other.reason) == (Status.OK, "the other camera is surer without it")
    again = sensor.process(frames)
    assert sensor.following
    assert error_deg(again, scene.frames[0].truth.nadir_base) < 0.02


def test_the_sun_alone_raises_no_warning() -> None:
    """Taken for a disc from far away, no air is in sight above it."""
    rows, columns = np.indices((480, 640))
    radius_px = np.hypot(columns - 245.0, rows - 62.0)
    noise = np.random.default_rng(3).normal(0.0, 1.0, radius_px.shape)
    gray = np.clip(5751.0 / (1.0 + (radius_px / 16.0) ** 3.5) + 4.0 + noise, 0.0, 255.0)
    (view,) = limb_views(400e3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fix = HorizonSensor().process([Frame(view, gray.astype(np.uint8))])
    assert not fix.ok or fix.fit.altitude_m > 9e6


@pytest.mark.parametrize("i", [159, 199, 254, 264])
def test_both_limbs_are_told_from_long_glow(i: int) -> None:
    """From a balloon glow reaches over nine pixels; of these pairs one limb or none was told from
    it, since the fit ran out of steps, began too far off, or was taken for smeared: nadir was .05
    to .5 deg off.
    """
    scene = hard_scene("balloon", i, 902)
    fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
    assert fix.ok, fix.reason
    assert all(limb.joint for limb in fix.limbs)
    assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.1
    assert nees(fix, scene.frames[0].truth.nadir_base) < 11.83


@pytest.mark.parametrize(("i", "index"), [(10, 1), (13, 1)])
def test_a_limb_under_glow_whose_blur_is_far_from_its_edges_claims_more(i: int, index: int) -> None:
    """From a balloon glow and blur are mistaken for each other, and with them how the limb bends:
    nadir was off by 3 and 4.3 sigma.
    """
    scene = hard_scene("balloon", i, 4321)
    fix = fix_of_one(scene, index)
    assert fix.ok, fix.reason
    assert fix.limbs[0].joint
    assert nees(fix, scene.frames[index].truth.nadir_base) < 9.0


def test_edges_in_glow_say_how_far_they_turn_a_limb() -> None:
    """One overexposed camera: they turned it by 3.9 sigma."""
    scene = hard_scene("saturated", 26, 4321)
    fix = fix_of_one(scene, 0)
    assert fix.ok, fix.reason
    assert not fix.limbs[0].joint
    assert nees(fix, scene.frames[0].truth.nadir_base) < 9.0


def test_saturated_samples_speak_neither_for_a_limb_under_glow_nor_against_it() -> None:
    """Their residuals made stretches outliers, and the fit of limb and glow was given up."""
    scene = hard_scene("saturated", 45, 4321)
    fix = fix_of_one(scene, 0)
    assert fix.ok, fix.reason
    assert fix.limbs[0].joint
    assert nees(fix, scene.frames[0].truth.nadir_base) < 9.0


def test_a_camera_whose_edge_bends_unlike_a_limb_by_itself_is_left_out() -> None:
    """There was no fix, where the other camera's is good."""
    scene = hard_scene("flare", 306, 0)
    fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_1",)
    assert "bends unlike a limb" in fix.limbs[1].reason
    assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.05


def test_shared_night(shared_data: Path) -> None:
    truth = shared_truths(shared_data)["night0"]
    assert_refused(SENSOR.process(shared_frames(shared_data, truth)), 2)


def test_a_bank_of_cloud_along_one_end_of_a_large_frames_limb() -> None:
    """The consensus takes the cloud's edge for the limb there, 25 px off: out of the next reach."""
    rng = np.random.default_rng([991, 5, 3])
    altitude_m = float(np.exp(rng.uniform(np.log(300e3), np.log(1200e3))))
    nadir = random_direction(rng)
    across = np.cross(nadir, random_direction(rng))
    off = PLANET.rho_from_altitude(altitude_m) + rng.uniform(-0.15, 0.15)
    axis = np.cos(off) * nadir + np.sin(off) * across / np.linalg.norm(across)
    rot = rot_from_axis(axis, float(rng.uniform(0.0, 2.0 * np.pi)))
    view = CameraView("camera_1", camera_from_fov(2048, 1536, np.radians(60.0)), np.eye(3))
    position = -nadir * (PLANET.radius_m + altitude_m)
    drawn = render_views((view,), rot, position, clouds(int(rng.integers(2**31))), rng)
    fix = SENSOR.process(as_frames((view,), drawn))
    assert error_deg(fix, rot.T @ nadir) < min(0.05, 4.0 * sigma_deg(fix))


@pytest.mark.parametrize("kind", ["space", "earth"])
def test_shared_scenes_with_a_blind_camera(kind: str, shared_data: Path) -> None:
    truth = shared_truths(shared_data)[f"{kind}0"]
    frames = shared_frames(shared_data, truth)
    assert_refused(SENSOR.process(frames[:1]), 1)
    fix = SENSOR.process(frames)
    assert "camera_1" not in fix.cameras_used
    if fix.ok:
        assert error_deg(fix, np.array(truth["nadir_body"])) < max(0.3, 4.0 * sigma_deg(fix))
        # What it says is of itself.
        assert "camera_2" not in fix.limbs[0].reason


def test_photograph_by_day(shared_data: Path) -> None:
    frame = photograph(shared_data / "earth_real" / "iss064_flickr50644513538.jpg", 56.0)
    fix = SENSOR.process([frame])
    assert fix.ok, fix.reason
    assert 250e3 < fix.fit.altitude_m < 600e3


def test_photograph_flooded_by_the_sun(shared_data: Path) -> None:
    frame = photograph(shared_data / "earth_real" / "ISS028-E-33700.JPG", 15.0)
    assert_refused(SENSOR.process([frame]), 1)


def test_a_lens_model_that_ends_inside_the_frame_is_no_error() -> None:
    """Beside its end one pixel farther out is nowhere: a limb in glow raised IndexError there."""
    for seed in (27, 39):
        rng = np.random.default_rng(seed)
        focal_px = float(rng.uniform(260.0, 330.0))
        barrel = (float(rng.uniform(-0.45, -0.33)), 0.02, 1e-3, -1e-3, 0.0)
        camera = Camera(640, 480, focal_px, focal_px, 319.5, 239.5, "plumb_bob", barrel)
        altitude_m = float(np.exp(rng.uniform(np.log(300e3), np.log(2000e3))))
        above, azimuth, roll = rng.uniform(-0.3, 0.3), rng.uniform(0, 6), rng.uniform(0, 6)
        views = limb_views(
            altitude_m, camera, (float(azimuth),), float(roll) - 1.0, above_rad=float(above)
        )
        scene = EarthScene(uniform_dn=150.0, air_dn=100.0, air_inside=0.6)
        drawn = draw(views, altitude_m, scene, Imaging(noise_dn=1.5), seed)
        fix = SENSOR.process(as_frames(views, drawn))
        assert not fix.ok or error_deg(fix, NADIR) < 4.0 * sigma_deg(fix)


@pytest.mark.parametrize("shape", [(16, 2000), (33, 3000), (2000, 16), (100, 2048)])
def test_strips_are_frames_too(shape: tuple[int, int]) -> None:
    """Of a line camera, or a region of interest: lower than a tile of the reduced frame."""
    height, width = shape
    focal_px = float(max(shape))
    camera = Camera(width, height, focal_px, focal_px, width / 2.0, height / 2.0)
    view = CameraView("strip", camera, np.eye(3))
    noise = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    step = np.full(shape, 30, np.uint8)
    step[height // 2 :] = 200
    for image in (noise, step):
        assert not SENSOR.process([Frame(view, image)]).ok

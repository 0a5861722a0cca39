"""Frames that are read out row by row: rays at the time of the stamp, and fixes of such frames."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from limb_frames import limb_views
from limb_samples import CAMERAS, nadir_nees
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import Aiding, CoarsePose
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.readout import view_at_stamp
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.nadir_rate import NadirRate
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.motion.turn_rate import TurnRate
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging

READOUT_S, PERIOD_S = 0.02, 1.0 / 30.0
ALTITUDE_M = 600e3
USUAL_RAD_S = HorizonConfig().rate_sigma_rad_s
ROT = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()
rates = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def coarse_pose(nadir_base: np.ndarray, age_s: float) -> CoarsePose:
    """Above the equator, north somewhere about that nadir, told so long ago."""
    up = -nadir_base
    pole = np.cross(up, np.roll(up, 1))
    pole /= np.linalg.norm(pole)
    rot = np.stack([up, np.cross(pole, up), pole])
    return CoarsePose(np.array([6378137.0 + ALTITUDE_M, 0.0, 0.0]), rot, age_s=age_s)


def turning(camera: Camera, rate: np.ndarray, readout_s: float) -> Camera:
    view = CameraView("camera_1", camera, ROT, readout_s=readout_s)
    return view_at_stamp(view, TurnRate(rate, 0.0)).camera


@given(rates, st.sampled_from(CAMERAS), st.sampled_from([READOUT_S, -READOUT_S]))
def test_rays_are_turned_by_what_the_craft_turned_since_the_stamp(
    rate: np.ndarray, camera: Camera, readout_s: float
) -> None:
    px = np.random.default_rng(0).uniform(0.2, 0.8, (50, 2)) * (camera.width, camera.height)
    rows = px[:, 1] if readout_s > 0.0 else camera.height - 1.0 - px[:, 1]
    time_s = READOUT_S * rows / (camera.height - 1.0)
    seen = camera.rays(px) @ ROT.T
    want = Rotation.from_rotvec(time_s[:, None] * rate).apply(seen)
    np.testing.assert_allclose(turning(camera, rate, readout_s).rays(px) @ ROT.T, want, atol=1e-12)


@given(rates, st.sampled_from(CAMERAS), st.sampled_from([READOUT_S, -READOUT_S]))
def test_pixels_and_their_derivatives_are_those_of_the_rays(
    rate: np.ndarray, camera: Camera, readout_s: float
) -> None:
    camera = turning(camera, rate, readout_s)
    rng = np.random.default_rng(1)
    px = rng.uniform(0.2, 0.8, (50, 2)) * (camera.width, camera.height)
    rays = camera.rays(px)
    np.testing.assert_allclose(camera.pixels(rays), px, atol=1e-5)
    found, jacobian = camera.project(rays)
    np.testing.assert_allclose(found, px, atol=1e-5)
    along = 1e-5 * rng.standard_normal(rays.shape)
    moved = 0.5 * (camera.pixels(rays + along) - camera.pixels(rays - along))
    expected = np.einsum("nij,nj->ni", jacobian, along)
    np.testing.assert_allclose(moved, expected, atol=1e-5)
    np.testing.assert_allclose(camera.project_along(rays, along)[1], expected, atol=1e-12)


def test_a_turning_cameras_focal_length_is_that_of_its_lens() -> None:
    camera = turning(CAMERAS[0], np.array([0.1, 0.2, 0.3]), READOUT_S).with_focal_scale(1.1)
    px = np.array([[10.0, 20.0], [500.0, 400.0]])
    longer = turning(CAMERAS[0].with_focal_scale(1.1), np.array([0.1, 0.2, 0.3]), READOUT_S)
    assert (camera.fx, camera.fy) == (longer.fx, longer.fy)
    np.testing.assert_array_equal(camera.rays(px), longer.rays(px))


def fit_at(nadir: np.ndarray, sigma_rad: float = 1e-4) -> HorizonFit:
    across = np.eye(3) - np.outer(nadir, nadir)
    cov = np.zeros((4, 4))
    cov[:3, :3] = sigma_rad**2 * across
    return HorizonFit(Status.OK, "", "", nadir, 1.0, ALTITUDE_M, cov)


@given(rates)
def test_a_steady_rate_is_found_but_for_its_part_about_nadir(rate: np.ndarray) -> None:
    nadir = np.array([0.36, -0.48, 0.8])
    found = NadirRate()
    for step in range(20):
        time_s = (step - 19) * PERIOD_S
        # Vectors that stand still turn by -rate in the base frame.
        still = Rotation.from_rotvec(-time_s * rate).apply(nadir)
        found.add(fit_at(still), PERIOD_S if step else None)
    now = found.now(USUAL_RAD_S)
    assert now is not None
    across = rate - (rate @ nadir) * nadir
    # A turn about nadir as well makes a cone of what nadir does.
    assert np.linalg.norm(now.rate_base_rad_s - across) < 0.2 * rate @ rate + 1e-9
    assert now.sigma_rad_s > 0.02 * np.linalg.norm(across)


@pytest.mark.parametrize(("amplitude_deg", "period_s"), [(6.0, 3.8), (3.0, 2.0), (10.0, 8.0)])
def test_a_rate_that_changes_is_claimed_where_a_swing_turns_back(
    amplitude_deg: float, period_s: float
) -> None:
    """The rate of a swing by its own derivative, for the set after the last fix."""
    nadir, axis = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])
    amplitude_rad, turn = np.radians(amplitude_deg), 2.0 * np.pi / period_s
    found, off = NadirRate(), []
    for step in range(100):
        time_s = step * PERIOD_S
        angle = amplitude_rad * np.sin(turn * time_s)
        still = Rotation.from_rotvec(-angle * axis).apply(nadir)
        found.add(fit_at(still), PERIOD_S if step else None)
        told = found.now(np.inf)
        if step >= 3:
            assert told is not None
            rate = amplitude_rad * turn * np.cos(turn * (time_s + PERIOD_S)) * axis
            off.append(np.linalg.norm(told.rate_base_rad_s - rate) / told.sigma_rad_s)
    assert max(off) < 3.0
    assert np.median(off) > 0.2  # nor is far more claimed than that


@given(st.lists(st.floats(1e-3, 2.0), min_size=1, max_size=30), rates)
def test_a_rate_is_found_however_the_sets_come(spans_s: list[float], rate: np.ndarray) -> None:
    """The fix before the last counts also where it is long ago, to the last bit of its time."""
    found, nadir = NadirRate(), np.array([0.0, 0.6, 0.8])
    found.add(fit_at(nadir), None)
    for span_s in spans_s:
        nadir = Rotation.from_rotvec(-0.1 * span_s * rate).apply(nadir)
        found.add(fit_at(nadir), span_s)
        told = found.now(np.inf)
        assert told is not None
        across = 0.1 * (rate - (rate @ nadir) * nadir)
        assert np.linalg.norm(told.rate_base_rad_s - across) < 0.05


def test_no_rate_without_two_sure_fixes_in_succession() -> None:
    nadir = np.array([0.0, 0.0, 1.0])
    none = HorizonFit.none(Status.NO_LIMB, "dark", "")
    found = NadirRate()
    for fit, since_last_s, known in (
        (fit_at(nadir), None, False),
        (fit_at(nadir), PERIOD_S, True),
        (none, PERIOD_S, False),
        (fit_at(nadir), PERIOD_S, False),
        (fit_at(nadir), PERIOD_S, True),
        (fit_at(nadir), None, False),
        (fit_at(nadir), 5.0, False),
        (fit_at(nadir, 0.1), PERIOD_S, False),
    ):
        found.add(fit, since_last_s)
        assert (found.now(USUAL_RAD_S) is not None) == known


@lru_cache(maxsize=8)
def flight(rate_deg_s: float, seed: int, count: int) -> tuple[np.ndarray, list[list[SimFrame]]]:
    """Sets of frames of two cameras that are read out while the craft turns steadily."""
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal(3)
    rate = np.radians(rate_deg_s) * axis / np.linalg.norm(axis)
    scene = EarthScene(texture="clouds", texture_seed=seed)
    position = np.array([0.0, 0.0, -(scene.planet.radius_m + ALTITUDE_M)])
    sets = [
        render_views(
            limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8)),
            Rotation.from_rotvec((step + 1 - count) * PERIOD_S * rate).as_matrix(),
            position,
            scene,
            rng,
            imaging=Imaging(noise_dn=2.0),
            readout_turn_base_rad=READOUT_S * rate,
        )
        for step in range(count)
    ]
    return rate, [list(frames) for frames in sets]


def fixes(
    sets: list[list[SimFrame]], readout_s: float, rate: np.ndarray | None
) -> list[HorizonFix]:
    """Fixes of successive sets. rate : as a gyro tells it."""
    views = [
        replace(view, readout_s=readout_s)
        for view in limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8))
    ]
    sensor = HorizonSensor()
    out = []
    for frames in sets:
        aiding = Aiding(rate_base_rad_s=rate, since_last_s=PERIOD_S if out else None)
        shown = [Frame(view, frame.image) for view, frame in zip(views, frames, strict=True)]
        out.append(sensor.process(shown, aiding))
        assert out[-1].ok, out[-1].reason
    return out


@pytest.mark.parametrize("seed", [1, 2])
def test_a_gyro_brings_the_rows_to_their_stamp(seed: int) -> None:
    """Taken for frames of one moment they are off by .1 deg, and the cameras contradict each other
    at best.
    """
    rate, sets = flight(10.0, seed, 1)
    truth = sets[0][0].truth.nadir_base
    (at_once,), (by_row,) = fixes(sets, 0.0, rate), fixes(sets, READOUT_S, rate)
    assert angle_rad(at_once.fit.nadir_base, truth) > np.radians(0.05)
    assert nadir_nees(at_once.fit, truth) > 30.0 or "sigma apart" in at_once.reason
    assert angle_rad(by_row.fit.nadir_base, truth) < np.radians(0.02)
    assert nadir_nees(by_row.fit, truth) < 11.8
    assert abs(by_row.fit.altitude_m - ALTITUDE_M) < 1500.0
    # The drawn limb lies where the rows show it.
    view, limb = by_row.views[0], by_row.limbs[0]
    assert by_row.residual_px(view, limb) < 0.5
    assert at_once.views == ()


def test_without_a_gyro_the_fixes_before_tell_the_rate() -> None:
    _, sets = flight(5.0, 3, 4)
    first, *_, last = fixes(sets, READOUT_S, None)
    truth = sets[-1][0].truth.nadir_base
    assert angle_rad(last.fit.nadir_base, truth) < np.radians(0.02)
    assert nadir_nees(last.fit, truth) < 11.8
    # What nothing is known of is claimed, and said.
    assert first.reason == "frames are not of one moment, and how fast the craft turns is not known"
    assert last.reason == ""
    assert nadir_nees(first.fit, sets[0][0].truth.nadir_base) < 11.8
    assert np.trace(first.fit.cov_nadir_altitude[:3, :3]) > np.trace(
        last.fit.cov_nadir_altitude[:3, :3]
    )


@pytest.mark.parametrize("blind", [False, True])
def test_cameras_that_are_not_triggered_together_are_brought_to_one_time(blind: bool) -> None:
    """The second 15 ms later, at 5 deg/s. Its time is that of the fix where the first is blind."""
    rng = np.random.default_rng(8)
    axis, later_s = rng.standard_normal(3), 0.015
    rate = np.radians(5.0) * axis / np.linalg.norm(axis)
    scene = EarthScene()
    position = np.array([0.0, 0.0, -(scene.planet.radius_m + ALTITUDE_M)])
    views = limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8))
    frames, truths = [], []
    for view, after_s in zip(views, (0.0, later_s), strict=True):
        turned = Rotation.from_rotvec(after_s * rate).as_matrix()
        (drawn,) = render_views((view,), turned, position, scene, rng)
        frames.append(Frame(view, drawn.image, after_s))
        truths.append(drawn.truth.nadir_base)
    if blind:
        frames[0] = replace(frames[0], gray=np.full_like(frames[0].gray, 4))
    at_once = HorizonSensor().process([replace(frame, after_s=0.0) for frame in frames])
    sensor = HorizonSensor()
    aiding = Aiding(rate_base_rad_s=rate)
    for _ in range(2):
        fix = sensor.process(frames, aiding)
        assert fix.ok, fix.reason
        assert nadir_nees(fix.fit, truths[blind]) < 11.8
        assert angle_rad(fix.fit.nadir_base, truths[blind]) < np.radians(0.05)
    assert angle_rad(truths[0], truths[1]) > np.radians(0.03)
    if not blind:
        assert nadir_nees(at_once.fit, truths[0]) > 11.8 or "sigma apart" in at_once.reason
    # Without a rate what that leaves open is claimed, and said.
    unknown = HorizonSensor().process(frames)
    assert blind or "not of one moment" in unknown.reason
    assert nadir_nees(unknown.fit, truths[blind]) < 11.8


@pytest.mark.parametrize("readout_s", [0.0, READOUT_S, -1.0])
@pytest.mark.parametrize("after_s", [0.0, 0.02, -5.0])
@pytest.mark.parametrize("rate_rad_s", [0.0, 1.0, 100.0])
def test_no_times_and_no_rates_break_it(
    readout_s: float, after_s: float, rate_rad_s: float
) -> None:
    """Turns within a set that are too far for an answer are refused."""
    _, ((first, second),) = flight(0.0, 5, 1)
    views = [
        replace(view, readout_s=readout_s)
        for view in limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8))
    ]
    rate = rate_rad_s * np.array([0.6, 0.48, 0.64])
    shown = [Frame(views[0], first.image), Frame(views[1], second.image, after_s)]
    fix = HorizonSensor().process(shown, Aiding(rate_base_rad_s=rate))
    longest_s = abs(readout_s) + abs(after_s)
    if rate_rad_s * longest_s > 0.1:
        assert fix.status is Status.UNCERTAIN
        assert "deg within a set of frames, at most 6 will do" in fix.reason
    elif rate_rad_s == 0.0 and longest_s < 0.1:
        assert fix.ok


@pytest.mark.parametrize("posed", [False, True])
def test_a_gyro_that_the_fixes_contradict_is_not_believed(posed: bool) -> None:
    """Nor for what the craft has turned since a coarse pose, which it made a heading not known."""
    _, sets = flight(2.0, 7, 4)
    truth = sets[-1][0].truth.nadir_base
    views = [
        replace(view, readout_s=READOUT_S)
        for view in limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8))
    ]
    pose = coarse_pose(truth, 1.0) if posed else None
    config = HorizonConfig(planet=Planet.wgs84() if posed else Planet())
    without, wrong = HorizonSensor(config), HorizonSensor(config)
    for step, frames in enumerate(sets):
        glitch = np.array([4.0, -2.0, 1.0]) if step == len(sets) - 1 else None
        aiding = Aiding(pose, since_last_s=PERIOD_S if step else None)
        shown = [Frame(view, frame.image) for view, frame in zip(views, frames, strict=True)]
        rates = (None, glitch)
        fix, doubted = (
            sensor.process(shown, replace(aiding, rate_base_rad_s=rate))
            for sensor, rate in zip((without, wrong), rates, strict=True)
        )
    assert posed or nadir_nees(doubted.fit, truth) < 11.8
    assert fix.ok
    np.testing.assert_array_equal(doubted.fit.nadir_base, fix.fit.nadir_base)
    np.testing.assert_array_equal(doubted.fit.cov_nadir_altitude, fix.fit.cov_nadir_altitude)
    assert doubted.gyro_refused
    assert "not the one by which the horizon moves" in doubted.reason


@pytest.mark.parametrize("rate_rad_s", [0.4, 0.8, -1.2])
def test_a_gyro_that_is_far_off_from_the_start_does_not_take_all_fixes(rate_rad_s: float) -> None:
    """In deg/s, say. Only fixes contradict it, and there were none."""
    (first, second) = flight(0.0, 6, 1)[1][0]
    views = limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8))
    shown = [Frame(views[0], first.image), Frame(views[1], second.image, 0.05)]
    rate = rate_rad_s * np.array([0.6, -0.8, 0.0])
    fix = HorizonSensor().process(shown, Aiding(rate_base_rad_s=rate))
    assert fix.cameras_used == ("camera_1", "camera_2")
    assert "with the rate on imu no horizon fits" in fix.reason
    assert fix.gyro_refused
    assert nadir_nees(fix.fit, first.truth.nadir_base) < 11.8


def test_a_still_craft_loses_nothing_by_its_rolling_shutter() -> None:
    _, sets = flight(0.0, 4, 2)
    still = np.zeros(3)
    for at_once, by_row in zip(fixes(sets, 0.0, still), fixes(sets, READOUT_S, still), strict=True):
        np.testing.assert_allclose(by_row.fit.nadir_base, at_once.fit.nadir_base, atol=1e-9)
        sigma = np.sqrt(np.trace(by_row.fit.cov_nadir_altitude[:3, :3]))
        assert sigma < 1.1 * np.sqrt(np.trace(at_once.fit.cov_nadir_altitude[:3, :3]))


def test_what_is_known_of_the_rate_beforehand_is_claimed() -> None:
    (first, second) = flight(0.0, 6, 1)[1][0]
    views = limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8))
    shown = [Frame(views[0], first.image), Frame(views[1], second.image, 0.015)]
    slow, usual = (
        HorizonSensor(HorizonConfig(rate_sigma_rad_s=float(np.radians(rate)))).process(shown)
        for rate in (0.05, 3.0)
    )
    assert slow.reason == ""
    assert "not of one moment" in usual.reason
    assert np.trace(usual.fit.cov_nadir_altitude[:3, :3]) > 2.0 * np.trace(
        slow.fit.cov_nadir_altitude[:3, :3]
    )


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("rate_base_rad_s", np.array([0.0, np.nan, 0.0]), "finite rad/s"),
        ("rate_base_rad_s", np.zeros(2), "three"),
        ("rate_spread_rad_s", np.nan, "rate_spread_rad_s must be 0 or positive, got nan"),
        ("rate_spread_rad_s", -0.1, "rate_spread_rad_s must be 0 or positive, got -0.1"),
        ("since_last_s", 0.0, "positive, got 0.0"),
        ("since_last_s", np.inf, "positive, got inf"),
    ],
)
def test_what_is_no_rate_or_time_is_the_callers_bug(field: str, value: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Aiding(**{field: value})


def test_a_readout_that_is_no_time_is_the_callers_bug() -> None:
    with pytest.raises(ValueError, match="readout_s of 'camera_1' must be finite, got nan"):
        CameraView("camera_1", CAMERAS[0], np.eye(3), readout_s=np.nan)


def test_the_rate_is_over_the_time_from_fix_to_fix() -> None:
    """The second camera is 15 ms late; that the first is blind now and then is no other rate."""
    rate_rad_s, late_s, period_s = np.radians(5.0) * np.array([0.6, -0.8, 0.0]), 0.015, 0.05
    scene = EarthScene()
    position = np.array([0.0, 0.0, -(scene.planet.radius_m + ALTITUDE_M)])
    views = limb_views(ALTITUDE_M, azimuths_rad=(0.3, 1.8))
    sets: list[list[Frame]] = [[] for _ in range(4)]
    rng = np.random.default_rng(3)
    for step, shown in enumerate(sets):
        for view, after_s in zip(views, (0.0, late_s), strict=True):
            turned = Rotation.from_rotvec((step * period_s + after_s) * rate_rad_s).as_matrix()
            (drawn,) = render_views((view,), turned, position, scene, rng)
            shown.append(Frame(view, drawn.image, after_s))
    told = []
    for blind in ((), (2,), (0,)):
        sensor = HorizonSensor()
        for step, (first, second) in enumerate(sets):
            dark = replace(first, gray=np.full_like(first.gray, 4))
            frames = [dark if step in blind else first, second]
            fix = sensor.process(frames, Aiding(since_last_s=period_s if step else None))
            assert fix.ok, fix.reason
        told.append(fix.views[0].rate)
    for rate in told:
        assert rate is not None
        assert rate.nadir_base is not None
        off = rate.rate_base_rad_s - rate_rad_s
        off -= (off @ rate.nadir_base) * rate.nadir_base
        assert np.linalg.norm(off) < 3.0 * rate.sigma_rad_s
        assert np.linalg.norm(off) < 0.1 * np.linalg.norm(rate_rad_s)

"""Following the limb from frame to frame: the answer of a search, where the prediction is good."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from limb_frames import CAMERA, PLANET, as_frames, clouds, distance_px, draw, limb_views
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import NOTHING_KNOWN, Aiding
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.horizon.track import ConeStep, Track
from horizon_sensor_ros.core.limb import detector
from horizon_sensor_ros.core.limb.air import Air
from horizon_sensor_ros.core.limb.detection import LimbState
from horizon_sensor_ros.core.limb.detector import follow_limb
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.planet_figure import disc_of, mean_sphere
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import rot_from_axis

ALTITUDE_M = 500e3
VIEWS = limb_views(ALTITUDE_M, azimuths_rad=(0.0, 1.5))
ZENITH = np.array([0.6, 0.64, 0.48])
# One pixel is 0.1 deg: a turn of several pixels from frame to frame, too far to follow blindly.
TURN_RAD = np.radians(0.6) * np.array([0.8, -0.6, 0.0])
SEARCHING = HorizonConfig(tracking=False)


@lru_cache(maxsize=16)
def turned(steps: float, air_dn: float = 0.0) -> tuple[list[Frame], np.ndarray]:
    """Frames after so many turns of the base about its own axis, and nadir in the base (3,)."""
    rot_start_from_now = Rotation.from_rotvec(steps * TURN_RAD).as_matrix()
    rot_world_from_base = rot_from_axis(-ZENITH, 0.7) @ rot_start_from_now
    position = ZENITH * (PLANET.radius_m + ALTITUDE_M)
    drawn = render_views(
        VIEWS,
        rot_world_from_base,
        position,
        replace(clouds(2), air_dn=air_dn),
        np.random.default_rng(round(10 * steps)),
        imaging=Imaging(noise_dn=1.5),
    )
    return as_frames(VIEWS, drawn), -rot_world_from_base.T @ ZENITH


def sigma_rad(fix: HorizonFix) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(fix.fit.cov_nadir_altitude[:3, :3])[-1]))


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """One entry for every search of whole frames that a sensor makes."""
    made: list[int] = []
    search = detector.candidates_in

    def counted(*args: object, **kwargs: object) -> object:
        made.append(1)
        return search(*args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(detector, "candidates_in", counted)
    return made


def test_followed_fixes_are_those_of_a_search(searches: list[int]) -> None:
    sensor = HorizonSensor()
    for steps in range(4):
        frames, nadir = turned(steps)
        before = len(searches)
        fix = sensor.process(frames)
        followed = len(searches) == before
        # After two fixes the turn is known.
        assert followed == (steps > 0)
        searched = HorizonSensor(SEARCHING).process(frames)
        assert fix.ok
        assert searched.ok
        assert fix.cameras_used == searched.cameras_used
        assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)
        assert angle_rad(fix.fit.nadir_base, searched.fit.nadir_base) < sigma_rad(searched)
        assert sigma_rad(fix) == pytest.approx(sigma_rad(searched), rel=0.3)
        assert fix.fit.altitude_m == pytest.approx(searched.fit.altitude_m, rel=1e-3)


def test_a_track_that_cannot_be_followed_is_not_followed_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(*args: object, **kwargs: object) -> None:
        raise FloatingPointError("broken")

    sensor = HorizonSensor()
    assert sensor.process(turned(0)[0]).ok
    monkeypatch.setattr("horizon_sensor_ros.core.horizon.sensor.follow_limb", broken)
    with pytest.raises(FloatingPointError, match="broken"):
        sensor.process(turned(1)[0])
    assert sensor.process(turned(2)[0]).ok


@pytest.mark.parametrize(
    ("since_s", "steps"), [(0.1, 1.0), (0.25, 2.5), (0.3, 3.0), (0.4, 3.0), (60.0, 3.0), (None, 1)]
)
def test_a_limb_is_moved_on_by_three_steps_at_most(since_s: float | None, steps: float) -> None:
    """What a step is off by grows with their number; after a pause it says nothing."""
    step = Rotation.from_rotvec(np.radians([0.3, -0.4, 0.2]))
    before, rho_rad, growth_rad = np.array([0.36, 0.48, 0.8]), 1.1, 2e-4
    track = Track(
        views=(), cameras=(), nadir_base=step.apply(before), rho_rad=rho_rad,
        state=LimbState((), (), (), (), (), 0.0, ()), working=(), layer_rad=0.0, airglow=False,
        outside={}, elsewhere={}, step=ConeStep(before, rho_rad - growth_rad, 0.1),
    )  # fmt: skip
    nadir, rho = track.predicted_cone(None, since_s)
    # On along the great circle, whose axis is at right angles to both.
    axis = np.cross(before, track.nadir_base)
    step_rad = np.arcsin(np.linalg.norm(axis))
    turn = Rotation.from_rotvec(steps * step_rad * axis / np.linalg.norm(axis))
    np.testing.assert_allclose(nadir, turn.apply(track.nadir_base), atol=1e-12)
    assert rho == pytest.approx(rho_rad + steps * growth_rad)


@pytest.mark.parametrize("camera", [0, 1])
def test_the_limb_is_predicted_to_a_part_of_a_pixel(camera: int) -> None:
    """On one camera's arc, beside clouds: far better than nadir, or its disc, is known."""
    sensor = HorizonSensor()
    followed, apart = False, []
    for steps in range(10):
        frame = turned(steps)[0][camera]
        fix = sensor.process([frame])
        assert fix.ok
        # How fast the craft turns is known after a frame that was followed.
        if followed and fix.predicted is not None:
            # The points' own errors are the same about both.
            off = fix.predicted.residuals_px(frame.view, fix.limbs[0])
            off -= disc_of(fix.fit).residuals_px(frame.view, fix.limbs[0])
            apart.append(np.median(np.abs(off)))
        followed = fix.predicted is not None
    assert len(apart) >= 6
    assert np.median(apart) < 0.05
    assert np.max(apart) < 0.15


@pytest.mark.parametrize("air_dn", [60.0, pytest.param(150.0, marks=pytest.mark.slow)])
def test_in_glowing_air_too(air_dn: float, searches: list[int]) -> None:
    """Glow's edge lies off the steepest fall: a track must not slide from the one to the other."""
    sensor = HorizonSensor()
    followed = []
    for steps in range(5):
        frames, nadir = turned(steps, air_dn)
        before = len(searches)
        fix = sensor.process(frames)
        followed.append(len(searches) == before)
        searched = HorizonSensor(SEARCHING).process(frames)
        assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)
        # In strong glow one of the two may be fitted with the ground, the other by its contour.
        sigmas = 1.0 if air_dn < 100.0 else 3.0
        apart = angle_rad(fix.fit.nadir_base, searched.fit.nadir_base)
        assert apart < sigmas * sigma_rad(searched)
        altitude_sigma_m = np.sqrt(searched.fit.cov_nadir_altitude[3, 3])
        assert abs(fix.fit.altitude_m - searched.fit.altitude_m) < sigmas * altitude_sigma_m
    # In the stronger glow no model fits the edge of one camera: that is left to the search.
    assert sum(followed) >= (3 if air_dn < 100.0 else 0)


@pytest.mark.parametrize("blur_px", [0.8, 1.0])
def test_edges_in_air_that_is_hardly_any_keep_their_own_blur(blur_px: float) -> None:
    view = limb_views(ALTITUDE_M, azimuths_rad=(0.0,))[0]
    scene, imaging = clouds(5), Imaging(noise_dn=1.5, psf_sigma_px=blur_px)
    drawn = draw([view], ALTITUDE_M, scene, imaging, 3)[0]
    sphere = mean_sphere(PLANET)
    rho = PLANET.rho_from_altitude(ALTITUDE_M)
    cone = drawn.truth.nadir_base, rho
    # As a fit leaves it that began with another blur, as all do that separate a limb from thin air.
    air = Air(0.0013, np.array([0.5, 0.0, 0.0]), 0.5, 0.75, 6.0, 0.75, faint=True)
    held = EdgeLook(0.75, 1.0, air=air)
    before = LimbState((True,), ((held,),), (1,), (None,), (np.empty(0),), 0.0, (False,))
    found = follow_limb([view], [drawn.image], sphere, cone, before)
    assert found is not None
    look = found.looks[0][0]
    assert look.glow_px == 0.0
    # Beside the lens's, which pixels widen by their own.
    assert look.psf_px == pytest.approx(np.hypot(blur_px, 0.29), abs=0.06)
    off_px = distance_px(drawn.truth.limb, found.limbs[0].px)
    assert abs(np.median(off_px)) < 0.05


def test_a_gyro_tells_of_any_turn(searches: list[int]) -> None:
    sensor = HorizonSensor()
    far = 12.0  # 7 deg
    start, _ = turned(0)
    frames, nadir = turned(far)
    rot_now_from_start = Rotation.from_rotvec(-far * TURN_RAD).as_matrix()
    assert sensor.process(start).ok
    before = len(searches)
    fix = sensor.process(frames, Aiding(rot_now_from_last=rot_now_from_start))
    assert len(searches) == before
    assert fix.ok
    assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)


def test_an_unexpected_turn_is_searched_for(searches: list[int]) -> None:
    sensor = HorizonSensor()
    assert sensor.process(turned(0)[0]).ok
    frames, nadir = turned(12.0)
    before = len(searches)
    fix = sensor.process(frames)
    assert len(searches) > before
    alone = HorizonSensor(SEARCHING).process(frames)
    np.testing.assert_array_equal(fix.fit.nadir_base, alone.fit.nadir_base)
    assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)


@pytest.mark.parametrize("timed", [True, False])
def test_a_fast_turn_is_followed_after_two_searches(timed: bool, searches: list[int]) -> None:
    """By up to 70 pixels a set: the limb is not near where it was, but where it goes to."""
    sensor = HorizonSensor()
    followed = []
    for steps in (0, 12, 24, 36):
        frames, nadir = turned(steps)
        before = len(searches)
        fix = sensor.process(frames, Aiding(since_last_s=0.5 if timed and steps else None))
        assert fix.ok
        assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)
        followed.append(len(searches) == before)
    assert followed == [False, False, True, True]


def test_a_set_that_did_not_come_is_reckoned_with(searches: list[int]) -> None:
    sensor = HorizonSensor()
    for steps, since_s in ((0, None), (12, 0.5), (24, 0.5), (48, 1.0)):
        frames, nadir = turned(steps)
        before = len(searches)
        fix = sensor.process(frames, Aiding(since_last_s=since_s))
        assert fix.ok
        assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)
    assert len(searches) == before


@pytest.mark.parametrize("stopped", [0, 1])
def test_the_others_are_followed_where_a_camera_is_frozen(
    stopped: int, searches: list[int]
) -> None:
    """And all of them as soon as it comes back."""
    sensor = HorizonSensor()
    other = VIEWS[1 - stopped].name
    for steps in range(8):
        frames, nadir = turned(steps)
        frozen = 2 <= steps < 6
        if frozen:
            says = replace(frames[stopped], unusable="the very same image again")
            frames = [says if i == stopped else frame for i, frame in enumerate(frames)]
        before = len(searches)
        fix = sensor.process(frames)
        assert (len(searches) == before) == (steps > 0)
        assert fix.cameras_used == ((other,) if frozen else ("camera_1", "camera_2"))
        assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)
        assert (fix.limbs[stopped].status is Status.BAD_IMAGE) == frozen
        assert ("the very same" in fix.limbs[stopped].reason) == frozen


def test_a_camera_that_never_worked_is_in_nobodys_way(searches: list[int]) -> None:
    sensor = HorizonSensor()
    followed = []
    for steps in range(6):
        first, second = turned(steps)[0]
        frozen = replace(first, unusable="the very same image again")
        before = len(searches)
        # Once it works it takes part at once.
        fix = sensor.process([frozen if steps < 4 else first, second])
        followed.append(len(searches) == before)
        assert fix.cameras_used == (("camera_2",) if steps < 4 else ("camera_1", "camera_2"))
    assert followed == [False, True, True, True, False, True]


def test_a_limb_that_is_gone_is_not_followed() -> None:
    sensor = HorizonSensor()
    frames, _ = turned(0)
    assert sensor.process(frames).ok
    for level in (0, 40, 255):
        dark = [Frame(frame.view, np.full_like(frame.gray, level)) for frame in frames]
        fix = sensor.process(dark)
        assert not fix.ok
        assert fix.reason
        assert np.isnan(fix.fit.nadir_base).all()
    # The next good frames are searched.
    assert sensor.process(frames).ok


def test_a_camera_that_went_blind_is_left_out() -> None:
    sensor = HorizonSensor()
    frames, nadir = turned(0)
    assert sensor.process(frames).cameras_used == ("camera_1", "camera_2")
    blind = [Frame(frames[0].view, np.zeros_like(frames[0].gray)), frames[1]]
    fix = sensor.process(blind)
    assert fix.cameras_used in (("camera_2",), ())
    if fix.ok:
        assert angle_rad(fix.fit.nadir_base, nadir) < 4.0 * sigma_rad(fix)


@pytest.mark.parametrize("change", ["reset", "other calibration", "no tracking"])
def test_the_past_is_forgotten(change: str, searches: list[int]) -> None:
    sensor = HorizonSensor(HorizonConfig(tracking=change != "no tracking"))
    frames, _ = turned(0)
    assert sensor.process(frames).ok
    if change == "reset":
        sensor.reset()
    if change == "other calibration":
        views = limb_views(ALTITUDE_M, CAMERA, (0.0, 1.5))
        frames = [Frame(view, frame.gray) for view, frame in zip(views, frames, strict=True)]
    before = len(searches)
    assert sensor.process(frames, NOTHING_KNOWN).ok
    assert len(searches) > before


def test_a_search_now_and_then(searches: list[int]) -> None:
    """However good the track, whole frames are looked at again within a hundred sets."""
    sensor = HorizonSensor()
    frames, _ = turned(0)
    for _ in range(100):
        assert sensor.process(frames).ok
    assert 2 * 2 <= len(searches) <= 2 * 10


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_an_overexposed_edge_looked_like_is_not_kept(seed: int) -> None:
    """By turns of whiter than white and of well exposed frames each tells of its own edge."""
    views = limb_views(600e3, roll_rad=0.2 + 0.3 * seed)
    imaging = Imaging(noise_dn=2.0, psf_sigma_px=1.0)
    ground = EarthScene(texture="smooth", texture_seed=seed, smooth_contrast=0.1)
    sensor = HorizonSensor()
    for k in range(6):
        scene = replace(ground, uniform_dn=120.0 if k % 2 else 900.0)
        frames = as_frames(views, draw(views, 600e3, scene, imaging, 100 * seed + k))
        fix = sensor.process(frames)
        if k % 2:
            blur_px = HorizonSensor(SEARCHING).process(frames).limbs[0].blur_px
            assert fix.limbs[0].blur_px == pytest.approx(blur_px, abs=0.05)

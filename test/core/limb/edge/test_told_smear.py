"""What exposure and rate tell of motion's smear, beside where rays go as the craft turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from limb_frames import as_frames, clouds, draw, limb_views
from limb_samples import CAMERAS, nadir_nees
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.readout import view_at_stamp
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.told_smear import told_smear
from horizon_sensor_ros.core.limb_curve import limb_curve
from horizon_sensor_ros.core.motion.turn_rate import TurnRate
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging

EXPOSURE_S = 0.01
ALTITUDE_M = 900e3
NADIR, RHO = np.array([0.0, 0.0, 1.0]), Planet().rho_from_altitude(ALTITUDE_M)
NOISE = Imaging(noise_dn=3.0)


def told(view: CameraView, turn_base_rad: np.ndarray, sigma_rad_s: float = 0.0) -> CameraView:
    exposed = replace(view, exposure_s=EXPOSURE_S)
    return view_at_stamp(exposed, TurnRate(turn_base_rad / EXPOSURE_S, sigma_rad_s))


def moved_px(view: CameraView, turn_base_rad: np.ndarray) -> np.ndarray:
    """How far points of the limb move across it, from the exposure's start to its end."""
    curve = limb_curve(view, NADIR, RHO, spacing_px=8.0)
    rays = view.camera.rays(curve.px) @ view.rot_base_from_cam.T
    ends = [
        view.camera.pixels(Rotation.from_rotvec(turn).apply(rays) @ view.rot_base_from_cam)
        for turn in (0.5 * turn_base_rad, -0.5 * turn_base_rad)
    ]
    return np.abs(((ends[1] - ends[0]) * curve.normal_px).sum(axis=1))


def turn_of(view: CameraView, smear_px: float, angle_rad: float) -> np.ndarray:
    """Turn (3,) by which the middle of the frame moves so far, that way in the image."""
    motion = np.array([np.sin(angle_rad), -np.cos(angle_rad), 0.0]) * smear_px / view.camera.fx
    return view.rot_base_from_cam @ motion


@given(
    st.sampled_from(CAMERAS),
    st.floats(2.0, 12.0),
    st.floats(0.0, 2.0 * np.pi),
    st.floats(-0.3, 0.3),
)
def test_a_smear_is_as_long_as_rays_move_across_the_limb(
    camera: Camera, smear_px: float, angle_rad: float, roll: float
) -> None:
    (view,) = limb_views(ALTITUDE_M, camera)
    turn = turn_of(view, smear_px, angle_rad)
    turn = turn + roll * np.linalg.norm(turn) * view.rot_base_from_cam[:, 2]
    smear = told_smear(told(view, turn), NADIR, RHO)
    assert smear is not None
    assert smear.boxed
    across = moved_px(view, turn)
    # One motion stands for all of the limb.
    assert smear.across_px == pytest.approx(float(across.max()), rel=0.2, abs=0.3)
    assert smear.sure_px <= smear.across_px


@given(st.sampled_from(CAMERAS), st.floats(-0.2, 0.2))
def test_a_turn_about_nadir_smears_no_limb(camera: Camera, turn_rad: float) -> None:
    (view,) = limb_views(ALTITUDE_M, camera)
    smear = told_smear(told(view, turn_rad * NADIR), NADIR, RHO)
    assert smear is not None
    assert smear.across_px < 1e-4


def test_what_is_not_known_is_not_told() -> None:
    (view,) = limb_views(ALTITUDE_M)
    turn = turn_of(view, 5.0, 0.4)
    assert told_smear(view, NADIR, RHO) is None
    assert told_smear(replace(view, exposure_s=EXPOSURE_S), NADIR, RHO) is None
    assert told_smear(replace(told(view, turn), exposure_s=0.0), NADIR, RHO) is None
    # A rate that leaves open by a pixel how long the smear is.
    pixel_rad_s = 1.0 / view.camera.fx / EXPOSURE_S
    assert told_smear(told(view, turn, pixel_rad_s), NADIR, RHO) is None
    nearly, known = (
        told_smear(told(view, turn, sigma), NADIR, RHO) for sigma in (0.3 * pixel_rad_s, 0.0)
    )
    assert nearly is not None
    assert known is not None
    # The square of 5 px, 0.3 px off, over 12.
    assert nearly.open_px2 == pytest.approx(2.0 * nearly.across_px * 0.3 / 12.0, rel=0.1)
    assert known.open_px2 < 0.2 * nearly.open_px2


def test_where_no_limb_is_in_sight_none_is_smeared() -> None:
    away = replace(limb_views(ALTITUDE_M)[0], rot_base_from_cam=np.diag([1.0, -1.0, -1.0]))
    smear = told_smear(told(away, np.array([0.02, 0.0, 0.0])), NADIR, RHO)
    assert smear is not None
    assert smear.across_px == 0.0


@pytest.mark.parametrize("exposure_s", [-0.01, np.inf, np.nan])
def test_an_exposure_that_is_none_is_the_callers_bug(exposure_s: float) -> None:
    (view,) = limb_views(ALTITUDE_M)
    with pytest.raises(ValueError, match="exposure_s of 'camera_1' must be 0 or positive, got"):
        replace(view, exposure_s=exposure_s)


def fixed(
    view: CameraView, image: np.ndarray, turn_base_rad: np.ndarray, is_told: bool
) -> HorizonFix:
    exposed = replace(view, exposure_s=EXPOSURE_S * is_told)
    return HorizonSensor().process(
        [Frame(exposed, image)], Aiding(rate_base_rad_s=turn_base_rad / EXPOSURE_S)
    )


def test_small_smears_beside_clouds_are_not_too_sure_where_they_are_told() -> None:
    """Not told, such a smear is taken for clouds: one in seven is beyond three sigma."""
    nees: dict[bool, list[float]] = {False: [], True: []}
    (view,) = limb_views(ALTITUDE_M)
    for seed, angle_rad in enumerate(np.linspace(0.3, 2.9, 7)):
        turn = turn_of(view, 2.5, float(angle_rad))
        scene = replace(clouds(seed), cloud_contrast=0.5)
        image = draw((view,), ALTITUDE_M, scene, NOISE, seed, turn_base_rad=turn)[0].image
        for is_told, found in nees.items():
            fix = fixed(view, image, turn, is_told)
            assert fix.ok, fix.reason
            found.append(nadir_nees(fix.fit, NADIR))
    assert max(nees[True]) < 9.0
    assert np.mean(nees[True]) < 2.5
    assert np.mean(nees[False]) > 2.0 * np.mean(nees[True])


def test_a_rate_is_believed_where_smeared_clouds_leave_no_horizon() -> None:
    """Without it such frames are fixed too, and wrong."""
    (view,) = limb_views(ALTITUDE_M)
    turn = turn_of(view, 5.0, 2.9)
    scene = replace(clouds(13), cloud_contrast=0.5)
    image = draw((view,), ALTITUDE_M, scene, NOISE, 13, turn_base_rad=turn)[0].image
    fix = fixed(view, image, turn, is_told=True)
    assert "rate on imu" not in fix.reason
    assert not fix.ok or nadir_nees(fix.fit, NADIR) < 11.8


def test_a_craft_that_stands_still_has_the_fix_that_it_had() -> None:
    (view,) = limb_views(ALTITUDE_M)
    image = draw((view,), ALTITUDE_M, clouds(3), NOISE)[0].image
    plain, still = (fixed(view, image, np.zeros(3), is_told) for is_told in (False, True))
    assert plain.ok
    assert np.array_equal(plain.fit.nadir_base, still.fit.nadir_base)
    assert np.array_equal(plain.fit.cov_nadir_altitude, still.fit.cov_nadir_altitude)


def test_soft_optics_are_no_motion_of_a_craft_that_is_known_to_stand_still() -> None:
    (view,) = limb_views(ALTITUDE_M)
    soft = Imaging(noise_dn=3.0, psf_sigma_px=1.8)
    for seed, scene in enumerate((EarthScene(), EarthScene(air_dn=90.0), clouds(5))):
        image = draw((view,), ALTITUDE_M, scene, soft, seed)[0].image
        fix = fixed(view, image, np.zeros(3), is_told=True)
        assert fix.ok, fix.reason
        assert nadir_nees(fix.fit, NADIR) < 11.8


def test_a_followed_limb_begins_to_move_and_rests_again() -> None:
    """At times unknown, so that the fixes do not contradict the gyro: nadir stays where it is."""
    views = tuple(
        replace(view, exposure_s=EXPOSURE_S)
        for view in limb_views(ALTITUDE_M, azimuths_rad=(0.0, np.pi / 2.0))
    )
    about = np.array([0.02, -0.01, 0.03])
    sensor = HorizonSensor()
    followed = []
    for step, share in enumerate((0.0, 0.0, 0.4, 0.4, 0.42, 0.0, 0.0)):
        turn = share * about
        drawn = draw(views, ALTITUDE_M, clouds(8), NOISE, step, turn_base_rad=turn)
        fix = sensor.process(
            as_frames(views, drawn),
            Aiding(
                rate_base_rad_s=turn / EXPOSURE_S,
                rot_now_from_last=np.eye(3),
            ),
        )
        assert fix.ok, fix.reason
        assert nadir_nees(fix.fit, NADIR) < 11.8
        followed.append(sensor.following)
    # Smeared by 4 px all of a sudden, and then no longer: both times it is searched for anew.
    assert followed == [False, True, False, True, True, False, True]

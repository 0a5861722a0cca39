"""How far motion smeared a limb, told from the width of its edge; frames blurred alike all around.

The true smear is the motion across the limb of a pinhole camera that turns.
"""

from __future__ import annotations

import numpy as np
import pytest
from limb_frames import as_frames, clouds, draw, limb_views
from limb_samples import nadir_nees

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.width import smear_from_parts, smear_of, widened_one_way
from horizon_sensor_ros.core.limb.sized_frame import SizedFrame
from horizon_sensor_ros.core.limb_curve import limb_curve
from horizon_sensor_ros.core.limb_points import LimbPoints, SharedError
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging

ALTITUDE_M = 1200e3
(VIEW,) = limb_views(ALTITUDE_M)
FAINT_CLOUDS = EarthScene(texture="clouds", texture_seed=4, cloud_contrast=0.2)
SCENES = {
    "uniform": EarthScene(),
    "faint clouds": FAINT_CLOUDS,
    "clouds": clouds(4),
    "glowing air": EarthScene(air_dn=90.0),
}


def smeared(
    scene: EarthScene,
    smear_px: float,
    angle_rad: float,
    seed: int = 0,
    view: CameraView = VIEW,
    altitude_m: float = ALTITUDE_M,
) -> SimFrame:
    """A frame whose middle moved so far, that way in the image."""
    motion = np.array([np.sin(angle_rad), -np.cos(angle_rad), 0.0]) * smear_px / view.camera.fx
    turn = view.rot_base_from_cam @ motion
    return draw((view,), altitude_m, scene, Imaging(noise_dn=3.0), seed, turn_base_rad=turn)[0]


def across_px(frame: SimFrame, smear_px: float, angle_rad: float) -> float:
    """How far the limb moved across itself, to first order, in the sixth of it where that was
    most.
    """
    truth, camera = frame.truth, VIEW.camera
    curve = limb_curve(VIEW, truth.nadir_base, truth.rho_rad, spacing_px=4.0)
    x, y = ((curve.px - [camera.cx, camera.cy]) / camera.fx).T
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    motion = smear_px * np.stack([(1 + x * x) * c + x * y * s, x * y * c + (1 + y * y) * s])
    across = np.abs((motion.T * curve.normal_px).sum(axis=1))
    return max(float(part.mean()) for part in np.array_split(across, 6))


@pytest.mark.parametrize("scene", ["uniform", "faint clouds", "glowing air"])
@pytest.mark.parametrize(("smear_px", "angle_rad"), [(4.0, 0.4), (6.0, 1.7), (6.0, 2.9)])
def test_smear_is_as_long_as_the_motion_across_the_limb(
    scene: str, smear_px: float, angle_rad: float
) -> None:
    frame = smeared(SCENES[scene], smear_px, angle_rad)
    truth = across_px(frame, smear_px, angle_rad)
    found = smear_of(frame.image, VIEW, frame.truth.nadir_base, frame.truth.rho_rad)
    assert found.across_px == pytest.approx(truth, rel=0.15, abs=0.2)
    assert found.sure_px > 2.0 or truth < 3.0


@pytest.mark.parametrize("scene", SCENES)
def test_frames_at_rest_are_not_smeared(scene: str) -> None:
    for seed in range(2):
        frame = draw((VIEW,), ALTITUDE_M, SCENES[scene], Imaging(noise_dn=3.0), seed)[0]
        found = smear_of(frame.image, VIEW, frame.truth.nadir_base, frame.truth.rho_rad)
        assert found.sure_px < 1.5


@pytest.mark.parametrize("scene", ["uniform", "faint clouds"])
def test_soft_optics_are_no_motion(scene: str) -> None:
    """They blur a limb alike all along it, and leave no flat top on its fall."""
    for seed, psf_px in enumerate((1.2, 1.8)):
        imaging = Imaging(noise_dn=3.0, psf_sigma_px=psf_px)
        frame = draw((VIEW,), ALTITUDE_M, SCENES[scene], imaging, seed)[0]
        found = smear_of(frame.image, VIEW, frame.truth.nadir_base, frame.truth.rho_rad)
        assert found.across_px > 1.5
        assert not found.boxed
        assert found.sure_px < 1.3


def test_what_is_lacking_lies_across_the_motion() -> None:
    """Where the limb turns far it tells both which way the motion was and how far it went."""
    angle = np.linspace(0.0, 2.5, 6)
    normal_px = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across2 = np.square(8.0 * np.cos(angle - 0.6))
    found = smear_from_parts(normal_px, across2)
    along, across = np.array([[np.cos(0.6), np.sin(0.6)], [-np.sin(0.6), np.cos(0.6)]])
    assert across @ found.lacking_px2 @ across == pytest.approx(8.0**2 / 12.0, rel=0.05)
    assert abs(along @ found.lacking_px2 @ along) < 0.1
    assert found.across_px == pytest.approx(8.0, rel=0.05)
    assert found.open_px2 < 0.1
    # What no motion does is not made up for, and said to be open.
    odd = smear_from_parts(normal_px, np.array([9.0, 0.0, 9.0, 0.0, 9.0, 0.0]))
    assert np.abs(odd.lacking_px2).max() < 0.1
    assert odd.open_px2 > 0.3


def test_an_evened_frame_is_blurred_alike_everywhere() -> None:
    """As much where motion went along the limb as where it went across."""
    frame = smeared(SCENES["uniform"], 8.0, 0.6)
    cone = frame.truth.nadir_base, frame.truth.rho_rad
    before = smear_of(frame.image, VIEW, *cone)
    after = smear_of(SizedFrame(frame.image, 1, smear=before).image(), VIEW, *cone)
    assert np.abs(after.lacking_px2).max() < 0.5 * np.abs(before.lacking_px2).max()


@pytest.mark.parametrize("scene", SCENES)
def test_fixes_of_smeared_frames_are_as_far_off_as_claimed(scene: str) -> None:
    """Before, half of them were off by three sigmas and more. Few are left beside full clouds."""
    nees = []
    motions = (5.0, 1.7), (6.0, 1.2), (5.0, 2.8)
    for seed, (smear_px, angle_rad) in enumerate(motions):
        frame = smeared(SCENES[scene], smear_px, angle_rad, seed)
        fix = HorizonSensor().process(as_frames((VIEW,), (frame,)))
        if not fix.ok:
            assert scene == "clouds"
            continue
        off = np.cross(fix.fit.nadir_base, frame.truth.nadir_base)
        nees.append(2.0 * off @ off / np.trace(fix.fit.cov_nadir_altitude[:3, :3]))
    assert np.mean([2.0, *nees]) < 6.0
    assert len(nees) == len(motions) or scene == "clouds"


@pytest.mark.parametrize(("smear_px", "angle_rad"), [(5.0, 1.2), (5.0, 2.2), (7.0, 2.7)])
def test_motion_is_not_taken_for_thick_air(smear_px: float, angle_rad: float) -> None:
    """Before, these were off by 3.6 to 6.5 sigmas."""
    (view,) = limb_views(450e3)
    frame = smeared(EarthScene(air_dn=60.0), smear_px, angle_rad, view=view, altitude_m=450e3)
    fix = HorizonSensor().process(as_frames((view,), (frame,)))
    assert fix.ok
    assert nadir_nees(fix.fit, frame.truth.nadir_base) < 6.0


def test_width_is_motions_where_it_goes_with_the_direction() -> None:
    angle = np.linspace(0.2, 1.5, 6)
    normal_px = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    one_way = 36.0 * np.square(np.cos(angle - 0.4)) + 4.0
    rough = np.array([9.0, -6.0, 12.0, -12.0, 3.0, -9.0])
    moved, still, uneven = (
        smear_from_parts(normal_px, across2)
        for across2 in (one_way, np.full(6, 36.0), 30.0 + rough)
    )
    assert widened_one_way([moved])
    assert not widened_one_way([still])
    assert not widened_one_way([uneven])
    # In one of two cameras chance may feign it.
    assert widened_one_way([moved, still])
    assert not widened_one_way([moved, uneven])


def test_a_frame_that_motion_leaves_nothing_of_is_refused() -> None:
    frame = smeared(SCENES["uniform"], 30.0, 1.57)
    fix = HorizonSensor().process(as_frames((VIEW,), (frame,)))
    assert fix.status is Status.NO_LIMB
    assert "motion" in fix.reason


def test_following_looks_again_where_motion_begins() -> None:
    still = draw((VIEW,), ALTITUDE_M, FAINT_CLOUDS, Imaging(noise_dn=3.0), 1)[0]
    moved = smeared(FAINT_CLOUDS, 7.0, 1.2)
    sensor = HorizonSensor()
    for frame, follows in ((still, False), (still, True), (moved, False), (still, False)):
        fix = sensor.process([Frame(VIEW, frame.image)])
        assert fix.ok
        assert sensor.following == follows
        off = np.cross(fix.fit.nadir_base, frame.truth.nadir_base)
        sigma2 = np.linalg.eigvalsh(fix.fit.cov_nadir_altitude[:3, :3])[-1]
        assert off @ off < 9.0 * sigma2


def test_errors_that_points_share_are_larger_where_motion_smeared() -> None:
    limb = LimbPoints(Status.OK, shared=SharedError(0.2, 0.1, 0.3, 0.4), cone_errors=np.eye(4))
    more = limb.with_shared_errors_times(2.0)
    assert more.shared == SharedError(0.4, 0.2, 0.6, 0.8)
    assert more.cone_errors is not None
    np.testing.assert_array_equal(more.cone_errors, 2.0 * np.eye(4))
    assert LimbPoints(Status.OK).with_shared_errors_times(2.0).cone_errors is None

"""Which cameras a fix is of: blind ones, wrongly mounted ones, those surer alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import (
    NADIR,
    SENSOR,
    SQUARE,
    assert_refused,
    clouded_pair,
    error_deg,
    nees,
    scenes_of,
    sigma_deg,
)
from limb_frames import as_frames, clouds, draw, limb_views
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import EarthScene
from horizon_sensor_ros.sim.hard_scenes import hard_scene


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
    fix = SENSOR.process(as_frames((*views[:2], _turned(views[2], 2.0)), drawn))
    assert fix.ok, fix.reason
    assert error_deg(fix, NADIR) < 0.05
    assert fix.cameras_used == ("camera_1", "camera_2")


def test_an_outvoted_camera_says_where_it_sees_its_limb_while_the_others_are_followed() -> None:
    views = limb_views(600e3, azimuths_rad=(0.0, 1.5, 3.0, -1.5))
    drawn = draw(views, 600e3)
    frames = as_frames((*views[:3], _turned(views[3], 2.0)), drawn)
    sensor = HorizonSensor()
    for followed in (False, True, True):
        fix = sensor.process(frames)
        assert (fix.predicted is not None) == followed
        assert fix.cameras_used == ("camera_1", "camera_2", "camera_3")
        assert error_deg(fix, NADIR) < 0.05
        assert fix.limbs[3].reason == "by itself it finds nadir 2.0 deg from the others'"


@pytest.mark.parametrize("turned_deg", [1.0, 2.0, 10.0])
@pytest.mark.parametrize("wrong", [(2, 3), (1, 3), (0, 1)])
def test_two_cameras_do_not_outvote_two_that_agree(
    wrong: tuple[int, int], turned_deg: float
) -> None:
    """Two heads of two cameras, one of them mounted otherwise than is told."""
    views = limb_views(600e3, azimuths_rad=(0.0, 0.9, 3.1, 4.0))
    drawn = draw(views, 600e3)
    told = [_turned(view, turned_deg * (i in wrong)) for i, view in enumerate(views)]
    fix = HorizonSensor().process(as_frames(told, drawn))
    assert_refused(fix, 4)
    if turned_deg > 1.0:
        assert fix.status is Status.CAMERAS_DISAGREE
        assert set(fix.contradicting) == {view.name for view in views}
    else:
        # Half a degree off a cone in between, limbs still look like those of one bad fit.
        assert fix.status in (Status.CAMERAS_DISAGREE, Status.POOR_FIT)


def _turned(view: CameraView, angle_deg: float) -> CameraView:
    turn = Rotation.from_rotvec([0.0, np.radians(angle_deg), 0.0]).as_matrix()
    return replace(view, rot_base_from_cam=turn @ view.rot_base_from_cam)


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


def test_a_camera_that_is_surer_alone_is_taken_alone() -> None:
    """It tells its limb from the glow above it, and the other one does not."""
    scene = hard_scene("jpeg", 57, 6006)
    frames = as_frames(scene.views, scene.frames)
    sensor = HorizonSensor()
    fix = sensor.process(frames)
    assert fix.ok, fix.reason
    (used,) = fix.cameras_used
    assert nees(fix, scene.frames[0].truth.nadir_base) < 9.0
    (other,) = [
        limb for view, limb in zip(scene.views, fix.limbs, strict=True) if view.name != used
    ]
    assert (other.status, other.reason) == (Status.OK, "the other camera is surer without it")
    again = sensor.process(frames)
    assert sensor.following
    assert nees(again, scene.frames[0].truth.nadir_base) < 9.0


def test_a_camera_whose_edge_bends_unlike_a_limb_by_itself_is_left_out() -> None:
    """There was no fix, where the other camera's is good."""
    scene = hard_scene("flare", 306, 0)
    fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_1",)
    assert "bends unlike a limb" in fix.limbs[1].reason
    assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.05

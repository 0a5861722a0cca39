from itertools import islice

import numpy as np
import pytest

from horizon_sensor_ros.sim.hard_kinds import KINDS
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scene, hard_scenes
from horizon_sensor_ros.sim.scene_sets import (
    SceneCase,
    set_a,
    set_b,
    set_c,
    set_d,
    set_e,
    set_m,
    two_camera_set,
)


@pytest.fixture(scope="module")
def every_kind() -> list[HardScene]:
    return list(hard_scenes(len(KINDS), seed=5))


@pytest.mark.parametrize("draw", [set_a, set_b, set_d, set_e, set_m])
def test_single_camera_sets_keep_their_definition(draw) -> None:
    cases: list[SceneCase] = list(draw(5, seed=2))
    for case in cases:
        (view,), (frame,) = case.views, case.frames
        camera = view.camera
        assert 300e3 <= frame.truth.altitude_m <= 6000e3
        assert 400 <= camera.width == camera.height <= 1024
        fov = 2 * np.degrees(np.arctan(camera.width / 2 / camera.fx))
        assert 40.0 <= fov <= 80.0
        assert np.array_equal(view.rot_base_from_cam, np.eye(3))
        np.testing.assert_array_equal(frame.truth.nadir_base, frame.truth.nadir_cam)
        assert frame.truth.limb.visible_length_px(10.0) > 0.5 * camera.width
        assert frame.image.dtype == np.uint8
    rolls = [np.arctan2(*c.frames[0].truth.nadir_cam[:2]) for c in cases]
    assert np.ptp(rolls) > np.pi


def test_noise_and_texture_of_the_sets() -> None:
    least_of = ((set_a, 2.0, 1.8), (set_b, 4.0, 8.0), (set_c, 4.0, 40.0), (set_d, 4.0, 12.0))
    for draw, noise, least in least_of:
        (case,) = draw(1, seed=3)
        frame = case.frames[0]
        camera, image = case.views[0].camera, frame.image.astype(float)
        y, x = np.mgrid[0 : camera.height : 4, 0 : camera.width : 4]
        px = np.stack([x.ravel(), y.ravel()], axis=1)
        angle = np.arccos(camera.rays(px.astype(float)) @ frame.truth.nadir_cam)
        grey = image[px[:, 1], px[:, 0]]
        on = grey[angle < frame.truth.rho_rad - 0.02]
        # the background of 4 DN lies near the clipping at 0: judge its upper half
        sky = grey[angle > frame.truth.rho_rad + 0.02]
        spread = np.sqrt(np.mean((sky[sky >= 4] - 4.0) ** 2))
        assert spread == pytest.approx(noise, rel=0.15)
        if draw is set_a:
            assert on.std() == pytest.approx(2.0, rel=0.1)
        assert on.std() > least


def test_a_frame_does_not_depend_on_how_many_are_drawn() -> None:
    for draw in (set_b, two_camera_set, hard_scenes):
        second = next(islice(draw(4, seed=4), 1, 2))
        same = list(draw(2, seed=4))[1]
        other = list(draw(2, seed=5))[1]
        assert np.array_equal(second.frames[0].image, same.frames[0].image)
        assert not np.array_equal(second.frames[0].image, other.frames[0].image)


def test_two_camera_set_is_perpendicular_and_agrees() -> None:
    for case in two_camera_set(6, seed=1):
        axes = [view.rot_base_from_cam[:, 2] for view in case.views]
        assert abs(axes[0] @ axes[1]) < 1e-12
        one, two = (frame.truth for frame in case.frames)
        np.testing.assert_allclose(one.nadir_base, two.nadir_base, atol=1e-12)
        for frame in case.frames:
            assert frame.truth.limb.visible_length_px(10.0) > 0.3 * frame.truth.camera.width


def test_kinds_that_are_named_are_drawn_and_no_others() -> None:
    (scene,) = hard_scenes(1, 3, ("daylight",))
    assert scene.kind == "daylight"
    assert scene.scene.air_rayleigh > 0.0
    assert scene.limb_cameras == ("camera_1", "camera_2")
    with pytest.raises(ValueError, match=r"unknown kinds \['dusk'\]; known are flat"):
        next(hard_scenes(1, 3, ("dusk",)))


def test_every_kind_is_drawn_and_judged(every_kind: list[HardScene]) -> None:
    assert [scene.kind for scene in every_kind] == list(KINDS)
    for scene in every_kind:
        assert [frame.image.shape for frame in scene.frames] == [(480, 640)] * 2
        assert scene.expect in {"fix", "none", "either"}
        assert not set(scene.limb_cameras) & set(scene.blind_cameras)
        assert (scene.expect == "fix") == bool(scene.limb_cameras)
    by_kind = {scene.kind: scene for scene in every_kind}
    for kind in ("flat", "clouds", "air", "moon", "wgs84", "high", "lens", "jpeg", "hot_pixels"):
        assert by_kind[kind].limb_cameras == ("camera_1", "camera_2")
    for kind in ("space", "earth"):
        assert by_kind[kind].limb_cameras == ("camera_2",)
        assert by_kind[kind].blind_cameras == ("camera_1",)
    assert by_kind["night"].expect == "none"
    assert by_kind["wgs84"].scene.planet.flattening > 0
    assert by_kind["balloon"].frames[0].truth.altitude_m < 40e3


def test_cameras_of_hard_scenes_share_their_truth(every_kind: list[HardScene]) -> None:
    for scene in every_kind:
        one, two = (frame.truth for frame in scene.frames)
        np.testing.assert_allclose(one.nadir_base, two.nadir_base, atol=1e-12)
        axes = [view.rot_base_from_cam[:, 2] for view in scene.views]
        assert abs(axes[0] @ axes[1]) < 1e-12


def test_terminators_show_part_of_the_limb_at_times() -> None:
    shares = []
    for scene in hard_scenes(8, seed=1, kinds=("terminator",)):
        for frame in scene.frames:
            length = frame.truth.limb.visible_length_px(-1e9)
            shares.append(frame.truth.limb.visible_length_px(12.0) / length)
    assert min(shares) < 0.2
    assert max(shares) > 0.8


def test_unknown_kinds_are_named() -> None:
    with pytest.raises(ValueError, match="fog"):
        hard_scenes(1, kinds=("fog",))
    with pytest.raises(ValueError, match="fog"):
        hard_scene("fog", 1)


def test_a_scene_is_the_same_alone() -> None:
    *_, last = hard_scenes(3, seed=5, kinds=("dim", "sun"))
    alone = hard_scene("dim", 2, seed=5)
    assert alone.name == last.name
    for one, other in zip(alone.frames, last.frames, strict=True):
        np.testing.assert_array_equal(one.image, other.image)

"""The whole chain where air glows: limb and glow told apart, or claimed not to be."""

from __future__ import annotations

import numpy as np
import pytest
from horizon_fixes import error_deg, fix_of_one, nees, sigma_deg
from limb_frames import as_frames, clouds, draw, limb_views

from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.hard_scenes import hard_scene, hard_scenes


@pytest.mark.parametrize(("i", "seed"), [(212, 21), (292, 24), (104, 7)])
def test_a_limb_in_even_glow_is_not_held_to_edges_in_the_others_uneven_glow(
    i: int, seed: int
) -> None:
    """Towards the night one camera's glow cannot be told from the limb, the other's can."""
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


@pytest.mark.parametrize(("i", "seed"), [(5, 4242), (32, 4242), (43, 31)])
def test_limbs_are_told_from_glow_that_fades_towards_the_terminator(i: int, seed: int) -> None:
    """By edges in the glow, or by the part of each limb where it is as even as by day, nadir was
    .09 to .24 deg off.
    """
    scene = hard_scene("terminator", i, seed)
    fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
    assert fix.ok, fix.reason
    assert all(limb.glow_separated for limb in fix.limbs)
    assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.06


@pytest.mark.parametrize(("kind", "i", "camera"), [("daylight", 237, 0), ("low_sun", 31, 1)])
def test_glow_that_fades_along_one_limb_is_not_taken_for_its_turn(
    kind: str, i: int, camera: int
) -> None:
    """As by daylight nadir was .67 and .38 deg off, 4.1 and 3.2 sigma. It is found, or it is said
    that it is not known so well, searched and followed; which of these hangs on little.
    """
    scene = hard_scene(kind, i, 31)
    frames = as_frames(scene.views, scene.frames)[camera : camera + 1]
    sensor = HorizonSensor()
    for _ in range(2):
        fix = sensor.process(frames)
        if fix.ok:
            assert nees(fix, scene.frames[0].truth.nadir_base) < 6.0
        else:
            assert fix.status is Status.UNCERTAIN


def test_faint_glow_is_not_taken_for_even_above_ground_that_ends_in_the_dark() -> None:
    """That it darkens did not show, and the limb was turned instead: nadir was off by .2 deg."""
    scene = hard_scene("terminator", 118, 1001)
    any_sigma = HorizonConfig(max_nadir_sigma_rad=np.pi)
    fix = HorizonSensor(any_sigma).process(as_frames(scene.views, scene.frames))
    assert fix.ok, fix.reason
    assert all(limb.glow_separated for limb in fix.limbs if limb.status is Status.OK)
    assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.1
    assert nees(fix, scene.frames[0].truth.nadir_base) < 11.83


@pytest.mark.slow
def test_one_camera_towards_the_terminator_claims_neither_too_little_nor_too_much() -> None:
    """Mean 2-dof NEES is 2 where claims are as large as errors. Of 33 such limbs 18 were known well
    enough, by claims that were enlarged for what the fit of limb and glow claims itself.
    """
    found = []
    for scene in hard_scenes(60, 2004, ("terminator",)):
        if len(scene.limb_cameras) == 1:
            fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
            if fix.ok:
                assert error_deg(fix, scene.frames[0].truth.nadir_base) < 0.7
                found.append(nees(fix, scene.frames[0].truth.nadir_base))
    assert len(found) >= 19
    assert 0.7 < np.mean(found) < 2.6
    assert max(found) < 11.83


@pytest.mark.parametrize("i", [159, 199, 254, 264])
def test_both_limbs_are_told_from_long_glow(i: int) -> None:
    """From a balloon glow reaches over nine pixels; of these pairs one limb or none was told from
    it, since the fit ran out of steps, began too far off, or was taken for smeared: nadir was .05
    to .5 deg off.
    """
    scene = hard_scene("balloon", i, 902)
    fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
    assert fix.ok, fix.reason
    assert all(limb.glow_separated for limb in fix.limbs)
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
    assert fix.limbs[0].glow_separated
    assert nees(fix, scene.frames[index].truth.nadir_base) < 9.0


def test_edges_in_glow_say_how_far_they_turn_a_limb() -> None:
    """One overexposed camera: they turned it by 3.9 sigma.

    Glow and limb are all but separated there. With Ubuntu 24.04's libraries they are, and nadir is
    then not known well enough to be published.
    """
    scene = hard_scene("saturated", 26, 4321)
    fix = fix_of_one(scene, 0)
    if fix.limbs[0].glow_separated:
        assert fix.status is Status.UNCERTAIN
    else:
        assert fix.ok, fix.reason
        assert nees(fix, scene.frames[0].truth.nadir_base) < 9.0


def test_saturated_samples_speak_neither_for_a_limb_under_glow_nor_against_it() -> None:
    """Their residuals made stretches outliers, and the fit of limb and glow was given up."""
    scene = hard_scene("saturated", 45, 4321)
    fix = fix_of_one(scene, 0)
    assert fix.ok, fix.reason
    assert fix.limbs[0].glow_separated
    assert nees(fix, scene.frames[0].truth.nadir_base) < 9.0


def test_edges_that_air_blurs_are_told_from_it_as_the_other_cameras_are() -> None:
    """From 3000 km and from others' limbs air is as thin as the blur, and lifts edges by half a
    pixel: of these pairs such edges in one frame or both left nadir off by .008 to .04 deg.
    """
    off_deg, separated = [], 0
    scenes = [("high", i, 4242) for i in (10, 34, 106, 442, 466)]
    scenes += [("high", i, 6006) for i in (81, 140, 226)]
    scenes += [("lens", 320, 4242), ("boom", 223, 4242), ("moonlit", 89, 4242)]
    for kind, i, seed in scenes:
        scene = hard_scene(kind, i, seed)
        fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
        assert fix.ok, fix.reason
        separated += all(limb.glow_separated for limb in fix.limbs)
        off_deg.append(error_deg(fix, scene.frames[0].truth.nadir_base))
    assert separated >= len(scenes) - 2
    assert np.median(off_deg) < 0.008
    assert np.mean(off_deg) < 0.012


def test_clouds_beside_a_soft_lens_are_not_taken_for_thin_air() -> None:
    """Edges are as blurred as air would make them, and there is none."""
    altitude_m = 2500e3
    views = limb_views(altitude_m, azimuths_rad=(0.4, 2.0))
    found = []
    for seed in range(6):
        imaging = Imaging(noise_dn=2.0, psf_sigma_px=0.85)
        drawn = draw(views, altitude_m, clouds(seed), imaging, seed)
        fix = HorizonSensor().process(as_frames(views, drawn))
        assert fix.ok, fix.reason
        found += [limb.glow_separated for limb in fix.limbs]
    assert sum(found) <= 1

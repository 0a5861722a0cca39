"""Cameras of one fix that contradict each other: claimed, or refused."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from limb_frames import as_frames, clouds, draw, limb_views
from limb_samples import PINHOLE, nadir_nees, observe, view_at_limb
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.horizon.agreement import each_alone, with_contradiction
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.hard_scenes import hard_scene
from horizon_sensor_ros.sim.poses import (
    camera_from_fov,
    pose_from_attitude,
    rot_from_axis,
    side_views,
)


@lru_cache(maxsize=12)
def pair(seed: int) -> tuple[tuple[CameraView, ...], tuple[SimFrame, ...], np.ndarray]:
    """Two cameras, their frames, and a unit vector."""
    rng = np.random.default_rng(seed)
    altitude_m = float(rng.uniform(400e3, 1200e3))
    views = limb_views(altitude_m, azimuths_rad=(0.0, float(rng.uniform(1.2, 1.9))))
    scene = clouds(seed) if seed % 2 else EarthScene()
    drawn = draw(views, altitude_m, scene, Imaging(noise_dn=2.0), seed)
    axis = rng.standard_normal(3)
    return views, drawn, axis / np.linalg.norm(axis)


def fix_of_turned(turned_deg: float, seed: int) -> tuple[HorizonFix, SimFrame]:
    """What two cameras tell, of which the second is mounted otherwise than is said."""
    views, drawn, axis = pair(seed)
    turn = Rotation.from_rotvec(np.radians(turned_deg) * axis).as_matrix()
    wrong = replace(views[1], rot_base_from_cam=turn @ views[1].rot_base_from_cam)
    return HorizonSensor().process(as_frames((views[0], wrong), drawn)), drawn[0]


def test_cameras_that_are_mounted_as_is_said_agree() -> None:
    for seed in range(12):
        fix, _ = fix_of_turned(0.0, seed)
        assert fix.ok
        assert fix.reason == ""


def test_a_short_arc_that_agrees_contradicts_nobody() -> None:
    """Its estimate lies far off along a curve, and on it; of 50 such pairs 16 were warned of."""
    views = side_views(camera_from_fov(640, 480, np.radians(60.0)))
    looked = 0
    for pitch_deg in (-28.0, -29.0, -30.0):
        rot, position = pose_from_attitude(1e6, 0.0, np.radians(pitch_deg))
        for seed in range(100, 105):
            drawn = render_views(views, rot, position, EarthScene(), np.random.default_rng(seed))
            fix = HorizonSensor().process(as_frames(views, drawn))
            assert fix.reason == ""
            looked += len(fix.cameras_used) == 2
            assert nadir_nees(fix.fit, drawn[0].truth.nadir_base) < 16.0
    assert looked == 15


@pytest.mark.parametrize("turned_deg", [0.1, 0.3])
def test_what_a_wrong_mounting_does_is_claimed(turned_deg: float) -> None:
    """Both limbs lay on one cone to a pixel or two, and sigmas were up to 100 times too small.

    Where either camera alone hardly knows what the other adds, a turn shows itself to nobody.
    """
    nees, said = [], 0
    for seed in range(12):
        fix, drawn = fix_of_turned(turned_deg, seed)
        if fix.ok:
            nees.append(nadir_nees(fix.fit, drawn.truth.nadir_base))
            said += "sigma apart" in fix.reason
    assert len(nees) >= 6
    assert said >= len(nees) // 2
    assert np.median(nees) < 3.0
    assert np.mean(nees) < 6.0


def test_cameras_that_are_mounted_wrong_by_degrees_are_refused() -> None:
    for seed in range(8):
        fix, _ = fix_of_turned(3.0, seed)
        assert fix.status in (Status.CAMERAS_DISAGREE, Status.POOR_FIT)


def fix_of_zoomed(
    zoom: float, altitude_m: float = 800e3, seed: int = 4
) -> tuple[HorizonFix, SimFrame]:
    """What two cameras tell, of which the second's focal length is off by a factor."""
    views = limb_views(altitude_m, azimuths_rad=(0.0, 1.5))
    drawn = draw(views, altitude_m, None, Imaging(noise_dn=2.0), seed)
    camera = replace(views[1].camera, fx=zoom * views[1].camera.fx, fy=zoom * views[1].camera.fy)
    zoomed = replace(views[1], camera=camera)
    return HorizonSensor().process(as_frames((views[0], zoomed), drawn)), drawn[0]


def test_altitudes_that_contradict_each_other_are_no_mountings() -> None:
    """A focal length that is wrong makes the planet another size: no turn explains it."""
    right, _ = fix_of_zoomed(1.0)
    assert right.ok
    fix, drawn = fix_of_zoomed(1.02)
    assert "sigma apart" in fix.reason
    assert not fix.ok or nadir_nees(fix.fit, drawn.truth.nadir_base) < 12.0


@pytest.mark.parametrize("altitude_m", [400e3, 800e3, 1500e3])
def test_what_altitudes_are_apart_by_is_not_claimed_twice(altitude_m: float) -> None:
    """Half a pixel at the frame's corner: nadirs are .07 deg apart, and 1.8 were claimed."""
    for seed in 1, 2:
        fix, drawn = fix_of_zoomed(1.003, altitude_m, seed)
        assert fix.ok, fix.reason
        assert "sigma apart" in fix.reason
        assert nadir_nees(fix.fit, drawn.truth.nadir_base) < 12.0


def test_an_edge_that_bends_as_its_own_cameras_limb_would_is_one() -> None:
    """The common limb's altitude is between what either camera sees: it bent "unlike a limb"."""
    scene = hard_scene("balloon", 371, 777)
    fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_1", "camera_2")
    assert nadir_nees(fix.fit, scene.frames[0].truth.nadir_base) < 11.8


@pytest.mark.parametrize(
    ("turned_deg", "seed"),
    [(0.7, 18), (1.0, 2), (1.0, 19), (1.0, 24), (2.0, 15), (2.0, 17), (3.0, 15)],
)
def test_what_is_found_around_a_cone_that_is_no_cameras_own_does_not_hide_it(
    turned_deg: float, seed: int
) -> None:
    """Edges near the common cone agreed with it: up to 1.9 deg off, at a tenth of that claimed.

    By itself each camera sees a limb elsewhere.
    """
    rng = np.random.default_rng(200 + seed)
    roll, pitch = np.radians(rng.uniform(-25.0, 25.0, 2))
    camera = camera_from_fov(640, 480, np.radians(70.0))
    views = tuple(
        CameraView(f"camera_{i}", camera, rot_from_axis(np.array(axis)))
        for i, axis in enumerate(((1.0, 0.0, 0.3), (0.0, 1.0, 0.3)), 1)
    )
    rot, position = pose_from_attitude(400e3, float(roll), float(pitch), 0.3)
    scene = EarthScene(texture="clouds", texture_seed=200 + seed)
    drawn = render_views(views, rot, position, scene, rng)
    axis = rng.standard_normal(3)
    turn = Rotation.from_rotvec(np.radians(turned_deg) * axis / np.linalg.norm(axis)).as_matrix()
    wrong = replace(views[1], rot_base_from_cam=turn @ views[1].rot_base_from_cam)
    fix = HorizonSensor().process(as_frames((views[0], wrong), drawn))
    assert fix.reason
    assert not fix.ok or nadir_nees(fix.fit, drawn[0].truth.nadir_base) < 16.0


@pytest.mark.parametrize(("apart", "by_chance"), [(2.6, True), (2.9, True), (3.1, False)])
def test_altitudes_are_apart_by_chance_up_to_three_sigma(apart: float, by_chance: bool) -> None:
    """One pair in 370 is farther by the normal law: then all was claimed too small, by Birge's
    factor, and not only the mountings are wrong.
    """
    planet, nadir, altitude_m = Planet(), np.array([0.0, 0.0, 1.0]), 800e3
    rho_rad = planet.rho_from_altitude(altitude_m)
    views = [
        view_at_limb(PINHOLE, nadir, rho_rad, 1.6 * k, name=f"camera_{k + 1}") for k in range(2)
    ]
    one = fit_horizon([observe(views[0], nadir, rho_rad)], planet)
    higher_m = apart * np.sqrt(2.0 * one.cov_nadir_altitude[3, 3])
    altitudes_m = (altitude_m, altitude_m + higher_m)
    seen = [
        observe(view, nadir, planet.rho_from_altitude(each))
        for view, each in zip(views, altitudes_m, strict=True)
    ]
    fit = fit_horizon(seen, planet)
    told, words = with_contradiction(
        fit, each_alone(fit, seen, planet, lambda found, _: found), seen, planet
    )
    assert "sigma apart" in words
    times = told.cov_nadir_altitude[3, 3] / fit.cov_nadir_altitude[3, 3]
    assert (times < 0.99 * apart**2) == by_chance

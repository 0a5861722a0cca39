"""Discs that the Sun draws are no planets; planets from as far away are, also beside the Sun.

Halos, rings and ghosts are drawn here by closed forms, planets by the simulator.
"""

from __future__ import annotations

import numpy as np
import pytest
from limb_frames import CAMERA, CLEAN, as_frames

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb.sun_artefact import LARGEST_RAD, sun_artefact
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import rot_from_axis

VIEW = CameraView("camera_1", CAMERA, np.eye(3))
ROWS, COLUMNS = np.indices((480, 640))


def from_px(x: float, y: float) -> np.ndarray:
    return np.asarray(np.hypot(COLUMNS - x, ROWS - y))


def halo(x: float, y: float, radius_px: float, power: float) -> np.ndarray:
    """Light of the Sun, as bright as pixels can tell within a radius."""
    return np.asarray(250.0 * (radius_px / np.maximum(from_px(x, y), 1.0)) ** power)


def recorded(light: np.ndarray, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(4.0, 1.5, light.shape)
    return np.clip(np.rint(light + noise), 0, 255).astype(np.uint8)


def seen(gray: np.ndarray) -> HorizonFix:
    return HorizonSensor().process([Frame(VIEW, gray)])


def edges(x: float, y: float, radius_px: float, first_deg: float = 0.0) -> np.ndarray:
    """Points around a disc in the image, from an angle on, three quarters of it at most."""
    angle = np.radians(np.linspace(first_deg, 360.0 - first_deg, 60))
    return np.stack([x + radius_px * np.cos(angle), y + radius_px * np.sin(angle)], axis=1)


def reason(gray: np.ndarray, limb_px: np.ndarray) -> str:
    """What is said of a disc whose edges those are, by the cone through them."""
    rays = CAMERA.rays(limb_px)
    axis = np.linalg.solve(rays.T @ rays, rays.sum(axis=0))
    size = float(np.linalg.norm(axis))
    return sun_artefact(
        limb_px, WorkingImage.of(gray), VIEW, axis / size, float(np.arccos(1.0 / size))
    )


@pytest.mark.parametrize("power", [2.0, 3.0, 4.0])
@pytest.mark.parametrize("radius_px", [40.0, 70.0])
def test_the_overexposed_sun_is_no_planet(radius_px: float, power: float) -> None:
    gray = recorded(halo(250.0, 200.0, radius_px, power))
    assert not seen(gray).ok
    assert "glare, not a planet" in reason(gray, edges(250.0, 200.0, radius_px))


def test_a_ring_about_the_sun_is_no_planet() -> None:
    ring = 30.0 * np.exp(-np.square((from_px(320.0, 240.0) - 150.0) / 4.0))
    gray = recorded(halo(320.0, 240.0, 12.0, 2.0) + ring)
    assert not seen(gray).ok
    assert reason(gray, edges(320.0, 240.0, 153.0)) == "a ring about the Sun, not a planet"


@pytest.mark.parametrize("sun", [(60.0, 50.0), (600.0, 60.0), (350.0, 440.0)])
def test_a_ghost_of_the_sun_in_sight_is_no_planet(sun: tuple[float, float]) -> None:
    x, y = 640.0 - 0.8 * sun[0], 480.0 - 0.8 * sun[1]
    x, y = min(max(x, 80.0), 560.0), min(max(y, 80.0), 400.0)
    ghost = 40.0 * np.clip(60.5 - from_px(x, y), 0.0, 1.0)
    gray = recorded(halo(*sun, 15.0, 3.0) + ghost)
    assert not seen(gray).ok
    assert "a ghost, not a planet" in reason(gray, edges(x, y, 60.0))


def test_without_the_sun_in_sight_a_disc_may_be_a_planet() -> None:
    disc = 40.0 * np.clip(60.5 - from_px(300.0, 200.0), 0.0, 1.0)
    gray = recorded(disc)
    shown = edges(300.0, 200.0, 60.0)
    assert reason(gray, shown) == ""
    lamp = disc + 255.0 * (from_px(100.0, 400.0) < 5.0)
    assert reason(recorded(lamp), shown) == ""


def planet(altitude_m: float, sun_off_rad: float, **how: float) -> SimFrame:
    """The Earth in the frame, lit by a Sun so far off its middle, to the right of it."""
    body = Planet()
    rot = rot_from_axis(np.array([0.36, 0.48, 0.8]), 0.4)
    nadir = rot @ np.array([-0.17, 0.05, 0.98])
    nadir /= np.linalg.norm(nadir)
    across = np.cross(np.cross(nadir, rot[:, 0]), nadir)
    across /= np.linalg.norm(across)
    sun = np.cos(sun_off_rad) * nadir + np.sin(sun_off_rad) * across
    scene = EarthScene(
        texture="clouds", texture_seed=2, air_dn=60.0, sun_direction=tuple(sun), sun_dn=900.0
    )
    distance = body.mean_radius_m + altitude_m
    imaging = Imaging(noise_dn=CLEAN.noise_dn, psf_sigma_px=CLEAN.psf_sigma_px, **how)
    rng = np.random.default_rng(1)
    return render_views((VIEW,), rot, -nadir * distance, scene, rng, imaging=imaging)[0]


@pytest.mark.parametrize("altitude_m", [10e6, 20e6, 40e6])
@pytest.mark.parametrize("gain", [1.0, 3.0])
def test_a_planet_from_as_far_is_one(altitude_m: float, gain: float) -> None:
    frame = planet(altitude_m, 2.2, gain=gain)
    fix = HorizonSensor().process(as_frames((VIEW,), (frame,)))
    assert fix.ok, fix.reason
    assert fix.fit.rho_rad < LARGEST_RAD
    assert np.degrees(angle_rad(fix.fit.nadir_base, frame.truth.nadir_base)) < 0.1


def test_a_crescent_beside_the_sun_is_a_planet() -> None:
    frame = planet(14e6, 0.55)
    truth = frame.truth
    # The Sun is in the frame, and only the limb towards it is lit.
    assert frame.image.max() == 255
    lit = truth.limb.px[truth.limb.visible(30.0)]
    assert 30 < len(lit) < 0.7 * len(truth.limb.px)
    working = WorkingImage.of(frame.image)
    rho = float(truth.rho_rad)
    assert sun_artefact(lit, working, VIEW, truth.nadir_base, rho) == ""
    every = truth.limb.px
    assert "a ghost" in sun_artefact(every, working, VIEW, truth.nadir_base, rho)


def test_discs_from_nearer_are_not_asked_about() -> None:
    gray = recorded(halo(250.0, 200.0, 60.0, 2.0))
    working = WorkingImage.of(gray)
    nadir = np.array([0.0, 0.0, 1.0])
    assert sun_artefact(edges(250.0, 200.0, 60.0), working, VIEW, nadir, 0.6) == ""
    assert sun_artefact(np.empty((0, 2)), working, VIEW, nadir, 0.2) == ""


def test_where_nothing_shows_nothing_is_said() -> None:
    """Without a step there is no share of it that is left."""
    dark = np.zeros((480, 640), dtype=np.uint8)
    brighter = from_px(300.0, 200.0) > 64.0
    assert reason(np.where(brighter, 60, 0).astype(np.uint8), edges(300.0, 200.0, 60.0)) == ""
    assert reason(dark, edges(300.0, 200.0, 60.0)) == ""

"""A limb along which light changes, drawn here: it fades where the terminator meets it, or is too
bright for the exposure in a part of it. Each turns a limb that is measured as all alike.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from horizon_fixes import error_deg, nees

from horizon_sensor_ros.core.camera import Camera
from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.horizon_fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon_sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.terminator import fading_ends
from horizon_sensor_ros.core.limb.profiles import ProfileGrid
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.poses import rot_from_axis

NADIR = np.array([0.0, 0.0, 1.0])
FINE = 4  # drawn rays to a pixel, along each side
WIDTH, HEIGHT = 320, 240
CAMERA = Camera(WIDTH, HEIGHT, 260.0, 260.0, 159.5, 119.5)
FINER = Camera(
    FINE * WIDTH, FINE * HEIGHT, FINE * 260.0, FINE * 260.0, FINE * 160.0 - 0.5, FINE * 120.0 - 0.5
)
GRID = ProfileGrid(-9.0, 18, 3.0, 0.1)


def lit_planet(
    altitude_m: float, sun: np.ndarray, white_dn: float, psf_px: float, seed: int
) -> tuple[CameraView, np.ndarray]:
    """A camera on the limb and its frame of even ground, by Lambert's law, without air.

    sun : (3,) in the base frame, in which nadir is z and the camera looks along x. white_dn : of
    ground below the Sun.
    """
    planet = Planet()
    rho = planet.rho_from_altitude(altitude_m)
    axis = np.array([np.sin(rho), 0.0, np.cos(rho)])
    view = CameraView("camera_1", CAMERA, rot_from_axis(axis, 0.4))
    px = np.stack(np.meshgrid(np.arange(FINER.width), np.arange(FINER.height)), axis=-1)
    rays = FINER.rays(px.reshape(-1, 2).astype(float)) @ view.rot_base_from_cam.T
    # The planet's centre lies at one over sin rho of its radii.
    down = rays[:, 2] / np.sin(rho)
    inside = down**2 - 1.0 / np.sin(rho) ** 2 + 1.0
    far = down - np.sqrt(np.maximum(inside, 0.0))
    ground = far[:, None] * rays - NADIR / np.sin(rho)
    light = np.where((inside > 0.0) & (down > 0.0), np.maximum(ground @ sun, 0.0), 0.0)
    drawn = cv2.GaussianBlur(light.reshape(FINER.height, FINER.width), (0, 0), FINE * psf_px)
    levels = 8.0 + white_dn * cv2.resize(drawn, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    levels += np.random.default_rng(seed).normal(0.0, 1.5, levels.shape)
    return view, np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def fix_of(view: CameraView, image: np.ndarray) -> HorizonFix:
    return HorizonSensor().process([Frame(view, image)])


def sun_past(altitude_m: float, ends_rad: float, aside_rad: float) -> np.ndarray:
    """Sun (3,) that sets on the limb at an azimuth about nadir, and shines from one farther on."""
    tan_rho = np.tan(Planet().rho_from_altitude(altitude_m))
    height = np.arctan(-np.cos(aside_rad) / tan_rho)
    azimuth = ends_rad + aside_rad
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return np.asarray(np.cos(height) * level + np.sin(height) * np.array([0.0, 0.0, -1.0]))


@pytest.mark.parametrize(("altitude_m", "ends_rad"), [(500e3, 0.1), (1000e3, 0.1), (1000e3, 0.25)])
def test_an_end_at_the_terminator_does_not_turn_the_limb(
    altitude_m: float, ends_rad: float
) -> None:
    """Its edges, up to five pixels too far in, put nadir 0.5 to 1.6 deg off: NEES 13 to 108."""
    fix = fix_of(*lit_planet(altitude_m, sun_past(altitude_m, ends_rad, -2.5), 200.0, 0.55, 1))
    assert not fix.ok or nees(fix, NADIR) < 9.0


@pytest.mark.parametrize(("altitude_m", "ends_rad"), [(500e3, 0.25), (2500e3, 0.4)])
def test_the_limb_before_such_an_end_gives_a_fix(altitude_m: float, ends_rad: float) -> None:
    """Refused before, as an edge that follows no model."""
    fix = fix_of(*lit_planet(altitude_m, sun_past(altitude_m, ends_rad, -2.1), 200.0, 0.55, 1))
    assert fix.ok, fix.reason
    assert error_deg(fix, NADIR) < 0.5
    assert nees(fix, NADIR) < 9.0


def rising(step: np.ndarray, depth_power: float = 0.5) -> np.ndarray:
    """Profiles (N, J) across edges with steps (N,) of their own, and a rise to 100 below them."""
    depth = np.maximum(-GRID.d_px, 0.0) / 5.0
    lit = np.where(GRID.d_px < 0.0, step[:, None] + (100.0 - step[:, None]) * depth**depth_power, 0)
    return np.asarray(8.0 + lit)


def test_ends_that_fade_are_told() -> None:
    step = np.concatenate((np.linspace(2.0, 30.0, 8), np.full(22, 100.0)))
    ends = fading_ends(rising(step), GRID, step)
    assert ends[:6].all()
    assert not ends[9:].any()
    assert np.array_equal(fading_ends(rising(step)[::-1], GRID, step[::-1]), ends[::-1])


def test_dark_ground_amid_the_limb_and_a_limb_that_fades_all_along_are_none() -> None:
    amid = np.concatenate((np.full(11, 100.0), np.full(8, 10.0), np.full(11, 100.0)))
    assert not fading_ends(rising(amid), GRID, amid).any()
    along = np.full(30, 10.0)
    assert not fading_ends(rising(along), GRID, along).any()
    # Ground that is darker towards an end, but whose edge is a step, is no terminator.
    darker = np.linspace(5.0, 100.0, 30)
    steps = np.where(GRID.d_px < 0.0, darker[:, None], 0.0) + 8.0
    assert not fading_ends(steps, GRID, darker).any()


def test_an_overexposed_part_of_the_limb_does_not_turn_it() -> None:
    """Lenses sharper than usual: nadir was .09 to .5 deg off, at an NEES of 4.6 in the mean."""
    found = []
    for altitude_m, ends_rad, aside_rad, white_dn, psf_px in (
        (1000e3, 0.9, -2.0, 700.0, 0.45),
        (1000e3, 1.2, -1.9, 500.0, 0.35),
        (1000e3, 1.2, -1.9, 500.0, 0.45),
        (1000e3, 1.2, -2.2, 500.0, 0.45),
    ):
        sun = sun_past(altitude_m, ends_rad, aside_rad)
        fix = fix_of(*lit_planet(altitude_m, sun, white_dn, psf_px, 1))
        assert fix.ok, fix.reason
        assert error_deg(fix, NADIR) < 0.15
        found.append(nees(fix, NADIR))
    assert np.mean(found) < 2.0

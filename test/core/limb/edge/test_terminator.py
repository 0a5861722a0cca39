"""Terminators that curve like limbs, drawn here, against the truth; limbs beside clouds, against
the law that tells them apart.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.terminator import beside_over_deep, terminator
from horizon_sensor_ros.core.limb.profiles import ProfileGrid
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

PLANET = Planet(has_air=False)
CAMERA = Camera(480, 360, 3000.0, 3000.0, 239.5, 179.5)
VIEW = CameraView("camera_1", CAMERA, np.eye(3))
FINE = 4  # drawn pixels to a pixel
RADIUS_PX = 220.0
GRID = ProfileGrid(-9.0, 18, 3.0, 0.1)
PHASES_DEG = (20.0, 24.0, 30.0, 38.0)


def cut_disc(sun_side: bool, phase_deg: float) -> tuple[HorizonFix, np.ndarray]:
    """Fix of a disc that the frame cuts, and its nadir: the half that faces the Sun, or the other.

    phase_deg : between the Sun and the craft, as the planet sees them. Ground is as bright as the
    sine of the Sun's height to the 0.6th, as clouds roughly are.
    """
    rng = np.random.default_rng(int(phase_deg))
    centre = np.array([240.0 + rng.uniform(-60.0, 60.0), 470.0])
    y, x = (np.mgrid[: 360 * FINE, : 480 * FINE] + 0.5) / FINE - 0.5
    x, y = (x - centre[0]) / RADIUS_PX, (y - centre[1]) / RADIUS_PX
    to_craft = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    aside = -y if sun_side else y
    phase = np.radians(phase_deg)
    to_sun = np.maximum(to_craft * np.cos(phase) + aside * np.sin(phase), 0.0)
    drawn = cv2.GaussianBlur(np.where(x * x + y * y < 1.0, to_sun**0.6, 0.0), (0, 0), 0.6 * FINE)
    levels = 12.0 + 180.0 * drawn.reshape(360, FINE, 480, FINE).mean(axis=(1, 3))
    image = np.clip(np.rint(levels + rng.normal(0.0, 2.0, levels.shape)), 0, 255).astype(np.uint8)
    sensor = HorizonSensor(HorizonConfig(planet=PLANET, altitude_max_m=1e10))
    return sensor.process([Frame(VIEW, image)]), CAMERA.rays(centre[None])[0]


@pytest.mark.parametrize("phase_deg", PHASES_DEG)
def test_a_terminator_is_no_limb(phase_deg: float) -> None:
    """Taken for one it put nadir 0.4 to 1.8 deg off, at 0.01 to 0.07 claimed."""
    fix, _ = cut_disc(False, phase_deg)
    assert not fix.ok
    assert "a terminator" in fix.reason


@pytest.mark.parametrize("phase_deg", PHASES_DEG)
def test_the_other_side_of_the_disc_is_one(phase_deg: float) -> None:
    fix, nadir = cut_disc(True, phase_deg)
    assert fix.ok, fix.reason
    assert np.degrees(np.arccos(min(fix.fit.nadir_base @ nadir, 1.0))) < 0.02


def rising(step: float, power: float, contrast: float = 0.0, seed: int = 0) -> float:
    """`beside_over_deep` of edges with a step, and a rise to 1 - step five pixels below."""
    rng = np.random.default_rng(seed)
    depth = np.maximum(-GRID.d_px, 0.0) / 5.0
    lit = np.where(GRID.d_px < 0.0, step + (1.0 - step) * depth**power, 0.0)
    texture = 1.0 + contrast * rng.normal(size=(60, len(lit)))
    return beside_over_deep(8.0 + 100.0 * lit * texture, GRID)


ARC = np.column_stack((np.linspace(150.0, 330.0, 40), np.full(40, 100.0)))


def told(
    share: float,
    px: np.ndarray,
    nadir: np.ndarray,
    step: float = 0.0,
    power: float = 0.5,
    view: CameraView = VIEW,
) -> str:
    """Whether an edge is told, of such a share, below which brightness goes on as of `rising`; it
    is a row of pixels, or around the middle of the frame.
    """
    y, x = np.mgrid[:360, :480].astype(float)
    depth = y - 100.0
    normal = np.tile([0.0, -1.0], (len(px), 1))
    if np.ptp(px[:, 1]) > 0.0:
        middle = np.array([239.5, 179.5])
        depth = 100.0 - np.hypot(x - middle[0], y - middle[1])
        normal = (px - middle) / 100.0
    lit = step + (1.0 - step) * (np.maximum(depth, 0.0) / 5.0) ** power
    gray = np.clip(np.where(depth > 0.0, 8.0 + 40.0 * lit, 8.0), 0.0, 255.0).astype(np.uint8)
    limb = LimbPoints(Status.OK, "", px, normal, np.full(len(px), 0.1))
    return terminator(replace(limb, beside_over_deep=share), view, nadir, gray, 8.0)


@given(st.floats(0.5, 1.0))
def test_what_rises_from_nothing_is_told(power: float) -> None:
    nadir = np.array([0.0, 0.0, 1.0])
    assert "a terminator" in told(rising(0.0, power), ARC, nadir, power=power)


@pytest.mark.parametrize(("step", "refused"), [(0.35, True), (0.65, False), (1.0, False)])
def test_half_of_the_brightness_has_to_be_the_limbs(step: float, refused: bool) -> None:
    assert bool(told(rising(step, 0.5), ARC, np.array([0.0, 0.0, 1.0]), step)) == refused


def test_clouds_that_end_farther_in_are_none() -> None:
    """Beside the edge a third as bright as five pixels in, and no brighter twenty pixels in."""
    assert told(0.3, ARC, np.array([0.0, 0.0, 1.0]), step=0.95) == ""


def test_where_it_cannot_be_seen_to_go_on_it_is_told() -> None:
    at_the_end = ARC + np.array([0.0, 245.0])
    assert told(0.3, at_the_end, np.array([0.0, 0.0, 1.0]), step=0.95) != ""


def test_clouds_make_no_terminator_of_a_limb_nor_a_limb_of_a_terminator() -> None:
    """Nine tenths of the brightness are the limb's: without the error of the mean one limb in 16
    beside such clouds is refused.
    """
    nadir = np.array([0.0, 0.0, 1.0])

    def refused(step: float) -> float:
        return float(
            np.mean([bool(told(rising(step, 0.5, 0.6, k), ARC, nadir)) for k in range(300)])
        )

    assert refused(0.75) < 0.02
    assert refused(0.0) > 0.9


@given(st.floats(0.3, 3.0))
def test_a_blurred_step_is_none(blur_px: float) -> None:
    step = np.array([0.5 * math.erfc(d / blur_px / math.sqrt(2.0)) for d in GRID.d_px])
    assert beside_over_deep(8.0 + 100.0 * np.tile(step, (60, 1)), GRID) > 0.97


def test_whole_discs_are_not_asked() -> None:
    assert np.isnan(beside_over_deep(np.ones((5, len(GRID.d_px))), GRID))
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring = np.array([239.5, 179.5]) + 100.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    nadir = np.array([0.0, 0.0, 1.0])
    rot = Rotation.from_rotvec([0.4, -1.1, 0.3]).as_matrix()
    for view, towards in ((VIEW, nadir), (CameraView("camera_1", CAMERA, rot), rot @ nadir)):
        assert told(0.5, ring, towards, view=view) == ""
        assert told(0.5, ring[:18], towards, view=view) != ""

"""Interlaced frames: even and odd rows that were seen one after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import NADIR, SENSOR, SQUARE, nees, sigma_deg
from limb_frames import as_frames, clouds, draw, limb_views
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.two_fields import fields_apart_px, with_two_fields
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.horizon.fix import HorizonFix

ALTITUDE_M = 6e5
VIEWS = limb_views(ALTITUDE_M, azimuths_rad=SQUARE)
TURN_RAD = np.radians(0.08)  # from field to field: at 60 a second 5 deg/s
THREE_SIGMA = 11.8  # NEES of two degrees of freedom that one in 370 is beyond


def turned(by_rad: np.ndarray) -> tuple[CameraView, ...]:
    turn = Rotation.from_rotvec(by_rad).as_matrix()
    return tuple(replace(v, rot_base_from_cam=turn @ v.rot_base_from_cam) for v in VIEWS)


def interlaced(seed: int, by_rad: np.ndarray) -> list[np.ndarray]:
    """Frames whose odd rows show what is seen after a turn; the even ones are of the stamp."""
    first = draw(VIEWS, ALTITUDE_M, clouds(seed), seed=seed)
    second = draw(turned(by_rad), ALTITUDE_M, clouds(seed), seed=seed + 100)
    images = [frame.image.copy() for frame in first]
    for image, other in zip(images, second, strict=True):
        image[1::2] = other.image[1::2]
    return images


def fix_of(images: list[np.ndarray]) -> HorizonFix:
    fix = SENSOR.process(as_frames(VIEWS, images))
    assert fix.ok
    return fix


@pytest.mark.parametrize(("seed", "axis"), [(1, (1.0, 0.0, 0.0)), (2, (0.6, 0.8, 0.0))])
def test_what_fields_are_apart_by_is_claimed(seed: int, axis: tuple[float, ...]) -> None:
    apart = fix_of(interlaced(seed, TURN_RAD * np.array(axis)))
    assert nees(apart, NADIR) < THREE_SIGMA
    assert sigma_deg(apart) < 0.1  # and no more than that


def test_frames_of_one_moment_claim_nothing() -> None:
    frames = interlaced(3, np.zeros(3))
    limbs = fix_of(frames).limbs
    apart = [fields_apart_px(limb, image) for limb, image in zip(limbs, frames, strict=True)]
    assert apart == [0.0, 0.0]


@pytest.mark.parametrize(("moves_deg_s", "asked"), [(None, True), (5.0, True), (0.05, False)])
def test_a_craft_that_hardly_turns_is_not_asked(moves_deg_s: float | None, asked: bool) -> None:
    """Fields that differ are claimed where the limb moves, or may; 0.05 deg/s is no hundredth of a
    pixel in a fiftieth of a second.
    """
    images = interlaced(1, TURN_RAD * np.array([1.0, 0.0, 0.0]))
    limbs = [
        LimbObservation(view, replace(limb, shared=limb.shared._replace(fields_px=0.0)))
        for view, limb in zip(VIEWS, fix_of(images).limbs, strict=True)
    ]
    moves_rad_s = None if moves_deg_s is None else np.radians(moves_deg_s)
    claimed = with_two_fields(limbs, images, NADIR, moves_rad_s)
    assert (max(seen.limb.shared.fields_px for seen in claimed) > 0.1) == asked

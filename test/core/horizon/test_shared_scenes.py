"""The whole chain on scenes and photographs of others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from horizon_fixes import SENSOR, assert_refused, error_deg, sigma_deg
from limb_frames import photograph, shared_frames, shared_truths

WITHIN_DEG = {
    **dict.fromkeys(["flat", "clouds", "air", "dim", "sun", "moon", "boom", "lens", "high"], 0.1),
    "wgs84": 0.3,
}


@pytest.mark.parametrize("kind", sorted(WITHIN_DEG))
def test_shared_scenes_with_both_cameras(kind: str, shared_data: Path) -> None:
    truth = shared_truths(shared_data)[f"{kind}0"]
    fix = SENSOR.process(shared_frames(shared_data, truth))
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_1", "camera_2")
    assert error_deg(fix, np.array(truth["nadir_body"])) < WITHIN_DEG[kind]
    if truth["geodetic_nadir_body"] is not None:
        assert error_deg(fix, np.array(truth["geodetic_nadir_body"])) < WITHIN_DEG[kind]
    # glow and clouds stand above the ground
    assert fix.fit.altitude_m == pytest.approx(truth["altitude_km"] * 1e3, abs=30e3, rel=0.02)


@pytest.mark.parametrize("kind", ["terminator", "balloon"])
def test_shared_scenes_within_bounds_or_no_fix(kind: str, shared_data: Path) -> None:
    truth = shared_truths(shared_data)[f"{kind}0"]
    fix = SENSOR.process(shared_frames(shared_data, truth))
    if fix.ok:
        assert error_deg(fix, np.array(truth["nadir_body"])) < 0.3
    else:
        assert_refused(fix, 2)


@pytest.mark.parametrize("kind", ["space", "earth"])
def test_shared_scenes_with_a_blind_camera(kind: str, shared_data: Path) -> None:
    truth = shared_truths(shared_data)[f"{kind}0"]
    frames = shared_frames(shared_data, truth)
    assert_refused(SENSOR.process(frames[:1]), 1)
    fix = SENSOR.process(frames)
    assert "camera_1" not in fix.cameras_used
    if fix.ok:
        assert error_deg(fix, np.array(truth["nadir_body"])) < max(0.3, 4.0 * sigma_deg(fix))
        # What it says is of itself.
        assert "camera_2" not in fix.limbs[0].reason


def test_a_night_frame_is_refused(shared_data: Path) -> None:
    truth = shared_truths(shared_data)["night0"]
    assert_refused(SENSOR.process(shared_frames(shared_data, truth)), 2)


def test_photograph_by_day(shared_data: Path) -> None:
    frame = photograph(shared_data / "earth_real" / "iss064_flickr50644513538.jpg", 56.0)
    fix = SENSOR.process([frame])
    assert fix.ok, fix.reason
    assert 250e3 < fix.fit.altitude_m < 600e3


def test_photograph_flooded_by_the_sun(shared_data: Path) -> None:
    frame = photograph(shared_data / "earth_real" / "ISS028-E-33700.JPG", 15.0)
    assert_refused(SENSOR.process([frame]), 1)

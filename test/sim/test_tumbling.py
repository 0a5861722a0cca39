"""The tumbling target's motion against the laws of a free body."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.sim.tumbling import TumblingTarget

TARGET = TumblingTarget()
STEP_S = 1e-4


def rate_in_camera(time_s: float) -> np.ndarray:
    """Angular rate (3,) in the camera's frame, from two near poses."""
    before, after = TARGET.pose(time_s - STEP_S), TARGET.pose(time_s + STEP_S)
    return vector_from_rotation(after[:3, :3] @ before[:3, :3].T) / (2 * STEP_S)


@pytest.mark.parametrize("time_s", [0.0, 3.0, 17.0])
def test_rate_is_precession_and_spin(time_s: float) -> None:
    momentum, spin = (np.array(a) / np.linalg.norm(a) for a in (TARGET.momentum_axis, (0, 1, 0)))
    own = TARGET.pose(time_s)[:3, :3] @ spin
    expected = TARGET.precession_rad_s * momentum + TARGET.spin_rad_s * own
    np.testing.assert_allclose(rate_in_camera(time_s), expected, atol=1e-8)


def test_the_spin_axis_keeps_its_angle_to_the_momentum() -> None:
    momentum = np.array(TARGET.momentum_axis) / np.linalg.norm(TARGET.momentum_axis)
    angles = [momentum @ TARGET.pose(t)[:3, :3] @ TARGET.spin_axis for t in range(30)]
    np.testing.assert_allclose(angles, angles[0], atol=1e-12)


def test_the_scan_is_of_the_pose_and_the_same_every_time() -> None:
    one, again, later = (TARGET.scan(t) for t in (2.0, 2.0, 3.0))
    np.testing.assert_array_equal(one.pose_cam_from_target, TARGET.pose(2.0))
    np.testing.assert_array_equal(one.points, again.points)
    assert not np.array_equal(one.points, later.points, equal_nan=True)
    assert np.isfinite(one.points[..., 2]).sum() > 2000

"""Pairs of bars, which show other sides as they turn about themselves."""

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.target_motion.alignment.matcher import Matcher
from horizon_sensor_ros.core.target_motion.alignment.pairs import THIN
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView, surface_view
from horizon_sensor_ros.sim.shapes import assembly, beam
from horizon_sensor_ros.sim.tof_camera import ToFCamera

PLACE_M = np.array([0.0, 0.0, 4.5])
WIDTH_M = 0.02
# Some that lie along x, and one that stands.
BARS = assembly(
    [beam((-0.7, y, 0), (0.7, y, 0.1), WIDTH_M) for y in (-0.5, -0.2, 0.1, 0.4)]
    + [beam((0.1, -0.6, 0.1), (0.1, 0.6, 0.1), WIDTH_M)]
)


def view(turn: np.ndarray) -> SurfaceView:
    pose = pose_matrix(turn, PLACE_M)
    return surface_view(range_image(ToFCamera().scan(BARS, pose, np.random.default_rng(0)).points))


@pytest.mark.parametrize("axis", range(3))
def test_bars_are_off_as_far_as_they_turned_about_themselves(axis: int) -> None:
    start = rotation_from_vector(np.array([0.3, 0.4, 0.2]))
    directions = start[:, 0] + 0.07 * start[:, 2], start[:, 1]
    turn = rotation_from_vector(0.3 * (start[:, axis] if axis < 2 else PLACE_M / 4.5))
    a, b = view(start), view(turn @ start)
    pairs = Matcher(a, b).pairs(turn, PLACE_M - turn @ PLACE_M, 0.02)
    # Those along x are the most.
    for k, direction in enumerate(directions):
        bars = pairs.kind == THIN + k
        assert np.count_nonzero(bars) > 15
        assert abs(pairs.bars[k] @ (turn @ direction)) > np.cos(np.radians(15))
        off_m = pairs.sides_m[k]
        if k == axis:
            assert 0.1 * WIDTH_M < off_m < 0.3 * WIDTH_M
        else:
            assert off_m < 0.08 * WIDTH_M

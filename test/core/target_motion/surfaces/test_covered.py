"""Pixels that the end of a surface covers in part return the range of that part's middle, which on
a slanted face is nearer or farther than in the pixel's own.
"""

import numpy as np
from registered_motion import motion_nees, pose_of

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.surfaces.covered import off_middle_px
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TARGETS, TriangleMesh
from horizon_sensor_ros.sim.tof_camera import ToFCamera

# Pixels 7 cm wide on the target.
CAMERA = ToFCamera(48, 48, pixel_pitch_m=170e-6, range_noise_m=0.004)
DISTANCE_M = 5.5
COARSE = RegistrationConfig(max_rotation_sigma_rad=np.radians(2.0), max_shift_sigma_m=0.05)


def averaged_cloud(
    target: TriangleMesh, pose: np.ndarray, rng: np.random.Generator, least: float
) -> np.ndarray:
    """(H, W, 3) returns, each the mean of what covers its pixel; none where it is covered by less
    than a share ``least``.
    """
    k = 5
    fine = CAMERA.ranges(target, pose, k).reshape(CAMERA.height, k, CAMERA.width, k)
    seen = np.isfinite(fine)
    count = seen.sum(axis=(1, 3))
    mean = np.where(seen, fine, 0.0).sum(axis=(1, 3)) / np.maximum(count, 1)
    measured = np.where(count >= least * k * k, mean, np.nan)
    measured += rng.normal(0, CAMERA.range_noise_m, measured.shape)
    return CAMERA.rays() * measured[..., None]


def test_motions_by_pixels_that_average_are_claimed_as_they_are_known() -> None:
    """As if they lay in the middles of their pixels the mean square was 6.8 standard deviations
    squared of the six unknowns, and the largest 21.
    """
    squares = []
    for name in ("n1", "n5"):
        for seed in range(14):
            rng = np.random.default_rng(seed)
            before = pose_of(rng, DISTANCE_M)
            turn = rotation_from_vector(rng.normal(size=3) * np.radians(6)) @ before[:3, :3]
            poses = before, pose_matrix(turn, before[:3, 3] + rng.normal(size=3) * 0.05)
            clouds = (averaged_cloud(TARGETS[name](), pose, rng, 0.125) for pose in poses)
            found = register(*map(target_view, clouds), COARSE)
            if found.status is Status.OK:
                squares.append(motion_nees(found, poses))
    assert len(squares) > 18
    assert np.mean(squares) < 6.0


def test_returns_lie_in_the_middle_of_their_pixels_but_at_the_ends_of_surfaces() -> None:
    """A lone missing return within a surface is no end of it."""
    points = CAMERA.rays() * DISTANCE_M
    outside = np.ones(points.shape[:2], bool)
    outside[10:-10, 10:-10] = False
    outside[24, 24] = True
    points[outside] = np.nan
    image = range_image(points)
    inner = np.zeros(points.shape[:2], bool)
    inner[11:-11, 11:-11] = True
    seen = image.inverse_depth > 0
    off = off_middle_px(image).reshape(seen.shape)
    assert np.count_nonzero(seen & (off == 0)) == np.count_nonzero(inner & ~outside)
    assert np.count_nonzero(seen & (off > 0)) == np.count_nonzero(~inner & ~outside)

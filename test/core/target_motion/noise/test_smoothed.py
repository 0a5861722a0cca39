"""Clouds that the sensor's driver has smoothed: noise that neighbours share."""

from functools import partial

import numpy as np
import pytest
from registered_motion import nees_of_steps, pose_of
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix
from horizon_sensor_ros.core.target_motion.noise.smoothed_noise import are_smoothed
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes
from horizon_sensor_ros.core.target_motion.target_view import TargetView, target_view
from horizon_sensor_ros.sim.shapes import TARGETS
from horizon_sensor_ros.sim.tof_camera import ToFCamera

TARGET = {name: build() for name, build in TARGETS.items()}
NOISE_M = 0.01
CAMERA = ToFCamera(range_noise_m=NOISE_M)
_ONE_SURFACE_M = 0.08


def smoothed(points: np.ndarray) -> np.ndarray:
    """An organised cloud whose ranges are the means over 3 x 3 pixels, as far as these are of one
    surface.
    """
    ranges = np.linalg.norm(points, axis=-1)
    total, count = np.zeros((2, *ranges.shape))
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            beside = np.roll(ranges, (down, across), (0, 1))
            near = np.abs(beside - ranges) < _ONE_SURFACE_M
            total[near] += beside[near]
            count += near
    return points * (total / np.maximum(count, 1) / ranges)[..., None]


@pytest.mark.parametrize("name", ["n1", "n5", "plate_with_dish"])
def test_noise_of_smoothed_ranges_counts_as_before_smoothing(name: str) -> None:
    """It was taken for .3 of that, by how neighbours differ."""
    told = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scan = CAMERA.scan(TARGET[name], pose_of(rng), rng)
        told.append(local_planes(range_image(smoothed(scan.points))).sigma_m)
    assert np.median(told) == pytest.approx(NOISE_M, rel=0.2)


@pytest.mark.parametrize("noise_m", [0.002, 0.005, 0.01])
def test_independent_noise_is_not_taken_for_smoothed(noise_m: float) -> None:
    """Nor are creases, curved surfaces and thin parts."""
    camera = ToFCamera(range_noise_m=noise_m)
    for target in TARGET.values():
        for seed in range(5):
            rng = np.random.default_rng(seed)
            image = range_image(camera.scan(target, pose_of(rng), rng).points)
            assert not are_smoothed(image.inverse_depth)


@pytest.mark.parametrize(
    ("name", "seeds"), [("plate_with_dish", (76, 81, 119)), ("l_truss", (25, 36, 95))]
)
def test_nor_are_bodies_that_are_mostly_ends(name: str, seeds: tuple[int, ...]) -> None:
    """Of 120 clouds each these were, and counted as noisy by centimetres."""
    for seed in seeds:
        pose = pose_matrix(Rotation.random(random_state=seed).as_matrix(), np.array([0, 0, 5.3]))
        image = range_image(
            ToFCamera().scan(TARGET[name], pose, np.random.default_rng(seed)).points
        )
        assert not are_smoothed(image.inverse_depth)


@pytest.mark.parametrize("num", [10, pytest.param(40, marks=pytest.mark.slow)])
def test_motions_between_smoothed_clouds_are_claimed_as_they_are_known(num: int) -> None:
    """With the noise that neighbours tell, 31 of the 40 clouds were refused, as parts were off by
    more than it, and the mean square of the others was 24 standard deviations squared.
    """

    def view_of(name: str, pose: np.ndarray, rng: np.random.Generator) -> TargetView:
        return target_view(smoothed(CAMERA.scan(TARGET[name], pose, rng).points))

    squares = []
    for name in ("n1", "n5"):
        squares += nees_of_steps(partial(view_of, name), range(num))
    assert len(squares) > 1.75 * num
    assert np.mean(squares) < 6.0
    assert max(squares) < chi2.ppf(0.9973, 6)


def test_exact_ranges_were_not_smoothed() -> None:
    """Neighbours and others differ by nothing alike."""
    assert not are_smoothed(np.full((60, 80), 0.2, np.float32))

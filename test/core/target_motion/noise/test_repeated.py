"""Clouds of which the sensor's driver took the median of 3 x 3 pixels."""

from functools import partial

import numpy as np
import pytest
from registered_motion import nees_of_steps, pose_of
from scipy.stats import chi2

from horizon_sensor_ros.core.target_motion.noise.repeated_returns import are_repeated
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes
from horizon_sensor_ros.core.target_motion.target_view import TargetView, target_view
from horizon_sensor_ros.sim.shapes import TARGETS
from horizon_sensor_ros.sim.tof_camera import ToFCamera

TARGET = {name: build() for name, build in TARGETS.items()}
NOISE_M = 0.01
CAMERA = ToFCamera(range_noise_m=NOISE_M)


def middled(points: np.ndarray) -> np.ndarray:
    """An organised cloud whose ranges are the medians over 3 x 3 pixels of those that returned."""
    ranges = np.pad(np.linalg.norm(points.astype(float), axis=-1), 1, constant_values=np.nan)
    beside = np.lib.stride_tricks.sliding_window_view(ranges, (3, 3)).reshape(-1, 9)
    seen = np.flatnonzero(np.isfinite(beside[:, 4]))
    median = np.full(len(beside), np.nan)
    median[seen] = np.nanmedian(beside[seen], axis=1)
    return points * (median / beside[:, 4]).reshape(points.shape[:2])[..., None]


def repeated(points: np.ndarray) -> bool:
    image = range_image(points)
    return are_repeated(image.inverse_depth, *image.tangents())


@pytest.mark.parametrize("name", list(TARGET))
def test_medians_are_told_from_independent_ranges(name: str) -> None:
    """On trusses and curved bodies as well."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        points = CAMERA.scan(TARGET[name], pose_of(rng), rng).points
        assert not repeated(points)
        assert repeated(middled(points))


@pytest.mark.parametrize("step_m", [0.0001, 0.0003, 0.001, 0.01])
def test_steps_and_filled_returns_are_no_medians(step_m: float) -> None:
    """Steps repeat by chance, and what is copied from beside into dead pixels along rows."""
    for name in ("n5", "l_truss"):
        rng = np.random.default_rng(7)
        points = CAMERA.scan(TARGET[name], pose_of(rng), rng).points
        ranges = np.linalg.norm(points.astype(float), axis=-1)
        stepped = np.round(ranges / step_m) * step_m
        assert not repeated(points * (stepped / ranges)[..., None])
        dead = rng.random(ranges.shape) < 0.03
        filled = np.where(dead, np.roll(ranges, 1, axis=1), ranges)
        assert not repeated(points * (filled / ranges)[..., None])


@pytest.mark.parametrize("name", ["n1", "n5", "plate_with_dish"])
def test_noise_counts_as_before_the_median(name: str) -> None:
    """It was taken for .2 to .4 of that, by how neighbours differ."""
    told = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        points = CAMERA.scan(TARGET[name], pose_of(rng), rng).points
        told.append(local_planes(range_image(middled(points))).sigma_m)
    assert np.median(told) == pytest.approx(NOISE_M, rel=0.25)


def test_motions_between_medians_are_claimed_as_they_are_known() -> None:
    def view_of(name: str, pose: np.ndarray, rng: np.random.Generator) -> TargetView:
        return target_view(middled(CAMERA.scan(TARGET[name], pose, rng).points))

    squares = []
    for name in ("n1", "n5", "l_truss"):
        squares += nees_of_steps(partial(view_of, name), range(6))
    assert len(squares) > 15
    assert np.mean(squares) < 8.0
    assert max(squares) < chi2.ppf(0.9973, 6)

"""Clouds whose rows, or columns, have some of their noise in common."""

from functools import partial

import numpy as np
import pytest
from registered_motion import nees_of_steps, pose_of
from scipy.stats import chi2

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix
from horizon_sensor_ros.core.target_motion.noise.common_noise import common_variance
from horizon_sensor_ros.core.target_motion.target_view import TargetView, target_view
from horizon_sensor_ros.sim.shapes import TARGETS
from horizon_sensor_ros.sim.tof_camera import ToFCamera

TARGET = {name: build() for name, build in TARGETS.items()}
CAMERA = ToFCamera(range_noise_m=0.004)
COMMON_M = 0.004
SOME = ["n1", "n5", "plate_with_dish"]


def view_of(
    name: str, pose: np.ndarray, rng: np.random.Generator, axis: int | None = None
) -> TargetView:
    """With noise that is common along that axis."""
    points = CAMERA.scan(TARGET[name], pose, rng).points
    if axis is not None:
        ranges = np.linalg.norm(points.astype(float), axis=-1, keepdims=True)
        count = [*points.shape[:2], 1]
        count[axis] = 1
        points = points * (1 + rng.normal(0.0, COMMON_M, count) / ranges)
    return target_view(points)


def told_m(a: TargetView, b: TargetView) -> list[float]:
    """Of rows, and of columns."""
    assert a.surface is not None
    assert b.surface is not None
    lines = zip(a.surface.line_means, b.surface.line_means, strict=True)
    return [np.sqrt(common_variance(*each, a.surface.footprint_m)) for each in lines]


@pytest.mark.parametrize("name", list(TARGET))
@pytest.mark.parametrize("squarely", [False, True])
def test_independent_noise_has_nothing_in_common(name: str, squarely: bool) -> None:
    """On trusses, curved bodies, and creases along the rows as well."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        pose = pose_matrix(np.eye(3), np.array([0.1, 0.0, 5.0])) if squarely else pose_of(rng)
        assert told_m(*(view_of(name, pose, rng) for _ in range(2))) == [0.0, 0.0]


@pytest.mark.parametrize("axis", [0, 1])
def test_what_lines_have_in_common_is_told(axis: int) -> None:
    told = []
    for name in SOME:
        for seed in range(3):
            rng = np.random.default_rng(seed)
            pose = pose_of(rng)
            rows_and_columns = told_m(*(view_of(name, pose, rng, axis) for _ in range(2)))
            assert rows_and_columns[axis] == 0.0
            told.append(rows_and_columns[1 - axis])
    assert np.median(told) == pytest.approx(COMMON_M, rel=0.35)
    assert np.count_nonzero(told) >= len(told) - 1


@pytest.mark.parametrize("axis", [0, 1])
def test_motions_are_claimed_as_they_are_known(axis: int) -> None:
    """Their squared errors had medians of 20 and more, as if it averaged down over lines."""
    squares = []
    for name in SOME:
        seen = partial(view_of, name, axis=axis)
        squares += nees_of_steps(seen, range(4), turn_deg=4.0, shift_m=1.0 / 30.0)
    assert len(squares) > 7
    assert np.median(squares) < 8.0
    assert max(squares) < chi2.ppf(0.9973, 6)

"""Noise of ranges that grows with the slant of what is seen, as a time-of-flight camera's does."""

from functools import partial

import numpy as np
import pytest
from registered_motion import nees_of_steps, pose_of
from scipy.stats import chi2

from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes, local_planes
from horizon_sensor_ros.core.target_motion.target_view import TargetView, target_view
from horizon_sensor_ros.sim.shapes import TARGETS, TriangleMesh
from horizon_sensor_ros.sim.tof_camera import ToFCamera

TARGET = {name: build() for name, build in TARGETS.items()}


def planes_of(target: TriangleMesh, seed: int, noise_m: float, growth: float) -> Planes:
    rng = np.random.default_rng(seed)
    camera = ToFCamera(range_noise_m=noise_m, slant_growth=growth)
    return local_planes(range_image(camera.scan(target, pose_of(rng), rng).points))


@pytest.mark.parametrize("growth", [0.3, 1.0])
def test_growth_of_the_noise_is_estimated(growth: float) -> None:
    """And the noise of what is seen squarely, which was taken for a quarter larger at a growth of
    1.
    """
    planes = [planes_of(TARGET["n5"], seed, 0.005, growth) for seed in range(12)]
    assert np.median([each.slant_growth for each in planes]) == pytest.approx(growth, rel=0.25)
    assert np.median([each.sigma_m for each in planes]) == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize("noise_m", [0.0003, 0.002, 0.01])
@pytest.mark.parametrize("name", sorted(TARGET))
def test_neither_curves_nor_edges_nor_thin_parts_are_taken_for_noise(
    name: str, noise_m: float
) -> None:
    grown = [planes_of(TARGET[name], seed, noise_m, 0.0).slant_growth for seed in range(10)]
    assert np.median(grown) == 0.0
    # As many as are beyond two sigma by chance.
    assert np.mean(np.array(grown) > 0) <= 0.2


@pytest.mark.parametrize("num", [20, pytest.param(80, marks=pytest.mark.slow)])
def test_motions_beside_noise_that_grows_with_the_slant_are_claimed_as_they_are_known(
    num: int,
) -> None:
    """One noise for all faces let the mean square be 6.9 standard deviations squared of the six
    unknowns, and the largest 23.
    """
    camera = ToFCamera(range_noise_m=0.01, slant_growth=1.0)

    def view_of(name: str, pose: np.ndarray, rng: np.random.Generator) -> TargetView:
        return target_view(camera.scan(TARGET[name], pose, rng).points)

    squares = []
    for name in ("n1", "n5"):
        squares += nees_of_steps(partial(view_of, name), range(num), distance_m=5.3)
    assert len(squares) > 1.75 * num
    assert np.mean(squares) < 6.0
    assert max(squares) < chi2.ppf(0.9973, 6)

"""Where the sensor's frame cuts the target off there is no edge, nor does a cloud without its empty
pixels say where that is.
"""

from collections.abc import Callable

import numpy as np
import pytest
from registered_motion import motion_nees

from horizon_sensor_ros.core.mathematics.rigid import (
    pose_matrix,
    rotation_from_vector,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import assembly, beam, box, revolved
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CAMERA = ToFCamera(width=160, height=120, range_noise_m=0.004)
PRISM = revolved([(0.0, -1.5), (0.35, -1.5), (0.35, 1.5), (0.0, 1.5)], segments=6)
# The boom and the box at its end make the outline nearly twice as wide as what the frame cuts off.
TARGET = assembly(
    [PRISM, box((0.25, 0.25, 0.3), (0.8, 0.1, 0.2)), beam((0.0, 0.0, 0.2), (0.8, 0.1, 0.2), 0.06)]
)


def test_a_prism_that_leaves_the_frame_is_not_taken_to_end_there() -> None:
    """Both its ends are out of the frame while it moves along itself. Where the frame is taken for
    its ends half of these 20 pairs are wrong with confidence, NEES up to 1155.
    """
    rng = np.random.default_rng(3)
    upright = rotation_from_vector(np.radians([-90.0, 0.0, 0.0]))
    squares, fixed = [], 0
    for _ in range(20):
        start = rotation_from_vector(np.radians(rng.uniform(-6, 6, 3))) @ upright
        turn = rotation_from_vector(np.radians(rng.uniform(-3, 3, 3)))
        place = np.array([rng.uniform(-0.4, -0.2), 0.0, 3.6])
        moved = place + np.array([0.0, rng.uniform(-0.1, 0.1), 0.0])
        poses = [pose_matrix(start, place), pose_matrix(turn @ start, moved)]
        a, b = (target_view(CAMERA.scan(TARGET, pose, rng).plain()) for pose in poses)
        found = register(a, b)
        if found.status is not Status.OK:
            continue
        fixed += 1
        squares.append(motion_nees(found, poses))
    assert fixed > 15
    assert max(squares) < 30


def rosette(pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) cloud of a long box with a small one at its side, by two prisms that turn at unlike
    rates: a field of 19 deg all around.
    """
    phase = 2 * np.pi * (np.linspace(0.0, 1.0, 40_000)[:, None] * (71.3, -46.9) + rng.random(2))
    u, v = (np.radians(9.5) * of(phase).sum(axis=1) for of in (np.cos, np.sin))
    rays = np.stack([u, v, np.ones(len(u))], axis=1) / np.sqrt(1 + u * u + v * v)[:, None]
    distance = np.full(len(rays), np.inf)
    for half, middle in (((0.25, 0.2, 1.6), (0, 0, 0)), ((0.15, 0.15, 0.1), (0.4, 0.05, 0.1))):
        start = -pose[:3, :3].T @ pose[:3, 3] - middle
        with np.errstate(divide="ignore"):
            crossed = (np.multiply.outer([-1, 1], half)[:, None] - start) / (rays @ pose[:3, :3])
        near, far = crossed.min(axis=0).max(axis=1), crossed.max(axis=0).min(axis=1)
        distance = np.where(near < far, np.minimum(distance, near), distance)
    seen = np.isfinite(distance)
    return rays[seen] * (distance[seen] + rng.normal(0.0, 0.005, seen.sum()))[:, None]


def test_a_box_that_leaves_a_round_field_is_not_taken_to_end_there() -> None:
    """As the prism above. Where the field is taken for its ends five of these 16 pairs are wrong
    with confidence, NEES up to 615.
    """
    rng = np.random.default_rng(4)
    upright = rotation_from_vector(np.radians([-90.0, 0.0, 0.0]))
    corner_on = upright @ rotation_from_vector(np.radians([0.0, 0.0, 40.0]))
    squares = []
    for _ in range(16):
        start = rotation_from_vector(np.radians(rng.uniform(-15, 15, 3))) @ corner_on
        turn = rotation_from_vector(np.radians(rng.uniform(-3, 3, 3)))
        place = np.array([*rng.uniform(-0.15, 0.15, 2), 2.6])
        moved = place + rng.uniform(-0.06, 0.06, 3)
        poses = [pose_matrix(start, place), pose_matrix(turn @ start, moved)]
        found = register(*(target_view(rosette(pose, rng)) for pose in poses))
        if found.status is Status.OK:
            squares.append(motion_nees(found, poses))
    assert len(squares) > 8
    assert max(squares) < 30


def test_outlines_in_view_are_known_to_end() -> None:
    """Of a disc, and of a square that leans by two pixels, all around is known to be empty."""
    y, x = np.mgrid[-50:51, -50:51] / 200
    lean = 0.05
    for inside in (x * x + y * y < 0.04, np.maximum(abs(x + lean * y), abs(y - lean * x)) < 0.2):
        depth = 2 / (1 + 0.3 * x)
        cloud = np.stack([x * depth, y * depth, depth], axis=-1)[inside]
        assert not range_image(cloud).unknown.any()


def strewn(
    rng: np.random.Generator, inside: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """(N, 3) cloud, on no grid, of a slanted face as far as ``inside`` of its tangents says."""
    u, v = rng.uniform(-0.25, 0.25, (2, 30_000))
    depth = 2 / (1 + 0.3 * u) + rng.normal(0.0, 0.002, len(u))
    return (np.array([u, v, np.ones(len(u))]) * depth)[:, inside(u, v)].T


def test_outside_a_round_field_nothing_is_known() -> None:
    image = range_image(strewn(np.random.default_rng(5), lambda u, v: np.hypot(u, v) < 0.2))
    assert not image.on_grid
    seen = image.inverse_depth > 0
    assert not image.unknown[seen].any()
    u, v = image.tangents()
    assert image.unknown[np.hypot(*np.meshgrid(u, v)) > 0.205].all()


@pytest.mark.parametrize("side", [0.14, 0.17])
def test_a_square_in_a_round_field_is_known_to_end(side: float) -> None:
    """Its corners are as far from the axis as one another, and its sides are not."""

    def inside(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.asarray(np.maximum(abs(u + 0.4 * v), abs(v - 0.4 * u)) < side)

    image = range_image(strewn(np.random.default_rng(6), inside))
    assert not image.on_grid
    # But for a hole or two in the cloud.
    assert np.mean(image.unknown[image.inverse_depth == 0]) < 0.01

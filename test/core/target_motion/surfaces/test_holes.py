"""Scattered missing returns: filled for the windows of planes, and no loss to the motion."""

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import (
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.surfaces.holes import without_holes
from horizon_sensor_ros.core.target_motion.target_view import target_view

FOCAL_PX, SIDE_PX = 220.0, 120
_U, _V = np.meshgrid(*2 * [np.arange(SIDE_PX) - (SIDE_PX - 1) / 2])
RAYS = np.stack([_U / FOCAL_PX, _V / FOCAL_PX, np.ones_like(_U)], axis=-1)
SEMI_AXES_M = np.array([1.5, 1.0, 0.6])
PLACE_M = np.array([0.1, -0.05, 7.0])
NOISE_M = 0.004


def plane_image() -> np.ndarray:
    """A slanted plane with two pixels of margin."""
    image = (0.2 + 0.001 * _U - 0.0007 * _V).astype(np.float32)
    image[:2] = image[-2:] = image[:, :2] = image[:, -2:] = 0
    return image


def test_a_plane_is_filled_exactly() -> None:
    truth = plane_image()
    seen = np.random.default_rng(0).random(truth.shape) > 0.03
    mended = without_holes(np.where(seen, truth, np.float32(0)))
    inner = slice(3, -3)
    filled = mended[inner, inner] > 0
    assert filled.mean() > 0.995
    assert np.allclose(mended[inner, inner][filled], truth[inner, inner][filled], atol=1e-6)
    assert np.array_equal(mended[seen], truth[seen])


def test_what_is_beyond_an_outline_stays_empty() -> None:
    """Of a disc no pixel outside has returns on two opposite sides."""
    image = np.where(np.hypot(_U, _V) < 40, np.float32(0.2), np.float32(0))
    assert np.array_equal(without_holes(image), image)


@pytest.mark.parametrize("turns", range(4))
def test_a_hole_at_a_step_belongs_to_one_side(turns: int) -> None:
    image = np.where(_U < 0, np.float32(0.3), np.float32(0.2))
    image[:2] = image[-2:] = image[:, :2] = image[:, -2:] = 0
    image[30, 59] = image[70, 60] = 0
    mended = np.rot90(without_holes(np.ascontiguousarray(np.rot90(image, turns))), -turns)
    assert mended[30, 59] == pytest.approx(0.3)
    assert mended[70, 60] == pytest.approx(0.2)


def ellipsoid_cloud(
    turn: np.ndarray, place: np.ndarray, missing: float, rng: np.random.Generator
) -> np.ndarray:
    """(H, W, 3) returns of an ellipsoid, some of them missing."""
    ray, start = RAYS @ turn / SEMI_AXES_M, -place @ turn / SEMI_AXES_M
    a, b, c = (ray**2).sum(axis=-1), ray @ start, start @ start - 1
    with np.errstate(invalid="ignore"):
        depth = (-b - np.sqrt(b * b - a * c)) / a
    depth += rng.normal(0, NOISE_M, depth.shape) / np.linalg.norm(RAYS, axis=-1)
    depth[rng.random(depth.shape) < missing] = np.nan
    return RAYS * depth[..., None]


def errors_and_nees(missing: float, pairs: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N,) of the turn, rad, and NEES (N,) of motions of an ellipsoid, with a true prior."""
    errors, nees = [], []
    for seed in range(pairs):
        rng = np.random.default_rng(seed)
        start = rotation_from_vector(rng.normal(size=3))
        axis = rng.normal(size=3)
        turn = rotation_from_vector(np.radians(5) * axis / np.linalg.norm(axis))
        place = PLACE_M + rng.normal(0, 0.02, 3)
        truth = pose_matrix(turn, place - turn @ PLACE_M)
        a = target_view(ellipsoid_cloud(start, PLACE_M, missing, rng))
        b = target_view(ellipsoid_cloud(turn @ start, place, missing, rng))
        found = register(a, b, None, truth)
        if not np.isfinite(found.covariance).all():
            continue
        off = vector_from_rotation(found.pose_b_from_a[:3, :3] @ turn.T)
        shift = (found.pose_b_from_a @ np.append(PLACE_M, 1))[:3] - place
        error = np.concatenate([off, shift])
        errors.append(np.linalg.norm(off))
        nees.append(error @ np.linalg.solve(found.covariance_at(place), error))
    assert len(nees) > 0.5 * pairs
    return np.array(errors), np.array(nees)


def test_holes_neither_spoil_a_curved_bodys_motion_nor_its_claim() -> None:
    whole, whole_nees = errors_and_nees(0.0, 24)
    holed, holed_nees = errors_and_nees(0.015, 24)
    assert np.median(holed) < 1.35 * np.median(whole)
    assert np.median(whole_nees) < 8
    assert np.median(holed_nees) < 8

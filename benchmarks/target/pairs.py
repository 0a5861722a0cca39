"""Simulated clouds of moving targets with their exact motion, and what errors of a motion are."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.sim.shapes import TARGETS
from horizon_sensor_ros.sim.tof_camera import ToFCamera, ToFDisturbances, ToFScan

# Squared error of six unknowns in sigmas, as rare as three sigma of one.
BEYOND_NEES = float(chi2.ppf(0.9973, 6))
MESHES = {name: build() for name, build in TARGETS.items()}


@dataclass(frozen=True, eq=False)
class Pair:
    """Two scans of a target and its motion between them, p_b = pose_b_from_a p_a."""

    a: ToFScan
    b: ToFScan
    pose_b_from_a: np.ndarray

    @property
    def centroid_a_m(self) -> np.ndarray:
        """(3,) of the first cloud."""
        return self.a.plain().astype(float).mean(axis=0)


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Result and CPU seconds, which a busy machine changes least."""
    start = time.process_time()
    result = function()
    return result, time.process_time() - start


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """(3, 3), uniform."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def unit(rng: np.random.Generator) -> np.ndarray:
    """(3,) random direction."""
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_pair(
    target: str,
    rng: np.random.Generator,
    camera: ToFCamera,
    disturbances: ToFDisturbances | None = None,
    turn_deg: tuple[float, float] = (0.5, 30.0),
    shift_m: float = 0.2,
) -> Pair:
    """A target in random attitude that turns about its origin and shifts."""
    before, after = random_poses(rng, turn_deg, shift_m)
    return scan_pair(target, before, after, rng, camera, disturbances)


def random_poses(
    rng: np.random.Generator, turn_deg: tuple[float, float] = (0.5, 30.0), shift_m: float = 0.2
) -> tuple[np.ndarray, np.ndarray]:
    """(4, 4) before and after, some 5.3 m away."""
    place = [rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), rng.uniform(5.0, 5.6)]
    before = pose_matrix(random_rotation(rng), place)
    turn = rotation_from_vector(unit(rng) * np.radians(rng.uniform(*turn_deg)))
    after = pose_matrix(turn @ before[:3, :3], before[:3, 3] + unit(rng) * rng.uniform(0, shift_m))
    return before, after


def scan_pair(
    target: str,
    before: np.ndarray,
    after: np.ndarray,
    rng: np.random.Generator,
    camera: ToFCamera,
    disturbances: ToFDisturbances | None = None,
) -> Pair:
    """Scans of the target in two poses."""
    a = camera.scan(MESHES[target], before, rng, disturbances)
    b = camera.scan(MESHES[target], after, rng, disturbances)
    return Pair(a, b, after @ inverse_pose(before))


def prior_near(
    pair: Pair, rng: np.random.Generator, deg: float = 2.0, m: float = 0.02
) -> np.ndarray:
    """(4, 4) the true motion made wrong by a turn about the centroid and a shift."""
    turn = rotation_from_vector(unit(rng) * np.radians(deg)) @ pair.pose_b_from_a[:3, :3]
    truth = pair.pose_b_from_a
    centre = truth[:3, :3] @ pair.centroid_a_m + truth[:3, 3] + unit(rng) * m
    return pose_matrix(turn, centre - turn @ pair.centroid_a_m)


def errors(found: np.ndarray, pair: Pair) -> tuple[float, float]:
    """Rotation error (deg), and distance (cm) of the moved centroid from where it truly went."""
    return errors_at(found, pair.pose_b_from_a, pair.centroid_a_m)


def errors_at(found: np.ndarray, truth: np.ndarray, place_m: np.ndarray) -> tuple[float, float]:
    """Rotation error (deg), and distance (cm) of a place (3,) from where it truly went."""
    turn = vector_from_rotation(truth[:3, :3] @ found[:3, :3].T)
    off = (found[:3, :3] - truth[:3, :3]) @ place_m + found[:3, 3] - truth[:3, 3]
    return float(np.degrees(np.linalg.norm(turn))), float(100 * np.linalg.norm(off))


def nees(
    found: np.ndarray, covariance: np.ndarray, centre_m: np.ndarray, truth: np.ndarray
) -> float:
    """Normalised squared error of a motion whose covariance is for shifts at ``centre_m`` (in b's
    frame).
    """
    at = inverse_pose(found) @ np.append(centre_m, 1)
    error = np.concatenate(
        [vector_from_rotation(truth[:3, :3] @ found[:3, :3].T), (truth @ at)[:3] - centre_m]
    )
    return float(error @ np.linalg.solve(covariance, error))


def tumbling(deg_per_s: float, count: int, hz: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Poses (4, 4) of a target that turns steadily about a random axis while it drifts by."""
    start, axis = random_rotation(rng), unit(rng)
    place = np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 5.3])
    drift = unit(rng) * 0.004
    times = np.arange(count) / hz
    turns = rotation_from_vector(np.outer(np.radians(deg_per_s) * times, axis))
    return [
        pose_matrix(turn @ start, place + drift * t) for turn, t in zip(turns, times, strict=True)
    ]

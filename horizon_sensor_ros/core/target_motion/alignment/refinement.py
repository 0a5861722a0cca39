"""Motion between two views to the sensor's noise: weighted point-to-plane over faces, depth edges
and thin parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import orthonormal
from horizon_sensor_ros.core.target_motion.alignment.matcher import Matcher
from horizon_sensor_ros.core.target_motion.alignment.pairs import Pairs

# Before the last gate a part of the planes does.
COARSE_STEP = 3
# Pairs serve until the target has moved by so many pixel widths.
_STRAY_PX = 0.1
# Step in units of its standard deviation, squared, below which it may be asked whether to go on.
_DRIFTING = 10.0
# So many steps at full length, and so many in all.
_FREE_ITERATIONS, _MOST_ITERATIONS = 8, 20


@dataclass(frozen=True, eq=False)
class Refined:
    """Result of the iteration.

    rotation (3, 3), translation_m (3,) : the motion, p_b = R p_a + t. pairs : its last ones, N of
        them. robust : (N,) their `robust_weights`. converged : it came to rest, or to where no
        further step would help.
    """

    rotation: np.ndarray
    translation_m: np.ndarray
    pairs: Pairs
    robust: np.ndarray
    converged: bool
    iterations: int


def robust_weights(pairs: Pairs) -> np.ndarray:
    """(N,) Cauchy weights of the residuals."""
    return 1 / (1 + _square_ratio(pairs))


def mean_loss(pairs: Pairs) -> float:
    """Cauchy's loss of the residuals, in the weighted mean; infinite without a pair."""
    total = pairs.weight.sum()
    return float(pairs.weight @ np.log1p(_square_ratio(pairs)) / total) if total > 0 else np.inf


def _square_ratio(pairs: Pairs) -> np.ndarray:
    ratio = pairs.residual / (1.5 * pairs.sigma_m)
    return ratio * ratio


def jacobian(point: np.ndarray, normal: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(6, N) change of the distance along ``normal`` with a small turn about ``centre`` and a
    shift.
    """
    (x, y, z), (a, b, c) = point - centre[:, None], normal
    return np.array([y * c - z * b, z * a - x * c, x * b - y * a, a, b, c])


def comparable(size_m: float) -> np.ndarray:
    """(6,) units in which turns and shifts compare: turns at the target's rms radius ``size_m``."""
    return np.array([1.0 / size_m] * 3 + [1.0] * 3)


def _stiffness(
    pairs: Pairs, weighted: np.ndarray, j: np.ndarray, w: np.ndarray, centre: np.ndarray
) -> np.ndarray:
    """(6, 6) matrix of the normal equations, with less of what the noise of the normals feigns.

    Where little is observed that feigned part makes the steps many times too short; the product of
    both views' Jacobians is free of it, but need not be positive.
    """
    j_a = jacobian(pairs.point_a, pairs.normal_a, centre)
    # Of mean normals j = (j_a + j_b) / 2, nearly.
    product = (j_a * w) @ (2 * j - j_a).T
    information = 0.3 * weighted @ j.T + 0.35 * (product + product.T)
    information -= pairs.without_thickness(j, w)
    information.flat[::7] += 1e-6 * information.trace() / 6 + 1e-9
    return information


def refine(
    matcher: Matcher,
    rotation: np.ndarray,
    translation_m: np.ndarray,
    gates_m: tuple[float, ...],
    hopeless: Callable[[np.ndarray, Pairs, np.ndarray], bool],
) -> Refined:
    """Gauss-Newton from a start within the gates; the last gate is used until nothing moves any
    more.

    rotation (3, 3), translation_m (3,) : the start, p_b = R p_a + t in the frames of the matcher's
        views. gates_m : distances along the normal, one a stage, up to which points make a pair.
    hopeless : whether some direction is known so badly that it is no use going on, by the matrix
        (6, 6) of the normal equations, pairs and their robust weights (N,). Asked when only little
        moves any more.
    """
    rotation, translation = np.array(rotation, float), np.array(translation_m, float)
    centre, size = matcher.b.image.centroid_m, matcher.b.size_m
    turn, shift = np.eye(3), np.zeros(3)
    converged = False
    last, stage, strayed = len(gates_m) - 1, -1, np.inf
    iteration = 0
    for iteration in range(1, _MOST_ITERATIONS + 1):
        if stage < last or strayed > _STRAY_PX * matcher.b.footprint_m:
            stage = min(stage + 1, last)
            each = COARSE_STEP if stage < last else 1
            pairs = matcher.pairs(rotation, translation, gates_m[stage], each)
            strayed = 0.0
        else:
            pairs = pairs.moved(turn, shift)
        robust = robust_weights(pairs)
        w = pairs.information(robust)
        j = jacobian(pairs.point_a, pairs.normal, centre)
        weighted = j * w
        gradient = weighted @ pairs.residual
        information = _stiffness(pairs, weighted, j, w, centre)
        step = -np.linalg.solve(information, gradient)
        # The step in units of its own standard deviation, squared.
        moved = -step @ gradient
        # Pairs that come and go with every step would swing for ever.
        if iteration > _FREE_ITERATIONS:
            step *= 0.5
        turn = np.asarray(cv2.Rodrigues(step[:3])[0], float)
        shift = centre - turn @ centre + step[3:]
        rotation, translation = turn @ rotation, turn @ translation + shift
        strayed += size * np.linalg.norm(step[:3]) + np.linalg.norm(step[3:])
        converged = stage == last and moved < 0.5
        if converged and (moved < 0.3 or iteration > _FREE_ITERATIONS + 2):
            break
        if stage == last and moved < _DRIFTING and hopeless(information, pairs, robust):
            converged = True
            break
    return Refined(orthonormal(rotation), translation, pairs, robust, converged, iteration)

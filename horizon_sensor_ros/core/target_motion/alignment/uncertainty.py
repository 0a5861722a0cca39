"""How well a motion between two views is known: covariance, and the directions that the views do
not show.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.columns import column_dots
from horizon_sensor_ros.core.mathematics.rigid import skew
from horizon_sensor_ros.core.target_motion.alignment.pairs import THIN, Pairs
from horizon_sensor_ros.core.target_motion.alignment.refinement import comparable, jacobian
from horizon_sensor_ros.core.target_motion.noise.common_noise import common_variance
from horizon_sensor_ros.core.target_motion.surfaces.edges.edges import Edges
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# Surfaces err alike over so many windows' widths: these overlap, and edges are made of pixels.
_BLOCK_WINDOWS = 2.4

# Both parts count the noise; this brings the sum to the errors seen on random bodies
# (`benchmarks/target/claims.py`), or a little above: real clouds are off by more than noise.
_MEASURED = 0.64
# Of clouds on no grid of the camera, whose returns were moved to the pixels' middles.
_MEASURED_OFF_GRID = 1.44

# The information itself is only known to what normals scatter by: below so many standard deviations
# of that there is none for sure.
_SURE = 3.0

# Normals lean alike in both views over about half of a window.
_LEAN_PX = 2.0


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Error of a motion p_b = R p_a + t.

    covariance : (6, 6) of (rotation vector, shift at ``centre_m``) in b's frame, rad and m: the
        true motion is the found one followed by that small motion about ``centre_m``.
    by_range : (6,) that small motion for each metre by which all ranges are too long.
    rms_residual_m : of the pairs used.
    """

    covariance: np.ndarray
    by_range: np.ndarray
    centre_m: np.ndarray
    rms_residual_m: float


def uncertainty(pairs: Pairs, robust: np.ndarray, a: SurfaceView, b: SurfaceView) -> Uncertainty:
    """Covariance of a refined motion from its pairs and their robust weights.

    The normals of both views carry independent noise, so the products of one view's Jacobian with
    the other's have the true information as their mean; the usual J^T J adds the noise of the
    normals, and lets a body of revolution look observable about its axis. The products scatter
    about that mean, and where no view shows anything that alone may pass for information: in each
    direction three times that is taken off, in squares. To the inverse of that comes a sandwich of
    the residuals, summed over blocks of surface within which they err alike; it carries what no
    noise model knows. And, squared, by how much the motion may have been drawn towards none, and
    what edges along the sensor's rows are off by, all of one alike: the motion takes that up, and
    leaves no residual.

    robust : (N,) `robust_weights` of the pairs.
    """
    centre = b.image.centroid_m
    weight = pairs.information(robust)
    j_a = jacobian(pairs.point_a, pairs.normal_a, centre)
    j_b = jacobian(pairs.point_a, pairs.normal_b, centre)
    product = (j_a * weight) @ j_b.T
    arm = pairs.point_a - centre[:, None]
    information = (product + product.T) / 2 - _feigned(arm, weight * pairs.tilt2)
    j = (j_a + j_b) / 2
    information -= pairs.without_thickness(j, weight)
    residual = pairs.residual
    rms = float(np.sqrt(np.mean(residual**2))) if len(residual) else np.nan
    place = _across_bars(pairs, b.edges)
    scale = comparable(b.size_m)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    apart = (scale[:, None] * vectors).T @ (j_a - j_b)
    scatter = weight * apart**2 / 2
    rows = np.concatenate([j * (weight * residual), scatter])
    sums, scatter = np.split(block_sums(rows, place, pairs.kind, block_m(a, b)), 2)
    # The mean fourth power of what is normal is three times its variance squared.
    doubtful = _SURE**2 * (scatter**2).sum(axis=1) / 3
    values = np.sqrt(np.maximum(values * np.abs(values) - doubtful, 0.0))
    # Nothing is less known than to the target's size.
    values = np.maximum(values, 1 / b.size_m**2)
    inverse = (vectors / values) @ vectors.T * np.outer(scale, scale)
    on_grid = a.image.on_grid and b.image.on_grid
    measured = _MEASURED if on_grid else _MEASURED_OFF_GRID
    covariance = measured * (inverse + inverse @ (sums @ sums.T) @ inverse)
    drawn = inverse @ _drawn_back(pairs, weight, a, b)
    covariance += np.outer(drawn, drawn)
    alike = inverse @ _of_runs(pairs, j * weight, a.edges, b.edges)
    covariance += alike @ alike.T
    for by_line, variance in _of_lines(pairs, j * weight, a, b):
        along = inverse @ by_line
        covariance += variance * (along @ along.T)
    by_range = inverse @ (j * weight) @ pairs.apart_by_range(slice(None))
    return Uncertainty((covariance + covariance.T) / 2, by_range, centre, rms)


def _across_bars(pairs: Pairs, edges: Edges) -> np.ndarray:
    """(3, N) places of the pairs, those on a narrow part of b's moved along it to one: what shows
    of it, and what of that falls into the pixels, is alike all along.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  heavy to import, and only used here

    place = pairs.point_b.copy()
    narrow = np.flatnonzero(edges.half_width_m > 0)
    of_bar = pairs.kind - THIN
    if len(narrow):
        reach = 1.5 * edges.half_width_m[narrow]
        distance, nearest = cKDTree(edges.points[narrow]).query(
            place.T, distance_upper_bound=reach.max()
        )
        near = np.flatnonzero(distance < reach.take(nearest, mode="clip"))
        lines = edges.directions[narrow[nearest[near]]]
        of_bar[near] = np.abs(lines @ pairs.bars.T).argmax(axis=1)
    for k, axis in enumerate(pairs.bars):
        bar = np.flatnonzero(of_bar == k)
        place[:, bar] -= np.outer(axis, axis @ place[:, bar])
    return place


def block_m(a: SurfaceView, b: SurfaceView) -> float:
    """Distance over which surfaces of two views err alike."""
    return _BLOCK_WINDOWS * max((2 * each.radius_px + 1) * each.footprint_m for each in (a, b))


def block_sums(
    score: np.ndarray, place: np.ndarray, kind: np.ndarray, block_m: float
) -> np.ndarray:
    """(6, K) sums of the gradients (6, N) of pairs of a kind at places (3, N) that lie so near each
    other that they err alike: within blocks ``block_m`` wide.
    """
    block = np.floor(place / block_m).astype(np.int64)
    key = ((block[0] * 4099 + block[1]) * 4099 + block[2]) * 32 + kind
    order = np.argsort(key)
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    return np.add.reduceat(score[:, order], first, axis=1) if len(first) else score


def _of_runs(pairs: Pairs, rows: np.ndarray, a: Edges, b: Edges) -> np.ndarray:
    """(6, K) gradients of what each run of places on an edge may be off by, all of it alike and as
    it leans, one sigma.
    """
    gradients = []
    for edges, which in zip((a, b), pairs.of_edges, strict=True):
        run = edges.run[which]
        for off_m in (edges.alike_m, edges.leaning_m):
            off = rows[:, pairs.across_edges] * off_m[which]
            gradients.append(np.array([np.bincount(run, each) for each in off]).reshape(6, -1))
    return np.concatenate(gradients, axis=1)


def _of_lines(
    pairs: Pairs, rows: np.ndarray, a: SurfaceView, b: SurfaceView
) -> list[tuple[np.ndarray, float]]:
    """(6, K) gradients of what is common to each row of both views, and then to each column, and
    its variance (m^2); those only that have any.

    It moves all that is seen in a line, on whatever surface, and does not average down over it.
    """
    found = []
    coarser_m = max(a.footprint_m, b.footprint_m)
    for axis, (of_a, of_b) in enumerate(zip(a.line_means, b.line_means, strict=True)):
        variance = common_variance(of_a, of_b, coarser_m)
        if variance:
            seen_a = pairs.point_a - pairs.translation_m[:, None]
            each = (
                _by_line(a, seen_a, pairs.rotation.T @ seen_a, pairs.normal, rows, 1 - axis),
                _by_line(b, pairs.point_b, pairs.point_b, pairs.normal, rows, 1 - axis),
            )
            found.append((np.concatenate(each, axis=1), variance))
    return found


def _by_line(
    view: SurfaceView,
    sight: np.ndarray,
    seen: np.ndarray,
    normal: np.ndarray,
    rows: np.ndarray,
    along: int,
) -> np.ndarray:
    """(6, K) gradients of ranges that are all longer in one row (``along`` 1) or column (0) of a
    view, by what it saw (3, N), in b's axes, ``sight``, and in its own.
    """
    cosine = column_dots(sight, normal) / np.sqrt(column_dots(sight, sight))
    image = view.image
    size = image.inverse_depth.shape[1 - along]
    tangent = seen[along] / seen[2] - image.origin[along]
    line = np.clip(np.rint(tangent * image.focal_px), 0, size - 1).astype(np.int64)
    sums = np.array([np.bincount(line, each, size) for each in rows * cosine])
    # A plane is the mean of its window.
    side = 2 * view.radius_px + 1
    return cv2.boxFilter(sums, -1, (side, 1), borderType=cv2.BORDER_CONSTANT)


def _drawn_back(pairs: Pairs, weight: np.ndarray, a: SurfaceView, b: SurfaceView) -> np.ndarray:
    """(6,) gradient by which the true motion may differ from none, where normals lean alike in both
    views.

    A surface that leans by how it is seen, and not by what it is, stays with the outline while the
    body turns under it: it fits best where nothing moved. What it weighs in that is the squared
    lean, times how far the body has slipped under it; of two places farther apart than a window is
    wide the leans differ.
    """
    rot_b_from_a_still = b.image.rot_sensor_from_view.T @ a.image.rot_sensor_from_view
    before = pairs.rotation.T @ (pairs.point_a - pairs.translation_m[:, None])
    arm = pairs.point_a - b.image.centroid_m[:, None]
    slip = arm - rot_b_from_a_still @ (before - a.image.centroid_m[:, None])
    reach = _LEAN_PX * b.footprint_m
    slip *= weight * pairs.tilt2 * reach / np.maximum(np.sqrt((slip * slip).sum(axis=0)), reach)
    return np.concatenate([np.cross(arm.T, slip.T).sum(axis=0), slip.sum(axis=1)])


def _feigned(arm: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(6, 6) sum of ``weight`` times the squared motion of each point (3, N), whatever its
    direction.
    """
    moved = weight * arm
    spread = moved @ arm.T
    total = np.zeros((6, 6))
    total[:3, :3] = np.eye(3) * spread.trace() - spread
    total[3:, 3:] = np.eye(3) * weight.sum()
    total[:3, 3:] = skew(moved.sum(axis=1))
    total[3:, :3] = -total[:3, 3:]
    return total


def worst_known(
    covariance: np.ndarray, max_rotation_sigma_rad: float, max_shift_sigma_m: float
) -> float:
    """Largest standard deviation of any direction, in units of both limits.

    covariance : (6, 6) of (rotation vector, shift), rad and m.
    """
    scale = np.repeat([max_rotation_sigma_rad, max_shift_sigma_m], 3)
    return float(np.sqrt(np.linalg.eigvalsh(covariance / np.outer(scale, scale))[-1]))


def weak_directions(
    covariance: np.ndarray, max_rotation_sigma_rad: float, max_shift_sigma_m: float
) -> np.ndarray:
    """(K, 6) unit directions, in units of both limits, whose standard deviation exceeds them;
    worst first.

    covariance : (6, 6) of (rotation vector, shift), rad and m.
    """
    scale = np.array([max_rotation_sigma_rad] * 3 + [max_shift_sigma_m] * 3)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return vectors.T[values > 1][::-1]

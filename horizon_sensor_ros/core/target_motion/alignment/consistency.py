"""Would each sensor view have seen what the other one saw, if the target moved like this?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

SAMPLES = 600  # points of each view that a score is usually of
_EDGE_TOLERANCE_PX = 1.6
# By how much scores are less with odd returns, which share their surface with no other point: times
# the mean share of them in both clouds.
SCORE_LOST = 0.6


@dataclass(frozen=True, eq=False)
class Consistency:
    """Shares over both directions, each (C,) for C candidate motions.

    score : confirmed / (confirmed + contradicted): 1 where nothing speaks against the motion. A
        point is contradicted where the other view looks through it (it sees farther, or nothing at
        all); one that would lie behind what the other view sees, or on a far side, says nothing.
    overlap : confirmed / all points.
    """

    score: np.ndarray
    overlap: np.ndarray


def odd_share(a: SurfaceView, b: SurfaceView) -> float:
    """Share of both clouds' points that share their surface with no other."""
    return 1 - (a.image.num_used / a.image.num_points + b.image.num_used / b.image.num_points) / 2


def project(view: SurfaceView, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Flat pixel index in ``view`` of points (any shape); beyond its border the pixel on the
    border.
    """
    image = view.image
    height, width = image.inverse_depth.shape
    scale = np.float32(image.focal_px) / np.maximum(z, np.float32(1e-3))
    left, top = (np.float32(image.focal_px * side - 0.5) for side in image.origin.tolist())
    # Truncation of what is shifted half a pixel is rounding, as nothing negative is left.
    column = np.minimum(np.maximum(x * scale - left, 0), width - 1).astype(np.intp)
    row = np.minimum(np.maximum(y * scale - top, 0), height - 1).astype(np.intp)
    return row * width + column


def view_consistency(
    a: SurfaceView,
    b: SurfaceView,
    rotations: np.ndarray,
    translations: np.ndarray,
    samples: int,
    slack_px: float = 0.5,
    *,
    spared: Callable[[SurfaceView, Against], np.ndarray] | None = None,
) -> Consistency:
    """Judge candidate motions p_b = R p_a + t; ``rotations`` (C, 3, 3), ``translations`` (C, 3).

    samples : points tried of each view.  slack_px : tolerance beyond noise, in pixel widths.
    spared : which points (C, N) are not contradicted by a view although it sees nothing there, of
        what it says of them.
    """
    back = rotations.transpose(0, 2, 1)
    there = _one_way(a, b, rotations, translations, samples, slack_px, spared)
    away = -np.einsum("cij,cj->ci", back, translations)
    here = _one_way(b, a, back, away, samples, slack_px, spared)
    confirmed, contradicted = there[0] + here[0], there[1] + here[1]
    decided = np.maximum(confirmed + contradicted, 1)
    return Consistency(confirmed / decided, confirmed / (there[2] + here[2]))


def in_gaps(view: SurfaceView, seen: Against) -> np.ndarray:
    """Which points (C, N) fall into gaps amid the target."""
    return np.asarray(view.gaps[seen.index])


def _one_way(
    a: SurfaceView,
    b: SurfaceView,
    rotations: np.ndarray,
    translations: np.ndarray,
    samples: int,
    slack_px: float,
    spared: Callable[[SurfaceView, Against], np.ndarray] | None,
) -> tuple[np.ndarray, np.ndarray, int]:
    points, normals = a.sample(samples)
    seen = against(a, b, points, normals, rotations, translations, slack_px)
    beside = seen.beside if spared is None else seen.beside & ~spared(b, seen)
    through = seen.before | beside
    return seen.confirmed.sum(axis=1), through.sum(axis=1), len(points)


@dataclass(frozen=True, eq=False)
class Against:
    """What view b says of N points of view a moved by each of C motions; (C, N) each.

    index : flat pixel of b.  off_m : distance from b's surface there, towards the sensor; where
        there is no plane, of half the depth, as there is room for a slope.
    confirmed : on b's surface, within noise.  before : b looks through the point, and sees farther.
    beside : b sees nothing there, nor in the pixels around.  depth_m : of the moved point in b.
    sight_m : along its normal, negative towards the sensor.  tolerance_m : by which depths are
        alike.
    """

    index: np.ndarray
    off_m: np.ndarray
    confirmed: np.ndarray
    before: np.ndarray
    beside: np.ndarray
    depth_m: np.ndarray
    sight_m: np.ndarray
    tolerance_m: float


def against(
    a: SurfaceView,
    b: SurfaceView,
    points: np.ndarray,
    normals: np.ndarray,
    rotations: np.ndarray,
    translations: np.ndarray,
    slack_px: float,
) -> Against:
    """Hold points (N, 3) of view a and their normals, 0 where there is none, against view b."""
    r, t = rotations.astype(np.float32), translations.astype(np.float32)
    moved = np.matmul(r, points.T) + t[:, :, None]
    x, y, z = moved[:, 0], moved[:, 1], moved[:, 2]
    index = project(b, x, y, z)
    seen = b.depth_map[index]
    sight = np.einsum("cis,cis->cs", np.matmul(r, normals.T), moved)
    facing = sight <= 0
    tolerance = np.float32(4 * np.hypot(a.sigma_m, b.sigma_m) + slack_px * b.footprint_m)
    q, n = b.point_map[index], b.normal_map[index]
    off = (x - q[..., 0]) * n[..., 0] + (y - q[..., 1]) * n[..., 1] + (z - q[..., 2]) * n[..., 2]
    rough = ~b.plane[index]
    off = np.where(rough, (seen - z) * np.float32(0.5), off)
    returned = seen > 0
    confirmed = returned & (np.abs(off) < tolerance) & facing
    before = returned & (off >= tolerance) & (z < seen - tolerance) & facing
    beside = (b.gap_px[index] > _EDGE_TOLERANCE_PX) & facing
    return Against(index, off, confirmed, before, beside, z, sight, float(tolerance))

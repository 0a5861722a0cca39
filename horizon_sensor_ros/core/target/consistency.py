"""Would each sensor view have seen what the other one saw, if the target moved like this?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.target.surfels import SurfaceView

_EDGE_TOLERANCE_PX = 1.6


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


def project(view: SurfaceView, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Flat pixel index in ``view`` of points (any shape); beyond its border the pixel on the
    border."""
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
    samples: int = 300,
    slack_px: float = 0.5,
) -> Consistency:
    """Judge candidate motions p_b = R p_a + t; ``rotations`` (C, 3, 3), ``translations`` (C, 3).

    samples : points tried of each view.  slack_px : tolerance beyond noise, in pixel widths.
    """
    back = rotations.transpose(0, 2, 1)
    there = _one_way(a, b, rotations, translations, samples, slack_px)
    here = _one_way(b, a, back, -np.einsum("cij,cj->ci", back, translations), samples, slack_px)
    confirmed, contradicted = there[0] + here[0], there[1] + here[1]
    decided = np.maximum(confirmed + contradicted, 1)
    return Consistency(confirmed / decided, confirmed / (there[2] + here[2]))


def _one_way(
    a: SurfaceView,
    b: SurfaceView,
    rotations: np.ndarray,
    translations: np.ndarray,
    samples: int,
    slack_px: float,
) -> tuple[np.ndarray, np.ndarray, int]:
    points, normals = a.sample(samples)
    r, t = rotations.astype(np.float32), translations.astype(np.float32)
    moved = np.matmul(r, points.T) + t[:, :, None]
    x, y, z = moved[:, 0], moved[:, 1], moved[:, 2]
    index = project(b, x, y, z)
    seen = b.depth_map[index]
    facing = np.einsum("cis,cis->cs", np.matmul(r, normals.T), moved) <= 0
    tolerance = np.float32(4 * np.hypot(a.sigma_m, b.sigma_m) + slack_px * b.footprint_m)
    q, n = b.point_map[index], b.normal_map[index]
    off = (x - q[..., 0]) * n[..., 0] + (y - q[..., 1]) * n[..., 1] + (z - q[..., 2]) * n[..., 2]
    rough = ~b.plane[index]
    # Where there is no plane, depth itself, with room for a slope.
    off = np.where(rough, (seen - z) * np.float32(0.5), off)
    returned = seen > 0
    confirmed = returned & (np.abs(off) < tolerance) & facing
    before = returned & (off >= tolerance) & (z < seen - tolerance)
    through = before | (b.gap_px[index] > _EDGE_TOLERANCE_PX)
    return confirmed.sum(axis=1), (through & facing).sum(axis=1), len(points)

"""Coarse motion between two views: many starts aligned at once, the most consistent ones kept."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.core.target_motion.alignment.consistency import project
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

_UPPER = [(i, j) for i in range(6) for j in range(i, 6)]


def align_batch(
    a: SurfaceView,
    b: SurfaceView,
    rotations: np.ndarray,
    translations: np.ndarray,
    gates_m: np.ndarray,
    samples: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Move C starts p_b = R p_a + t towards their nearest optima; one Gauss-Newton step for each
    gate.

    rotations (C, 3, 3), translations (C, 3).  A sample of each view is matched to the planes that
    the other one sees in the same direction, or to the nearest point of its silhouette where it
    sees nothing there.
    """
    points_a, normals_a = (part.T.copy() for part in a.sample(samples // 2))
    points_b, normals_b = (part.T.copy() for part in b.sample(samples // 2))
    # Turns are about the target's centre, so that single precision and small angles do.
    centre = a.image.centroid_m
    rotation = np.asarray(rotations, float)
    shift = np.einsum("cij,j->ci", rotation, centre) + translations
    for gate in gates_m:
        r = rotation.astype(np.float32)
        at = shift.astype(np.float32)[:, :, None]
        arm = np.matmul(r, points_a - centre.astype(np.float32)[:, None])
        there = _pull(arm + at, np.matmul(r, normals_a), b, gate, ~normals_a.any(axis=0))
        back = r.transpose(0, 2, 1)
        away = points_b - at
        here = _pull(
            np.matmul(back, away) + centre.astype(np.float32)[:, None],
            np.matmul(back, normals_b), a, gate, ~normals_b.any(axis=0),
        )  # fmt: skip
        step = _solve(
            np.concatenate([arm, away], axis=2),
            np.concatenate([there[0], np.matmul(-r, here[0])], axis=2),
            np.concatenate([there[1], here[1]], axis=1),
            np.concatenate([there[2], here[2]], axis=1),
        )
        turn = rotation_from_vector(step[:, :3])
        rotation = turn @ rotation
        shift = shift + step[:, 3:]
    return rotation, shift - np.einsum("cij,j->ci", rotation, centre)


def _pull(
    p: np.ndarray, n: np.ndarray, view: SurfaceView, gate: float, bare: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of moved points and normals (C, 3, S): direction of the pull (C, 3, S), distance along it
    and weight (C, S).
    """
    index = project(view, p[:, 0], p[:, 1], p[:, 2])
    nearest = view.nearest[index]
    on_plane = nearest == index
    gap = p - view.point_map[nearest].transpose(0, 2, 1)
    other = view.normal_map[nearest].transpose(0, 2, 1)
    agree = np.where(bare, np.float32(0.5), np.einsum("cis,cis->cs", n, other))
    direction = np.where(on_plane[:, None], n + other, gap)
    length = np.sqrt(np.einsum("cis,cis->cs", direction, direction))
    direction /= (length + np.float32(1e-6))[:, None]
    e = np.einsum("cis,cis->cs", gap, direction)
    ratio = e / np.float32(gate)
    weight = np.where(on_plane, np.clip(agree, 0, 1), np.float32(0.3)) / (1 + ratio * ratio) ** 2
    weight *= np.einsum("cis,cis->cs", n, p) <= 0
    return direction, e, weight


def _solve(arm: np.ndarray, n: np.ndarray, e: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(C, 6) Gauss-Newton steps: turn about the target's centre, then shift."""
    count = len(arm)
    rows = [
        arm[:, 1] * n[:, 2] - arm[:, 2] * n[:, 1],
        arm[:, 2] * n[:, 0] - arm[:, 0] * n[:, 2],
        arm[:, 0] * n[:, 1] - arm[:, 1] * n[:, 0],
        n[:, 0], n[:, 1], n[:, 2],
    ]  # fmt: skip
    weighted = [row * weight for row in rows]
    information = np.empty((count, 6, 6))
    for i, j in _UPPER:
        information[:, i, j] = information[:, j, i] = np.einsum("cs,cs->c", weighted[i], rows[j])
    gradient = np.stack([np.einsum("cs,cs->c", row, e) for row in weighted], axis=1)
    # A little damping: of turns by the target's size, of shifts by the number of points.
    damping = 0.003 * information[:, range(6), range(6)].reshape(count, 2, 3).mean(axis=2) + 1e-6
    information[:, range(6), range(6)] += np.repeat(damping, 3, axis=1)
    step = -np.linalg.solve(information, gradient[..., None])[..., 0]
    length = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
    step[:, :3] *= np.minimum(1, 0.35 / np.maximum(length, 1e-9))
    return step


def rotation_starts(largest_rad: float, spacing_rad: float) -> np.ndarray:
    """(C, 3, 3) rotations that fill a ball of ``largest_rad`` about no rotation; no rotation
    first.
    """
    reach = int(np.ceil(largest_rad / spacing_rad)) + 1
    grid = np.arange(-reach, reach + 1) * spacing_rad
    cells = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    # Body-centred cubic: every second layer of the cubic grid shifted to its middle.
    cells = np.concatenate([cells, cells + spacing_rad / 2])
    length = np.linalg.norm(cells, axis=1)
    cells = cells[np.argsort(length, kind="stable")]
    cells = cells[np.linalg.norm(cells, axis=1) <= largest_rad]
    return rotation_from_vector(cells)

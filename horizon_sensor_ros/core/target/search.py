"""Coarse motion between two views: many starts aligned at once, the most consistent ones kept."""

from __future__ import annotations

import numpy as np

from .consistency import project
from .rigid import rotation_from_vector
from .surfels import SurfaceView

_UPPER = [(i, j) for i in range(6) for j in range(i, 6)]


def align_batch(
    a: SurfaceView,
    b: SurfaceView,
    rotations: np.ndarray,
    translations: np.ndarray,
    gates_m: tuple[float, ...],
    samples: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Move C starts p_b = R p_a + t towards their nearest optima; one Gauss-Newton step for each gate.

    rotations (C, 3, 3), translations (C, 3).  A sample of a's planes is matched to what b sees in the same direction:
    point to plane, or to the nearest silhouette's point where b sees nothing there.
    """
    points, normals = (part.T.copy() for part in a.sample(samples))
    bare = ~normals.any(axis=0)
    # About the target, so that single precision and small angles do.
    centre = a.image.centroid_m.astype(np.float32)
    points -= centre[:, None]
    rotation = np.asarray(rotations, float)
    shift = np.einsum("cij,j->ci", rotation, centre) + translations
    count = len(rotation)
    for gate in gates_m:
        r = rotation.astype(np.float32).reshape(-1, 3)
        arm = (r @ points).reshape(count, 3, -1)
        n = (r @ normals).reshape(count, 3, -1)
        p = arm + shift.astype(np.float32)[:, :, None]
        x, y, z = p[:, 0], p[:, 1], p[:, 2]
        index = project(b, x, y, z)
        nearest = b.nearest[index]
        on_plane = nearest == index
        to = b.point_map[nearest].transpose(0, 2, 1)
        nb = b.normal_map[nearest].transpose(0, 2, 1)
        gap = p - to
        agree = np.where(bare, np.float32(0.5), np.einsum("cis,cis->cs", n, nb))
        direction = np.where(on_plane[:, None], n + nb, gap)
        direction /= np.sqrt(np.einsum("cis,cis->cs", direction, direction))[:, None] + np.float32(1e-6)
        e = np.einsum("cis,cis->cs", gap, direction)
        ratio = e / np.float32(gate)
        weight = np.where(on_plane, np.clip(agree, 0, 1), np.float32(0.3)) / (1 + ratio * ratio) ** 2
        weight *= np.einsum("cis,cis->cs", n, p) <= 0
        step = _solve(arm, direction, e, weight)
        turn = rotation_from_vector(step[:, :3])
        rotation = turn @ rotation
        shift = shift + step[:, 3:]
    return rotation, shift - np.einsum("cij,j->ci", rotation, centre)


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
    """(C, 3, 3) rotations that fill a ball of ``largest_rad`` about no rotation; no rotation first."""
    reach = int(np.ceil(largest_rad / spacing_rad)) + 1
    grid = np.arange(-reach, reach + 1) * spacing_rad
    cells = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    # Body-centred cubic: every second layer of the cubic grid shifted to its middle.
    cells = np.concatenate([cells, cells + spacing_rad / 2])
    length = np.linalg.norm(cells, axis=1)
    cells = cells[np.argsort(length, kind="stable")]
    cells = cells[np.linalg.norm(cells, axis=1) <= largest_rad]
    return rotation_from_vector(cells)

"""Section patterns of a cloud and their likeness (paper D), one motion at a time as printed, and
many at once.

A candidate motion is (theta, phi, psi, x, y, z): pitch about y, roll about x, yaw about z (rad)
and the shift (m) of the section planes, in the inertia frame n of the previous cloud.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix
from horizon_sensor_ros.core.target_motion.section_patterns.inertia_frame import (
    InertiaFrame,
    inertia_frame,
)

# The two coordinates in plane j, whose normal is axis j.
_IN_PLANE = ((1, 2), (0, 2), (0, 1))
_WIDER = 0.2


@dataclass(frozen=True, eq=False)
class SectionPattern:
    """One plane's grid: ``count`` (m, n) k of the points in each cell, ``radius`` (m, n) r of its
    centre from the frame's origin."""

    count: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True)
class SectionGrid:
    """Cells of pitch d over one plane: ``low_m`` the corner of the first cell, ``shape`` their
    number."""

    low_m: tuple[float, float]
    shape: tuple[int, int]
    pitch_m: float

    def cells(self, flat: np.ndarray) -> np.ndarray:
        """(K, 2) cell numbers of (K, 2) points in the plane; outside the grid they are out of
        range."""
        return np.floor((flat - np.array(self.low_m)) / self.pitch_m).astype(np.int64)

    def radius(self) -> np.ndarray:
        """(m, n) distance of the cells' centres from the frame's origin."""
        eta, zeta = (
            low + (np.arange(n) + 0.5) * self.pitch_m
            for low, n in zip(self.low_m, self.shape, strict=True)
        )
        return np.hypot(eta[:, None], zeta)


@dataclass(frozen=True, eq=False)
class Sections:
    """The previous cloud cut by the three planes of its inertia frame."""

    frame: InertiaFrame
    pitch_m: float
    grids: tuple[SectionGrid, ...]
    patterns: tuple[SectionPattern, ...]


def section_points(coordinates: np.ndarray, plane: int, pitch_m: float) -> np.ndarray:
    """(K, 2) projections of the points (N, 3) that lie within ``pitch_m`` of plane 0, 1 or 2 of
    their frame."""
    near = np.abs(coordinates[:, plane]) <= pitch_m
    return coordinates[near][:, _IN_PLANE[plane]]


def section_grid(flat: np.ndarray, pitch_m: float) -> SectionGrid:
    """The grid over a section's points, widened by a fifth on each side."""
    if not len(flat):
        return SectionGrid((0.0, 0.0), (1, 1), pitch_m)
    low, span = flat.min(axis=0), np.ptp(flat, axis=0)
    number = np.round(span / pitch_m).astype(int) + 1
    extra = np.ceil(_WIDER * number).astype(int)
    shape = number + 2 * extra
    corner = low - (extra + 0.5) * pitch_m
    return SectionGrid((corner[0], corner[1]), (int(shape[0]), int(shape[1])), pitch_m)


def section_pattern(flat: np.ndarray, grid: SectionGrid) -> SectionPattern:
    """Count a section's points in the grid's cells; points outside are left out."""
    cell = grid.cells(flat)
    inside = ((cell >= 0) & (cell < grid.shape)).all(axis=1)
    count = np.zeros(grid.shape)
    np.add.at(count, tuple(cell[inside].T), 1)
    return SectionPattern(count, grid.radius())


def cut(points: np.ndarray, pitch_m: float) -> Sections:
    """Section patterns of the previous cloud (N, 3) by the planes of its own inertia frame.

    Raises ValueError for a pitch that is not positive, and what ``inertia_frame`` raises.
    """
    if not pitch_m > 0:
        raise ValueError(f"pitch_m must be positive; got {pitch_m}")
    frame = inertia_frame(points)
    coordinates = frame.coordinates(points)
    flats = [section_points(coordinates, plane, pitch_m) for plane in range(3)]
    grids = tuple(section_grid(flat, pitch_m) for flat in flats)
    patterns = tuple(section_pattern(flat, grid) for flat, grid in zip(flats, grids, strict=True))
    return Sections(frame, pitch_m, grids, patterns)


def one_way_likeness(pattern: SectionPattern, other: SectionPattern) -> float:
    """sum s / sum k r over the filled cells of ``pattern``, with s = max over Q of exp(-dist) k r
    (equation 1).

    Q are the filled cells of ``other`` at most one cell away; the distance is in cells.
    """
    filled = pattern.count > 0
    weight = (pattern.count * pattern.radius)[filled]
    around = np.pad(other.count > 0, 1)
    height, width = filled.shape
    best = np.zeros(len(weight))
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            there = around[1 + i : 1 + i + height, 1 + j : 1 + j + width][filled]
            best = np.maximum(best, np.where(there, np.exp(-np.hypot(i, j)), 0.0))
    return float((best * weight).sum() / weight.sum()) if weight.sum() > 0 else 0.0


def likeness(pattern: SectionPattern, other: SectionPattern) -> float:
    """Mean of both directions, in [0, 1]."""
    return (one_way_likeness(pattern, other) + one_way_likeness(other, pattern)) / 2


def rotation_n_from_v(theta: float, phi: float, psi: float) -> np.ndarray:
    """G_n_v = Ry(theta) Rx(phi) Rz(psi), (3, 3)."""
    return _rotations(np.array([[theta, phi, psi]]))[0]


def patterns_of(
    sections: Sections, points: np.ndarray, candidate: np.ndarray
) -> tuple[SectionPattern, ...]:
    """Patterns of the current cloud (N, 3) cut by the planes moved by ``candidate``."""
    turn = rotation_n_from_v(*candidate[:3])
    coordinates = (sections.frame.coordinates(points) - candidate[3:]) @ turn
    return tuple(
        section_pattern(section_points(coordinates, plane, sections.pitch_m), grid)
        for plane, grid in enumerate(sections.grids)
    )


def objective(sections: Sections, points: np.ndarray, candidate: np.ndarray) -> float:
    """Likeness (equation 2) of the previous cloud's sections and the current cloud's (N, 3) by the
    moved planes."""
    now = patterns_of(sections, points, candidate)
    return float(np.mean([likeness(*pair) for pair in zip(sections.patterns, now, strict=True)]))


def motion(sections: Sections, candidate: np.ndarray) -> np.ndarray:
    """(4, 4) rigid motion in the sensor frame, p_current = pose p_previous, of a candidate."""
    u, origin = sections.frame.rot_sensor_from_frame, sections.frame.origin_m
    turn = u @ rotation_n_from_v(*candidate[:3]) @ u.T
    return pose_matrix(turn, origin + u @ np.asarray(candidate[3:]) - turn @ origin)


def candidate_of(sections: Sections, pose: np.ndarray) -> np.ndarray:
    """(6,) the candidate of a rigid motion (4, 4) in the sensor frame: the inverse of
    ``motion``."""
    u, origin = sections.frame.rot_sensor_from_frame, sections.frame.origin_m
    g = u.T @ pose[:3, :3] @ u
    shift = u.T @ (pose[:3, :3] @ origin + pose[:3, 3] - origin)
    angles = [
        np.arctan2(g[0, 2], g[2, 2]),
        np.arcsin(np.clip(-g[1, 2], -1, 1)),
        np.arctan2(g[1, 0], g[1, 1]),
    ]
    return np.concatenate([angles, shift])


def _rotations(angles: np.ndarray) -> np.ndarray:
    """(C, 3, 3) Ry(theta) Rx(phi) Rz(psi) of (C, 3) angles."""
    (st, sf, sp), (ct, cf, cp) = np.sin(angles.T), np.cos(angles.T)
    return np.stack(
        [ct * cp + st * sf * sp, -ct * sp + st * sf * cp, st * cf,
         cf * sp, cf * cp, -sf,
         -st * cp + ct * sf * sp, st * sp + ct * sf * cp, ct * cf], axis=1,
    ).reshape(-1, 3, 3)  # fmt: skip


class BatchObjective:
    """The objective for many candidates at once, to rounding the same as ``objective`` of each.

    All three grids lie in one row of cells with a border of empty ones. A sum over the current
    cloud's cells of k r exp(-dist) is a sum over its points, so it takes one look-up a point in a
    map made once; only the other direction needs the current cells, and of them no more than
    whether they are filled.
    """

    def __init__(self, sections: Sections, points: np.ndarray) -> None:
        self._points = sections.frame.coordinates(np.asarray(points, float)).T.copy()
        self._lengths = np.linalg.norm(self._points, axis=0)
        self._pitch = sections.pitch_m
        # The border is two cells wide: what lies outside is clipped into its outer ring, which has
        # no radius and which no filled cell has for a neighbour.
        self._lows = np.array([grid.low_m for grid in sections.grids]) - 2 * self._pitch
        self._shapes = np.array([grid.shape for grid in sections.grids]) + 4
        sizes = self._shapes.prod(axis=1)
        self._starts = np.concatenate([[0], np.cumsum(sizes)])
        self._radius = np.zeros(self._starts[-1])
        self._reach = np.zeros(self._starts[-1])
        cells, weights, neighbours = [], [], []
        for plane, pattern in enumerate(sections.patterns):
            part = slice(self._starts[plane], self._starts[plane + 1])
            self._radius[part] = np.pad(pattern.radius, 2).ravel()
            filled = np.pad(pattern.count > 0, 2)
            best = np.zeros(filled.shape)
            for i in (-1, 0, 1):
                for j in (-1, 0, 1):
                    best = np.maximum(
                        best, np.roll(filled, (i, j), (0, 1)) * np.exp(-np.hypot(i, j))
                    )
            self._reach[part] = best.ravel()
            weight = np.pad(pattern.count * pattern.radius, 2).ravel()
            index = np.flatnonzero(filled)
            total = weight[index].sum()
            cells.append(index + self._starts[plane])
            weights.append(weight[index] / total if total > 0 else weight[index])
            width = self._shapes[plane, 1]
            neighbours.append(
                [[i * width + j] * len(index) for i in (-1, 0, 1) for j in (-1, 0, 1)]
            )
        self._reach *= self._radius
        # Nearest first, and three distances only: in place, beside, across the corner.
        around = np.concatenate(neighbours, axis=1)[[4, 1, 3, 5, 7, 0, 2, 6, 8]]
        # A section may be empty.
        self._around = np.concatenate(cells) + around.astype(np.intp)
        self._weights = np.concatenate(weights)

    def __call__(self, candidates: np.ndarray) -> np.ndarray:
        """(C,) values of (C, 6) candidates."""
        candidates = np.atleast_2d(np.asarray(candidates, float))
        # In portions that stay in the processor's cache.
        parts = np.array_split(candidates, max(1, len(candidates) // 24))
        return np.concatenate([self._values(part) for part in parts])

    def _values(self, candidates: np.ndarray) -> np.ndarray:
        count = len(candidates)
        back = _rotations(candidates[:, :3]).transpose(0, 2, 1)
        shift = np.einsum("cij,cj->ci", back, candidates[:, 3:])
        filled = np.zeros(count * self._starts[-1], bool)
        value = np.zeros(count)
        middle, middle_shift = back.mean(axis=0), shift.mean(axis=0)
        turned = np.linalg.norm(back - middle, axis=2).max(axis=0)
        shifted = np.abs(shift - middle_shift).max(axis=0)
        for plane in range(3):
            # Only points that some candidate brings near the plane.
            away = np.abs(middle[plane] @ self._points - middle_shift[plane])
            near = away <= self._pitch + shifted[plane] + turned[plane] * self._lengths
            eta, zeta = _IN_PLANE[plane]
            rows, columns = self._shapes[plane]
            moved = back[:, [plane, eta, zeta]].transpose(1, 0, 2) @ self._points[:, near]
            off = moved[0] - shift[:, plane, None]
            chosen = np.flatnonzero(np.abs(off, out=off) <= self._pitch)
            candidate = chosen // off.shape[1]
            place = []
            for along, axis, low, number in (
                (moved[1], eta, self._lows[plane, 0], rows),
                (moved[2], zeta, self._lows[plane, 1], columns),
            ):
                cells = along.ravel()[chosen] - (shift[:, axis] + low)[candidate]
                # What is cut off towards zero lies in the border either way.
                place.append(np.clip(cells / self._pitch, 0, number - 1).astype(np.int32))
            cell = place[0] * columns + place[1] + self._starts[plane]
            radius = self._radius[cell]
            total = np.bincount(candidate, radius, count)
            reached = np.bincount(candidate, self._reach[cell], count)
            value += np.divide(reached, total, out=np.zeros(count), where=total > 0)
            filled[cell * count + candidate] = True
        filled = filled.reshape(-1, count)
        here = filled[self._around[0]]
        beside = filled[self._around[1]]
        for cells in self._around[2:5]:
            beside |= filled[cells]
        corner = filled[self._around[5]]
        for cells in self._around[6:]:
            corner |= filled[cells]
        near = np.where(
            here, 1.0, np.where(beside, np.exp(-1), np.where(corner, np.exp(-np.sqrt(2)), 0.0))
        )
        return (value + self._weights @ near) / 6

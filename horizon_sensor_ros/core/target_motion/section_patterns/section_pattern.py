"""Section patterns of a cloud and their likeness (paper D)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.target_motion.section_patterns.inertia_frame import (
    InertiaFrame,
    inertia_frame,
)

# The two coordinates in plane j, whose normal is axis j.
IN_PLANE = ((1, 2), (0, 2), (0, 1))
_WIDER = 0.2


@dataclass(frozen=True, eq=False)
class SectionPattern:
    """One plane's grid: ``count`` (m, n) k of the points in each cell, ``radius`` (m, n) r of its
    centre from the frame's origin.
    """

    count: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True)
class SectionGrid:
    """Cells of pitch d over one plane: ``low_m`` the corner of the first cell, ``shape`` their
    number.
    """

    low_m: tuple[float, float]
    shape: tuple[int, int]
    pitch_m: float

    def cells(self, flat: np.ndarray) -> np.ndarray:
        """(K, 2) cell numbers of (K, 2) points in the plane; outside the grid they are out of
        range.
        """
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
    their frame.
    """
    near = np.abs(coordinates[:, plane]) <= pitch_m
    return coordinates[near][:, IN_PLANE[plane]]


def section_grid(flat: np.ndarray, pitch_m: float) -> SectionGrid:
    """The grid over a section's points (K, 2), m, widened by a fifth on each side; of no points one
    cell.
    """
    if not len(flat):
        return SectionGrid((0.0, 0.0), (1, 1), pitch_m)
    low, span = flat.min(axis=0), np.ptp(flat, axis=0)
    number = np.round(span / pitch_m).astype(int) + 1
    extra = np.ceil(_WIDER * number).astype(int)
    shape = number + 2 * extra
    corner = low - (extra + 0.5) * pitch_m
    return SectionGrid((corner[0], corner[1]), (int(shape[0]), int(shape[1])), pitch_m)


def section_pattern(flat: np.ndarray, grid: SectionGrid) -> SectionPattern:
    """Count a section's points (K, 2), m, in the grid's cells; points outside are left out."""
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
        raise ValueError(f"pitch_m must be positive, got {pitch_m}")
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

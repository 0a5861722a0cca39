"""What paper D maximises, of one candidate motion as printed, and of many at once."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.section_patterns.candidate import (
    rotation_n_from_v,
    rotations_n_from_v,
)
from horizon_sensor_ros.core.target_motion.section_patterns.section_pattern import (
    IN_PLANE,
    SectionPattern,
    Sections,
    likeness,
    section_pattern,
    section_points,
)


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
    moved planes.
    """
    now = patterns_of(sections, points, candidate)
    return float(np.mean([likeness(*pair) for pair in zip(sections.patterns, now, strict=True)]))


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
        back = rotations_n_from_v(candidates[:, :3]).transpose(0, 2, 1)
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
            eta, zeta = IN_PLANE[plane]
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

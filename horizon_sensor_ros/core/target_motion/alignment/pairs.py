"""Pairs of what two views show: how far apart they lie, beyond what their kind has in common."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.mathematics.columns import column_dots

# Kinds of pairs; the last one and those above it are of bars, each of another direction.
FACE, EDGE, FAR_SIDE, EDGE_ON, THIN = range(5)
# What a plate seen from its far side, and one seen edge on, lies behind its face by, and how
# uncertain that is, in thicknesses.
_BEHIND_FACE = {FAR_SIDE: (1.0, 1.0), EDGE_ON: (0.5, 0.7)}
# The outline of a narrow part lies behind what faces the sensor of it: by nothing if it is a slat,
# by up to half of its width if it is a bar. Anything between is as likely, in halves of the width.
_OUTLINE, _OUTLINE_STD = 0.5, 12**-0.5


@dataclass(frozen=True, eq=False)
class Pairs:
    """N correspondences: a's points moved into b's frame and b's points, with both normals, (3, N)
    each.

    sigma_m : (N,) of the distance along the normal, for one raw measurement in each view.
    weight : (N,) raw measurements that the pair stands for.  tilt2 : (N,) covariance (rad^2) of
        both normals' errors.
    kind : (N,) FACE, EDGE, FAR_SIDE: a plate that one view sees from the one side and the other
        view from the other; it is as thick as the others, and nobody knows how thick. EDGE_ON: a
        plate's face, and its rim or either face in the other view. THIN + k: a bar of direction k.
    plate_m : thickness to be expected of a plate before it is measured.  bars : (K, 3) directions.
    sides_m : (K,) standard deviation of what bars of direction k lie off by, as they show other
        sides.
    rotation, translation_m : the motion that moved a's points.
    across_edges : which pairs, M of them, lie apart across edges.  of_edges : (M,) numbers of these
        edges of a, and the same of b.  half_width_m : (M,) of the narrow face that they end; 0
        where it is none.  of_bar : (M,) number of its direction.
    """

    point_a: np.ndarray
    point_b: np.ndarray
    normal_a: np.ndarray
    normal_b: np.ndarray
    sigma_m: np.ndarray
    weight: np.ndarray
    tilt2: np.ndarray
    kind: np.ndarray
    plate_m: float
    bars: np.ndarray
    sides_m: np.ndarray
    rotation: np.ndarray
    translation_m: np.ndarray
    across_edges: slice
    of_edges: tuple[np.ndarray, np.ndarray]
    half_width_m: np.ndarray
    of_bar: np.ndarray

    @cached_property
    def _behind(self) -> list[tuple[np.ndarray, float, float]]:
        """Plates, and bars of each direction: their pairs, by how much they are to be expected to
        lie behind each other, and its standard deviation.
        """
        expected = {
            kind: (mean * self.plate_m, deviation * self.plate_m)
            for kind, (mean, deviation) in _BEHIND_FACE.items()
        }
        expected |= {THIN + k: (0.0, float(each)) for k, each in enumerate(self.sides_m)}
        rows = ((np.flatnonzero(self.kind == kind), of_kind) for kind, of_kind in expected.items())
        return [(some, *of_kind) for some, of_kind in rows if len(some)]

    @cached_property
    def residual(self) -> np.ndarray:
        """(N,) distances along the mean normal, metres; of plates beyond what all of a kind have in
        common.
        """
        distance = column_dots(self.point_a - self.point_b, self.normal)
        for rows, mean, deviation in self._behind:
            known = (self.weight[rows] / self.sigma_m[rows] ** 2).sum()
            prior = deviation**-2
            distance[rows] -= (np.median(distance[rows]) * known - mean * prior) / (known + prior)
        for rows, arm in self._outlines:
            expected = distance[rows] - arm * _OUTLINE
            square = (expected / (1.5 * self.sigma_m[rows])) ** 2
            known = arm * self.weight[rows] / (self.sigma_m[rows] ** 2 * (1 + square))
            distance[rows] = expected - arm * (known @ expected) / (known @ arm + _OUTLINE_STD**-2)
        return distance

    def apart_by_range(self, which: slice | np.ndarray) -> np.ndarray:
        """(M,) how much farther ``which`` pairs lie apart along their normals for each metre by
        which all ranges are too long: a's points were seen along other rays, and turned since.
        """
        seen_a = self.point_a[:, which] - self.translation_m[:, None]
        seen_b = self.point_b[:, which]
        rays_a, rays_b = (seen / np.sqrt(column_dots(seen, seen)) for seen in (seen_a, seen_b))
        return column_dots(rays_a - rays_b, self.normal[:, which])

    @cached_property
    def _outlines(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Ends of narrow faces of each direction, which lie alike behind them, and how much farther
        apart each pair is where they do by half of the width: as by ranges that are too short.
        """
        narrow = np.flatnonzero(self.half_width_m)
        if not len(narrow):
            return []
        pairs, of_bar = (self.across_edges.start or 0) + narrow, self.of_bar[narrow]
        arm = -self.apart_by_range(pairs) * self.half_width_m[narrow]
        groups = (np.flatnonzero(of_bar == k) for k in range(len(self.bars)))
        return [(pairs[some], arm[some]) for some in groups if len(some)]

    def information(self, robust: np.ndarray) -> np.ndarray:
        """(N,) 1/m^2 on the distance along each normal, by the pairs' robust weights (N,)."""
        return robust * self.weight / self.sigma_m**2

    def without_thickness(self, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(6, 6) information on the motion of ``rows`` (6, N) that the unknown thicknesses take."""
        taken = np.zeros((6, 6))
        for plates, _, deviation in self._behind:
            of_kind = weight[plates]
            total = rows[:, plates] @ of_kind
            taken += np.outer(total, total) / (of_kind.sum() + deviation**-2)
        for outline, arm in self._outlines:
            known = weight[outline] * arm
            total = rows[:, outline] @ known
            taken += np.outer(total, total) / (known @ arm + _OUTLINE_STD**-2)
        return taken

    @cached_property
    def normal(self) -> np.ndarray:
        """(3, N) mean of both normals."""
        normal = self.normal_a + self.normal_b
        return normal / np.sqrt(column_dots(normal, normal))

    def moved(self, rotation: np.ndarray, translation_m: np.ndarray) -> Pairs:
        """The pairs after a small further motion of a: rotation (3, 3), translation_m (3,)."""
        return replace(
            self, point_a=rotation @ self.point_a + translation_m[:, None],
            normal_a=rotation @ self.normal_a, rotation=rotation @ self.rotation,
            translation_m=rotation @ self.translation_m + translation_m,
        )  # fmt: skip

"""Finds pairs between two views for any motion between them: planes seen in the same direction,
edges that are near.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.alignment.consistency import project
from horizon_sensor_ros.core.target_motion.alignment.pairs import (
    EDGE,
    EDGE_ON,
    FACE,
    FAR_SIDE,
    THIN,
    Pairs,
)
from horizon_sensor_ros.core.target_motion.surfaces.edges.edges import Edges
from horizon_sensor_ros.core.target_motion.surfaces.parts import PART_TILT_RAD
from horizon_sensor_ros.core.target_motion.surfaces.planes import normal_noise
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# Cosines between side normals, and between directions, of edges that may be one.
_SAME_SIDE, _SAME_LINE = 0.6, 0.93
# Cosine to the normal at which a plate is seen edge on: its rim may be what was returned.
_EDGE_ON_COSINE = 0.1
# Thickness of plates, in pixel widths.
_PLATE_PX = 1.0
# What differs from place to place of how far a plate lies behind its face, pixel widths, by kind.
_ROUGH_PX = np.array([0, 0, _PLATE_PX / 6, _PLATE_PX / 2], np.float32)
# Bars show other sides as they turn about themselves, which lie off by half of their width for each
# radian, in pixel widths: at least this, as other parts of them fall into the pixels, and at most.
_SIDES_PX, _SAME_SIDES_PX, _OTHER_SIDES_PX = 0.85, 0.1, 0.3
# Those of one direction, within this cosine, turn alike. Beyond so many directions all are one.
_SAME_DIRECTION, _MOST_DIRECTIONS = np.cos(np.radians(15.0)), 12
# Cosine between normals of what may be one plane.
_SAME_NORMAL = 0.85
# point_a, point_b, normal_a, normal_b (N, 3), sigma_m, weight, tilt2 and kind of some pairs.
_Set = tuple[np.ndarray, ...]


class Matcher:
    """Finds pairs between two views for any motion between them; made once a registration."""

    def __init__(self, a: SurfaceView, b: SurfaceView) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415  heavy to import, and only used here

        self.a, self.b = a, b
        # Pixels of the finer view that fall in one of the other's meet the same noise there: each
        # counts for its share of that, along edges and, squared, on faces.
        finer = a.footprint_m / b.footprint_m
        self._share_a, self._share_b = min(finer, 1.0), min(1.0 / finer, 1.0)
        self._tree = cKDTree(b.edges.points)
        # Directions of b's bars, and which of them each of b's edges has.
        self._directions, self._direction = _directions(b.edges)
        # Which of b's parts is at a pixel, or -1.
        self._part = np.full(b.plane.shape, -1, np.int32)
        self._part[b.parts.place] = np.arange(len(b.parts))

    def pairs(
        self, rotation: np.ndarray, translation: np.ndarray, gate_m: float, step: int = 1
    ) -> Pairs:
        """Pairs whose distance along the normal is below ``gate_m``; of planes and edges
        each ``step``-th, and parts only where that is 1.
        """
        a, b = self.a, self.b
        turn, shift = rotation.astype(np.float32), translation.astype(np.float32)
        sets = [
            _counted(_to_planes(a, b, turn, shift, gate_m, step), self._share_a**2),
            _turned_back(
                _counted(_to_planes(b, a, turn.T, -shift @ turn, gate_m, step), self._share_b**2),
                turn,
                shift,
            ),
        ]
        across_edges, of_edges = slice(0), (np.empty(0, np.intp), np.empty(0, np.intp))
        if len(a.edges) and len(b.edges):
            found, of_edges = self._edges(rotation, translation, gate_m, step)
            first = sum(len(each[0]) for each in sets)
            across_edges = slice(first, first + len(of_edges[0]))
            sets += [_counted(each, self._share_a) for each in found]
        # From afar a bar may be taken for the next side of it.
        if step == 1 and len(a.parts) and len(b.parts):
            sets.append(_counted(self._parts(turn, shift, gate_m), self._share_a**2))
        parts = [np.concatenate(part) for part in zip(*sets, strict=True)]
        point_a, point_b, normal_a, normal_b = (
            np.array(part.T, np.float64, order="C") for part in parts[:4]
        )
        sigma, weight, tilt2, kind = parts[4:]
        of_a, of_b = of_edges
        half_width = np.minimum(a.edges.half_width_m[of_a], b.edges.half_width_m[of_b])
        return Pairs(
            point_a, point_b, normal_a, normal_b, sigma, weight, tilt2, kind,
            _PLATE_PX * b.footprint_m, self._directions, self._sides_m(rotation), rotation,
            translation, across_edges, of_edges, half_width, self._direction[of_b],
        )  # fmt: skip

    def _sides_m(self, rotation: np.ndarray) -> np.ndarray:
        """(K,) standard deviation of what bars of each direction lie off by."""
        axes = self._directions
        before, after = rotation @ self.a.image.centroid_m, self.b.image.centroid_m
        across = [sight - (axes @ sight)[:, None] * axes for sight in (before, after)]
        before, after = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in across)
        turn_rad = np.arccos(np.clip(_dots(before, after), -1, 1))
        off_px = np.clip(_SIDES_PX * turn_rad, _SAME_SIDES_PX, _OTHER_SIDES_PX)
        return off_px * self.b.footprint_m

    def _edges(
        self, rotation: np.ndarray, translation: np.ndarray, gate_m: float, step: int
    ) -> tuple[list[_Set], tuple[np.ndarray, np.ndarray]]:
        """Pairs across edges, then, if there are bars, along their fronts; and of which edges of a
        and of b the former are.
        """
        a, b = self.a.edges, self.b.edges
        point = a.points[::step] @ rotation.T + translation
        reach = max(3 * self.b.footprint_m, gate_m)
        distance, index = self._tree.query(point, distance_upper_bound=reach)
        near = np.flatnonzero(distance < np.inf)
        of_a, of_b = step * near, index[near]
        thin = np.isfinite(a.fronts.take(of_a * 3))
        keep = thin == np.isfinite(b.fronts.take(of_b * 3))
        # Where both views see both faces of a crease, their planes say it all.
        keep &= ~(a.creases[of_a] & b.creases[of_b])
        near, of_a, of_b, thin = near[keep], of_a[keep], of_b[keep], thin[keep]
        point, other = point.take(near, axis=0), b.points.take(of_b, axis=0)
        side, n = a.sides.take(of_a, axis=0) @ rotation.T, b.sides.take(of_b, axis=0)
        line = a.directions.take(of_a, axis=0) @ rotation.T
        keep = _dots(side, n) > _SAME_SIDE
        keep &= np.abs(_dots(line, b.directions.take(of_b, axis=0))) > _SAME_LINE
        keep &= np.abs(_dots(point - other, n)) < max(gate_m, self.b.footprint_m)
        keep = np.flatnonzero(keep)
        of_a, of_b = of_a[keep], of_b[keep]
        point, other = point.take(keep, axis=0), other.take(keep, axis=0)
        side, n = side.take(keep, axis=0), n.take(keep, axis=0)
        by_range2 = self._by_range2(rotation, of_a, of_b, side, n)
        sigma = np.sqrt(a.sigma_m[of_a] ** 2 + b.sigma_m[of_b] ** 2 + by_range2)
        sides = (point, other, side, n, sigma, *_alike(len(of_a), EDGE, step))
        of_edges = of_a, of_b
        keep = np.flatnonzero(thin[keep])
        if not len(keep):
            return [sides], of_edges
        front_a = a.fronts.take(of_a[keep], axis=0) @ rotation.T
        front_b = b.fronts.take(of_b[keep], axis=0)
        same = np.flatnonzero(_dots(front_a, front_b) > 0.7)
        keep, front_a, front_b = keep[same], front_a[same], front_b[same]
        of_a, of_b = of_a[keep], of_b[keep]
        noise = np.hypot(np.hypot(self.a.sigma_m, self.b.sigma_m), 0.1 * self.b.footprint_m)
        sigma = np.sqrt(noise**2 + a.rough_m[of_a] ** 2 + b.rough_m[of_b] ** 2)
        fronts = (point[keep], other[keep], front_a, front_b, sigma,
                  *_alike(len(keep), THIN, step, a.tilt_rad[of_a] * b.tilt_rad[of_b]))  # fmt: skip
        fronts[-1][:] += self._direction[of_b]
        return [sides, fronts], of_edges

    def _by_range2(
        self,
        rotation: np.ndarray,
        of_a: np.ndarray,
        of_b: np.ndarray,
        side: np.ndarray,
        n: np.ndarray,
    ) -> np.ndarray:
        """(N,) variance of edges' distances that comes of noise of their ranges: none where both
        views look along one ray. side, n : (N, 3) their normals, in b's frame.
        """
        aside_a = _dots(self.a.edges.range_noise_m.take(of_a, axis=0) @ rotation.T, n)
        aside_b = _dots(self.b.edges.range_noise_m.take(of_b, axis=0), side)
        both = side + n
        return (aside_a * aside_a + aside_b * aside_b) / _dots(both, both)

    def _parts(self, rotation: np.ndarray, translation: np.ndarray, gate_m: float) -> _Set:
        """a's parts, moved into b's frame, against those that b sees in the same direction."""
        a, b = self.a.parts, self.b.parts
        point = a.points @ rotation.T + translation
        index = self._part[project(self.b, *point.T)]
        of_a = np.flatnonzero(index >= 0)
        of_b, point = index[of_a], point.take(of_a, axis=0)
        other, n = b.points.take(of_b, axis=0), b.normals.take(of_b, axis=0)
        normal = a.normals.take(of_a, axis=0) @ rotation.T
        agree = (_dots(normal, n) > _SAME_NORMAL) & (np.abs(_dots(point - other, n)) < gate_m)
        kept = np.flatnonzero(agree)
        point, other, normal, n = (part.take(kept, axis=0) for part in (point, other, normal, n))
        sigma = np.hypot(a.sigma_m[of_a[kept]], b.sigma_m[of_b[kept]])
        alike = _alike(len(kept), FACE, 1, PART_TILT_RAD**2)
        return point, other, normal, n, sigma, *alike


def _directions(edges: Edges) -> tuple[np.ndarray, np.ndarray]:
    """(K, 3) directions of bars, the commonest first, and (E,) which of them each edge has; 0 where
    it is no bar's.
    """
    which = np.zeros(len(edges), np.int8)
    left = np.flatnonzero(np.isfinite(edges.fronts[:, 0]) | (edges.half_width_m > 0))
    axes: list[np.ndarray] = []
    while len(left) and len(axes) < _MOST_DIRECTIONS:
        lines = edges.directions.take(left, axis=0)
        some = lines[:: 1 + len(lines) // 60]
        alike = np.abs(some @ lines.T) > _SAME_DIRECTION
        best = int(alike.sum(axis=1).argmax())
        which[left] = len(axes)
        axes.append(some[best])
        left = left[~alike[best]]
    return np.array(axes).reshape(-1, 3), which


def _alike(
    count: int, kind: int, step: int, tilt2: float | np.ndarray = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weight, tilt2 and kind of pairs, each for ``step`` measurements."""
    return np.full(count, float(step)), np.full(count, tilt2), np.full(count, kind, np.int8)


def _dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N,) products of the rows of (N, 3)."""
    return np.einsum("ij,ij->i", a, b)


def _counted(pairs: _Set, share: float) -> _Set:
    """Pairs that count for a share of what they did."""
    point_a, point_b, normal_a, normal_b, sigma, weight, *rest = pairs
    return point_a, point_b, normal_a, normal_b, sigma, share * weight, *rest


def _turned_back(pairs: _Set, rotation: np.ndarray, translation: np.ndarray) -> _Set:
    """Pairs of b's surfels with a's planes, as pairs of a with b in b's frame."""
    point_b, point_a, normal_b, normal_a, *rest, kind = pairs
    point_a, point_b = point_a @ rotation.T + translation, point_b @ rotation.T + translation
    normal_a, normal_b = normal_a @ rotation.T, normal_b @ rotation.T
    # Behind a plate's face is the same sign, whichever view sees the face.
    plate = np.flatnonzero(kind != FACE)
    normal_a[plate] *= -1
    normal_b[plate] *= -1
    return point_a, point_b, normal_a, normal_b, *rest, kind


def _to_planes(
    a: SurfaceView,
    b: SurfaceView,
    rotation: np.ndarray,
    translation: np.ndarray,
    gate_m: float,
    step: int,
) -> _Set:
    """a's surfels, moved into b's frame, against the planes that b sees in the same direction.

    Single precision does: a micrometre at some metres.
    """
    surfels = a.surfels
    turned = surfels.points[::step] @ rotation.T
    point = turned + translation
    index = project(b, *point.T)
    seen = np.flatnonzero(b.steady[index])
    index, point, near = index[seen], point.take(seen, axis=0), seen * step
    other, n = b.point_map.take(index, axis=0), b.normal_map.take(index, axis=0)
    off = _dots(point - other, n)
    # Bare returns come last.
    planes = int(np.searchsorted(near, surfels.num_planes))
    normal = n.copy()
    np.matmul(surfels.normals.take(near[:planes], axis=0), rotation.T, out=normal[:planes])
    along = _dots(normal[:planes], n[:planes])
    # A thin plate's far side is another surface: a bare return must have been able to see the
    # plane.
    ray = turned.take(seen[planes:], axis=0)
    sight = _dots(n[planes:], ray) / np.sqrt(_dots(ray, ray))
    kind = np.full(len(near), FACE, np.int8)
    kind[planes:][np.abs(sight) < _EDGE_ON_COSINE] = EDGE_ON
    far = np.flatnonzero(along < -_SAME_NORMAL)
    kind[far] = FAR_SIDE
    normal[far] *= -1
    agree = off > -gate_m
    agree[far] = off[far] > -max(gate_m, 2 * _PLATE_PX * b.footprint_m)
    agree &= off < gate_m
    agree[:planes] &= np.abs(along) > _SAME_NORMAL
    agree[planes:] &= sight < _EDGE_ON_COSINE
    kept, first_bare = np.flatnonzero(agree), planes
    planes = int(np.searchsorted(kept, planes))
    near, index, kind = near[kept], index[kept], kind[kept]
    point, other, n, normal = (part.take(kept, axis=0) for part in (point, other, n, normal))
    noise, tilt = b.noise_m[index], b.tilt_rad[index]
    own = surfels.sigma_m[near]
    # A bare return's noise is its own view's, however well the other one knows the plane; and what
    # that sees at a slant has no plane for a reason.
    cosine = np.abs(sight[kept[planes:] - first_bare])
    off_px = surfels.off_px[near[planes:]]
    bare = normal_noise(a.sigma_m, a.slant_growth, a.footprint_m, cosine, tilt[planes:], off_px)
    own[planes:] = np.maximum(bare, noise[planes:])
    variance = own * own + noise * noise
    plate = np.flatnonzero(kind)
    variance[plate] += (_ROUGH_PX[kind[plate]] * np.float32(b.footprint_m)) ** 2
    tilt2 = tilt * surfels.tilt_rad[near]
    # Both normals of a bare return are the plane's.
    tilt2[planes:] = tilt[planes:] ** 2 + np.float32(b.normal_noise_rad) ** 2
    return point, other, normal, n, np.sqrt(variance), step * surfels.weight[near], tilt2, kind

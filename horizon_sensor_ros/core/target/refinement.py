"""Motion between two views to the sensor's noise: weighted point-to-plane over faces, depth edges
and thin parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.target.consistency import project
from horizon_sensor_ros.core.target.rigid import orthonormal, rotation_from_vector
from horizon_sensor_ros.core.target.surfels import SurfaceView

# Before the last gate a part of the planes does.
_COARSE_STEP = 3
# Cosines between side normals, and between directions, of edges that may be one.
_SAME_SIDE, _SAME_LINE = 0.6, 0.93
# So many steps at full length.
_FREE_ITERATIONS = 8
# Kinds of pairs.
FACE, EDGE, THIN, FAR_SIDE, EDGE_ON = range(5)
# Cosine to the normal at which a plate is seen edge on: its rim may be what was returned.
_EDGE_ON_COSINE = 0.1
# Thickness of plates, in pixel widths.
_PLATE_PX = 1.0
# What a plate seen from its far side, and one seen edge on, lies behind its face by, and how
# uncertain that is, in thicknesses.
_BEHIND_FACE = {FAR_SIDE: (1.0, 1.0), EDGE_ON: (0.5, 0.7)}
# What differs from place to place of that, in pixel widths, by kind.
_ROUGH_PX = np.array([0, 0, 0, _PLATE_PX / 6, _PLATE_PX / 2], np.float32)
# Cosine between normals of what may be one plane.
_SAME_NORMAL = 0.85


@dataclass(frozen=True, eq=False)
class Pairs:
    """N correspondences: a's points moved into b's frame and b's points, with both normals, (N, 3)
    each.

    sigma_m : (N,) of the distance along the normal, for one raw measurement in each view.
    weight : (N,) raw measurements that the pair stands for.  tilt2 : (N,) covariance (rad^2) of
        both normals' errors.
    kind : (N,) FACE, EDGE, THIN (part), FAR_SIDE: a plate that one view sees from the one side
        and the other view from the other; it is as thick as the others, and nobody knows how thick.
        EDGE_ON: a plate's face, and its rim or either face in the other view.
    plate_m : thickness to be expected of a plate before it is measured.
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

    @cached_property
    def residual(self) -> np.ndarray:
        """(N,) distances along the mean normal, metres; of plates beyond what all of a kind have in
        common."""
        distance = np.einsum("ij,ij->i", self.point_a - self.point_b, self.normal)
        for kind, (mean, deviation) in _BEHIND_FACE.items():
            rows = np.flatnonzero(self.kind == kind)
            if len(rows):
                known = (self.weight[rows] / self.sigma_m[rows] ** 2).sum()
                prior = (deviation * self.plate_m) ** -2
                distance[rows] -= (
                    np.median(distance[rows]) * known - mean * self.plate_m * prior
                ) / (known + prior)
        return distance

    def without_thickness(self, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(6, 6) information on the motion of ``rows`` (N, 6) that the unknown thicknesses take."""
        taken = np.zeros((6, 6))
        for kind, (_, deviation) in _BEHIND_FACE.items():
            of_kind = self.kind == kind
            total = weight[of_kind] @ rows[of_kind]
            known = weight[of_kind].sum() + (deviation * self.plate_m) ** -2
            taken += np.outer(total, total) / known
        return taken

    @cached_property
    def normal(self) -> np.ndarray:
        """(N, 3) mean of both normals."""
        normal = self.normal_a + self.normal_b
        return normal / np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]


@dataclass(frozen=True, eq=False)
class Refined:
    """Result of the iteration: the motion, its last pairs and their robust weights, and whether it
    came to rest."""

    rotation: np.ndarray
    translation_m: np.ndarray
    pairs: Pairs
    robust: np.ndarray
    converged: bool
    iterations: int


class Matcher:
    """Finds pairs between two views for any motion between them; made once a registration."""

    def __init__(self, a: SurfaceView, b: SurfaceView) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415  heavy to import, and only used here

        self.a, self.b = a, b
        self._tree = cKDTree(b.edges.points)

    def pairs(
        self, rotation: np.ndarray, translation: np.ndarray, gate_m: float, step: int = 1
    ) -> Pairs:
        """Pairs whose distance along the normal is below ``gate_m``; of planes and edges
        each ``step``-th."""
        a, b = self.a, self.b
        back, shift = rotation.T, -rotation.T @ translation
        there, kind = _to_planes(a, b, rotation, translation, gate_m, step)
        (pb, pa, nb, na, *rest), kind_back = _to_planes(b, a, back, shift, gate_m, step)
        # Behind a plate's face is the same sign, whichever view sees the face.
        turn = np.where(kind_back == FACE, 1.0, -1.0)[:, None]
        sets = [
            there,
            (
                pa @ back + translation,
                pb @ back + translation,
                turn * na @ back,
                turn * nb @ back,
                *rest,
            ),
        ]
        kinds = [kind, kind_back]
        if len(a.edges) and len(b.edges):
            for number, pairs in enumerate(
                self._edges(rotation, translation, gate_m, step), start=EDGE
            ):
                sets.append(pairs)
                kinds.append(np.full(len(pairs[0]), number, np.int8))
        point_a, point_b, normal_a, normal_b, sigma, weight, tilt2 = (
            np.concatenate(part) for part in zip(*sets, strict=True)
        )
        kind = np.concatenate(kinds)
        return Pairs(
            point_a, point_b, normal_a, normal_b, sigma, weight, tilt2, kind,
            _PLATE_PX * b.footprint_m,
        )  # fmt: skip

    def _edges(
        self, rotation: np.ndarray, translation: np.ndarray, gate_m: float, step: int
    ) -> list[tuple[np.ndarray, ...]]:
        a, b = self.a.edges, self.b.edges
        point = a.points[::step] @ rotation.T + translation
        side = a.sides[::step] @ rotation.T
        reach = max(3 * self.b.footprint_m, gate_m)
        distance, index = self._tree.query(point, distance_upper_bound=reach)
        near = np.flatnonzero(np.isfinite(distance))
        index = index[near]
        point, side, other, n = point[near], side[near], b.points[index], b.sides[index]
        front_a, front_b = a.fronts[step * near] @ rotation.T, b.fronts[index]
        thin = np.isfinite(front_a[:, 0])
        line_a, line_b = a.directions[step * near] @ rotation.T, b.directions[index]
        keep = np.einsum("ij,ij->i", side, n) > _SAME_SIDE
        keep &= np.abs(np.einsum("ij,ij->i", line_a, line_b)) > _SAME_LINE
        # Where both views see both faces of a crease, their planes say it all.
        keep &= ~(a.creases[step * near] & b.creases[index])
        keep &= thin == np.isfinite(front_b[:, 0])
        off = np.einsum("ij,ij->i", point - other, n)
        keep &= np.abs(off) < max(gate_m, self.b.footprint_m)
        sigma = np.hypot(a.sigma_m[step * near], b.sigma_m[index])
        one = np.ones(len(near))
        sides = (
            point[keep],
            other[keep],
            side[keep],
            n[keep],
            sigma[keep],
            step * one[keep],
            0 * one[keep],
        )
        keep &= thin
        keep[keep] = np.einsum("ij,ij->i", front_a[keep], front_b[keep]) > 0.7
        noise = np.hypot(np.hypot(self.a.sigma_m, self.b.sigma_m), 0.1 * self.b.footprint_m)
        fronts = (point[keep], other[keep], front_a[keep], front_b[keep],
                  noise * one[keep], step * one[keep], 0 * one[keep])  # fmt: skip
        return [sides, fronts]


def _to_planes(
    a: SurfaceView,
    b: SurfaceView,
    rotation: np.ndarray,
    translation: np.ndarray,
    gate_m: float,
    step: int,
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """a's surfels, moved into b's frame, against the planes that b sees in the same direction, and
    the kind of each pair."""
    surfels = a.surfels
    # Single precision does: a micrometre at some metres.
    rotation, translation = rotation.astype(np.float32), translation.astype(np.float32)
    turned = surfels.points[::step] @ rotation.T
    point = turned + translation
    index = project(b, *point.T)
    seen = np.flatnonzero(b.plane[index])
    index, point, near = index[seen], point[seen], seen * step
    other, n = b.point_map.take(index, axis=0), b.normal_map.take(index, axis=0)
    off = np.einsum("ij,ij->i", point - other, n)
    # Bare returns come last.
    planes = int(np.searchsorted(near, surfels.num_planes))
    normal = n.copy()
    normal[:planes] = surfels.normals.take(near[:planes], axis=0) @ rotation.T
    along = np.einsum("ij,ij->i", normal[:planes], n[:planes])
    # A thin plate's far side is another surface: a bare return must have been able to see the
    # plane.
    ray = turned[seen[planes:]]
    sight = np.einsum("ij,ij->i", n[planes:], ray) / np.sqrt(np.einsum("ij,ij->i", ray, ray))
    kind = np.full(len(near), FACE, np.int8)
    kind[:planes][along < -_SAME_NORMAL] = FAR_SIDE
    kind[planes:][np.abs(sight) < _EDGE_ON_COSINE] = EDGE_ON
    agree = np.concatenate([np.abs(along) > _SAME_NORMAL, sight < _EDGE_ON_COSINE])
    behind = np.where(kind == FAR_SIDE, max(gate_m, 2 * _PLATE_PX * b.footprint_m), gate_m)
    agree &= (off < gate_m) & (off > -behind)
    planes = int(np.count_nonzero(agree[:planes]))
    near, index, kind, point, other, n, normal = (
        part[agree] for part in (near, index, kind, point, other, n, normal)
    )
    normal[kind == FAR_SIDE] *= -1
    noise = b.noise_m[index]
    own = surfels.sigma_m[near]
    own[planes:] = noise[planes:]
    rough = _ROUGH_PX[kind] * np.float32(b.footprint_m)
    sigma = np.sqrt(own * own + noise * noise + rough * rough)
    tilt = b.tilt_rad[index]
    tilt[planes:] = b.normal_noise_rad
    tilt2 = surfels.tilt_rad[near] * tilt
    return (point, other, normal, n, sigma, step * surfels.weight[near], tilt2), kind


def robust_weights(pairs: Pairs) -> np.ndarray:
    """(N,) Cauchy weights of the residuals."""
    ratio = pairs.residual / (1.5 * pairs.sigma_m)
    return 1 / (1 + ratio * ratio)


def jacobian(point: np.ndarray, normal: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(N, 6) change of the distance along ``normal`` with a small turn about ``centre`` and a
    shift."""
    (x, y, z), (a, b, c) = (point - centre).T, normal.T
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a, a, b, c], axis=1)


def _stiffness(
    pairs: Pairs, weighted: np.ndarray, j: np.ndarray, w: np.ndarray, centre: np.ndarray
) -> np.ndarray:
    """(6, 6) matrix of the normal equations, with less of what the noise of the normals feigns.

    Where little is observed that feigned part makes the steps many times too short; the product of
    both views' Jacobians is free of it, but need not be positive.
    """
    j_a = jacobian(pairs.point_a, pairs.normal_a, centre)
    # Of mean normals j = (j_a + j_b) / 2, nearly.
    product = (j_a * w[:, None]).T @ (2 * j - j_a)
    information = 0.3 * weighted.T @ j + 0.35 * (product + product.T)
    information -= pairs.without_thickness(j, w)
    information[np.diag_indices(6)] += 1e-6 * np.trace(information) / 6 + 1e-9
    return information


def refine(
    matcher: Matcher,
    rotation: np.ndarray,
    translation_m: np.ndarray,
    gates_m: tuple[float, ...],
    max_iterations: int = 20,
) -> Refined:
    """Gauss-Newton from a start within the gates; the last gate is used until nothing moves any
    more."""
    rotation, translation = np.array(rotation, float), np.array(translation_m, float)
    centre = matcher.b.image.centroid_m
    converged = False
    iteration = 0
    for iteration in range(1, max_iterations + 1):
        coarse = iteration < len(gates_m)
        gate = gates_m[iteration - 1] if coarse else gates_m[-1]
        pairs = matcher.pairs(rotation, translation, gate, _COARSE_STEP if coarse else 1)
        robust = robust_weights(pairs)
        w = robust * pairs.weight / pairs.sigma_m**2
        j = jacobian(pairs.point_a, pairs.normal, centre)
        weighted = j * w[:, None]
        gradient = weighted.T @ pairs.residual
        information = _stiffness(pairs, weighted, j, w, centre)
        step = -np.linalg.solve(information, gradient)
        # The step in units of its own standard deviation, squared.
        moved = -step @ gradient
        # Pairs that come and go with every step would swing for ever.
        if iteration > _FREE_ITERATIONS:
            step *= 0.5
        turn = rotation_from_vector(step[:3])
        rotation = turn @ rotation
        translation = turn @ (translation - centre) + centre + step[3:]
        converged = not coarse and moved < 0.5
        if converged and (moved < 0.3 or iteration > _FREE_ITERATIONS + 2):
            break
    return Refined(orthonormal(rotation), translation, pairs, robust, converged, iteration)

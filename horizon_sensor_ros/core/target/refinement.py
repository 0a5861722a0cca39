"""Motion between two views to the sensor's noise: weighted point-to-plane over faces, depth edges
and thin parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .consistency import project
from .rigid import orthonormal, rotation_from_vector
from .surfels import SurfaceView, normal_noise

# Before the last gate a part of the planes does.
_COARSE_STEP = 3


@dataclass(frozen=True, eq=False)
class Pairs:
    """N correspondences: a's points moved into b's frame and b's points, with both normals, (N, 3)
    each.

    sigma_m : (N,) of the distance along the normal, for one raw measurement in each view.
    weight : (N,) raw measurements that the pair stands for.  tilt2 : (N,) covariance (rad^2) of
        both normals' errors.
    kind : (N,) 0 face, 1 edge, 2 thin part.
    """

    point_a: np.ndarray
    point_b: np.ndarray
    normal_a: np.ndarray
    normal_b: np.ndarray
    sigma_m: np.ndarray
    weight: np.ndarray
    tilt2: np.ndarray
    kind: np.ndarray

    @cached_property
    def residual(self) -> np.ndarray:
        """(N,) distances along the mean normal, metres."""
        return np.einsum("ij,ij->i", self.point_a - self.point_b, self.normal)

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
        """Pairs whose distance along the normal is below ``gate_m``; of planes each ``step``-th."""
        a, b = self.a, self.b
        back, shift = rotation.T, -rotation.T @ translation
        pb, pa, nb, na, *rest = _to_planes(b, a, back, shift, gate_m, step)
        sets = [
            _to_planes(a, b, rotation, translation, gate_m, step),
            (pa @ back + translation, pb @ back + translation, na @ back, nb @ back, *rest),
        ]
        kinds = [np.zeros(len(s[0]), np.int8) for s in sets]
        if len(a.edges) and len(b.edges):
            for number, pairs in enumerate(self._edges(rotation, translation, gate_m), start=1):
                sets.append(pairs)
                kinds.append(np.full(len(pairs[0]), number, np.int8))
        point_a, point_b, normal_a, normal_b, sigma, weight, tilt2 = (
            np.concatenate(part) for part in zip(*sets, strict=True)
        )
        kind = np.concatenate(kinds)
        return Pairs(point_a, point_b, normal_a, normal_b, sigma, weight, tilt2, kind)

    def _edges(
        self, rotation: np.ndarray, translation: np.ndarray, gate_m: float
    ) -> list[tuple[np.ndarray, ...]]:
        a, b = self.a.edges, self.b.edges
        point = a.points @ rotation.T + translation
        side = a.sides @ rotation.T
        reach = max(3 * self.b.footprint_m, gate_m)
        distance, index = self._tree.query(point, distance_upper_bound=reach)
        near = np.flatnonzero(np.isfinite(distance))
        index = index[near]
        point, side, other, n = point[near], side[near], b.points[index], b.sides[index]
        front_a, front_b = a.fronts[near] @ rotation.T, b.fronts[index]
        thin = np.isfinite(front_a[:, 0])
        keep = np.einsum("ij,ij->i", side, n) > 0.85
        keep &= thin == np.isfinite(front_b[:, 0])
        off = np.einsum("ij,ij->i", point - other, n)
        keep &= np.abs(off) < max(gate_m, self.b.footprint_m)
        sigma = np.hypot(a.sigma_m[near], b.sigma_m[index])
        one = np.ones(len(near))
        sides = (
            point[keep],
            other[keep],
            side[keep],
            n[keep],
            sigma[keep],
            one[keep],
            0 * one[keep],
        )
        keep &= thin
        keep[keep] = np.einsum("ij,ij->i", front_a[keep], front_b[keep]) > 0.7
        noise = np.hypot(np.hypot(self.a.sigma_m, self.b.sigma_m), 0.1 * self.b.footprint_m)
        fronts = (point[keep], other[keep], front_a[keep], front_b[keep],
                  noise * one[keep], one[keep], 0 * one[keep])  # fmt: skip
        return [sides, fronts]


def _to_planes(
    a: SurfaceView,
    b: SurfaceView,
    rotation: np.ndarray,
    translation: np.ndarray,
    gate_m: float,
    step: int,
) -> tuple[np.ndarray, ...]:
    """a's surfels, moved into b's frame, against the planes that b sees in the same direction."""
    surfels = a.surfels
    turned = surfels.points[::step] @ rotation.T
    point = turned + translation
    index = project(b, point[:, 0], point[:, 1], point[:, 2])
    seen = np.flatnonzero(b.plane[index])
    index, point, ray = index[seen], point[seen], turned[seen]
    near = seen * step
    other, n = b.point_map[index].astype(float), b.normal_map[index].astype(float)
    normal = surfels.normals[near] @ rotation.T
    bare = near >= surfels.num_planes
    # A thin plate's far side is another surface: a bare return must have been able to see the
    # plane.
    agree = np.where(
        bare, np.einsum("ij,ij->i", n, ray) < -0.06 * np.sqrt(np.einsum("ij,ij->i", ray, ray)),
        np.einsum("ij,ij->i", normal, n) > 0.85,
    )  # fmt: skip
    keep = agree & (np.abs(np.einsum("ij,ij->i", point - other, n)) < gate_m)
    near, index, bare, point, other, n = (
        part[keep] for part in (near, index, bare, point, other, n)
    )
    normal = np.where(bare[:, None], n, normal[keep])
    cosine = -np.einsum("ij,ij->i", n, other) / np.sqrt(np.einsum("ij,ij->i", other, other))
    noise = normal_noise(b.sigma_m, b.footprint_m, cosine, b.tilt_rad[index])
    sigma = np.hypot(np.where(bare, noise, surfels.sigma_m[near]), noise)
    tilt2 = surfels.tilt_rad[near] * np.where(bare, b.normal_noise_rad, b.tilt_rad[index])
    return point, other, normal, n, sigma, step * surfels.weight[near], tilt2


def robust_weights(pairs: Pairs) -> np.ndarray:
    """(N,) Cauchy weights of the residuals."""
    ratio = pairs.residual / (1.5 * pairs.sigma_m)
    return 1 / (1 + ratio * ratio)


def jacobian(point: np.ndarray, normal: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(N, 6) change of the distance along ``normal`` with a small turn about ``centre`` and a
    shift."""
    (x, y, z), (a, b, c) = (point - centre).T, normal.T
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a, a, b, c], axis=1)


def refine(
    matcher: Matcher,
    rotation: np.ndarray,
    translation_m: np.ndarray,
    gates_m: tuple[float, ...],
    max_iterations: int = 8,
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
        j = jacobian(pairs.point_a, pairs.normal, centre)
        w = robust * pairs.weight / pairs.sigma_m**2
        weighted = j * w[:, None]
        information = weighted.T @ j
        gradient = weighted.T @ pairs.residual
        information[np.diag_indices(6)] += 1e-6 * np.trace(information) / 6 + 1e-9
        step = -np.linalg.solve(information, gradient)
        turn = rotation_from_vector(step[:3])
        rotation = turn @ rotation
        translation = turn @ (translation - centre) + centre + step[3:]
        # The step in units of its own standard deviation, squared.
        moved = -step @ gradient
        converged = not coarse and moved < 0.5
        if converged and moved < 0.05:
            break
    return Refined(orthonormal(rotation), translation, pairs, robust, converged, iteration)

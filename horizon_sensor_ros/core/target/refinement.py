"""Motion between two views to the sensor's noise: weighted point-to-plane over faces, depth edges and thin parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .consistency import project
from .rigid import orthonormal, rotation_from_vector
from .surfels import SurfaceView


@dataclass(frozen=True, eq=False)
class Pairs:
    """N correspondences: a's points moved into b's frame and b's points, with both normals, (N, 3) each.

    sigma_m : (N,) of the distance along the normal, for one raw measurement in each view.
    weight : (N,) raw measurements that the pair stands for.  kind : (N,) 0 face, 1 edge, 2 thin part.
    """

    point_a: np.ndarray
    point_b: np.ndarray
    normal_a: np.ndarray
    normal_b: np.ndarray
    sigma_m: np.ndarray
    weight: np.ndarray
    kind: np.ndarray

    def residual(self) -> np.ndarray:
        """(N,) distances along the mean normal, metres."""
        return np.einsum("ij,ij->i", self.point_a - self.point_b, self.normal())

    def normal(self) -> np.ndarray:
        """(N, 3) mean of both normals."""
        normal = self.normal_a + self.normal_b
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Refined:
    """Result of the iteration: the motion, its last pairs and their robust weights, and whether it came to rest."""

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
        self.tree = cKDTree(b.edges.points) if len(b.edges) else None

    def pairs(
        self, rotation: np.ndarray, translation: np.ndarray, gate_m: float, edges: bool = True
    ) -> Pairs:
        """Pairs whose distance along the normal is below ``gate_m``."""
        a, b = self.a, self.b
        sets = [self._faces(a, b, rotation, translation, gate_m)]
        back = rotation.T
        reverse = self._faces(b, a, back, -back @ translation, gate_m)
        pa, pb, na, nb, sigma, weight = reverse
        sets.append((pb @ rotation.T + translation, pa @ rotation.T + translation,
                     nb @ rotation.T, na @ rotation.T, sigma, weight))  # fmt: skip
        kinds = [np.zeros(len(s[0]), np.int8) for s in sets]
        if edges and self.tree is not None and len(a.edges):
            for kind, pairs in enumerate(self._edges(rotation, translation, gate_m), start=1):
                sets.append(pairs)
                kinds.append(np.full(len(pairs[0]), kind, np.int8))
        return Pairs(*(np.concatenate(part) for part in zip(*sets, strict=True)), np.concatenate(kinds))

    def _faces(
        self, a: SurfaceView, b: SurfaceView, rotation: np.ndarray, translation: np.ndarray, gate_m: float
    ) -> tuple[np.ndarray, ...]:
        """a's planes against those that b sees in the same direction."""
        point = a.faces.points @ rotation.T + translation
        normal = a.faces.normals @ rotation.T
        index = project(b, point[:, 0], point[:, 1], point[:, 2])
        other, n = b.point_map[index].astype(float), b.normal_map[index].astype(float)
        off = np.einsum("ij,ij->i", point - other, n)
        keep = b.plane[index] & (np.abs(off) < gate_m) & (np.einsum("ij,ij->i", normal, n) > 0.85)
        cosine = -np.einsum("ij,ij->i", n, other) / np.maximum(np.linalg.norm(other, axis=1), 1e-9)
        sigma = np.hypot(a.faces.sigma_m, np.hypot(b.sigma_m * cosine, 0.05 * b.footprint_m))
        # Each raw measurement counts once, though both directions are matched.
        weight = a.faces.weight / 2
        return point[keep], other[keep], normal[keep], n[keep], sigma[keep], weight[keep]

    def _edges(
        self, rotation: np.ndarray, translation: np.ndarray, gate_m: float
    ) -> list[tuple[np.ndarray, ...]]:
        a, b = self.a.edges, self.b.edges
        assert self.tree is not None
        point = a.points @ rotation.T + translation
        side = a.sides @ rotation.T
        reach = max(3 * self.b.footprint_m, gate_m)
        distance, index = self.tree.query(point, distance_upper_bound=reach)
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
        sides = (point[keep], other[keep], side[keep], n[keep], sigma[keep], one[keep])
        keep &= thin
        keep[keep] = np.einsum("ij,ij->i", front_a[keep], front_b[keep]) > 0.7
        noise = np.hypot(np.hypot(self.a.sigma_m, self.b.sigma_m), 0.1 * self.b.footprint_m)
        fronts = (point[keep], other[keep], front_a[keep], front_b[keep], noise * one[keep], one[keep])
        return [sides, fronts]


def robust_weights(pairs: Pairs) -> np.ndarray:
    """(N,) Cauchy weights of the residuals."""
    ratio = pairs.residual() / (1.5 * pairs.sigma_m)
    return 1 / (1 + ratio * ratio)


def jacobian(point: np.ndarray, normal: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(N, 6) change of the distance along ``normal`` with a small turn about ``centre`` and a shift."""
    return np.hstack([np.cross(point - centre, normal), normal])


def refine(
    matcher: Matcher,
    rotation: np.ndarray,
    translation_m: np.ndarray,
    gates_m: tuple[float, ...],
    max_iterations: int = 10,
) -> Refined:
    """Gauss-Newton from a start within the gates; the last gate is used until nothing moves any more."""
    rotation, translation = np.array(rotation, float), np.array(translation_m, float)
    centre = matcher.b.image.centroid_m
    converged = False
    iteration = 0
    for iteration in range(1, max_iterations + 1):  # noqa: B007
        pairs = matcher.pairs(rotation, translation, gates_m[min(iteration, len(gates_m)) - 1])
        robust = robust_weights(pairs)
        j = jacobian(pairs.point_a, pairs.normal(), centre)
        w = robust * pairs.weight / pairs.sigma_m**2
        weighted = j * w[:, None]
        information = weighted.T @ j
        gradient = weighted.T @ pairs.residual()
        information[np.diag_indices(6)] += 1e-6 * np.trace(information) / 6 + 1e-9
        step = -np.linalg.solve(information, gradient)
        turn = rotation_from_vector(step[:3])
        rotation = turn @ rotation
        translation = turn @ (translation - centre) + centre + step[3:]
        if iteration >= len(gates_m) and -step @ gradient < 0.02:
            converged = True
            break
    return Refined(orthonormal(rotation), translation, pairs, robust, converged, iteration)

"""A time-of-flight camera looking at triangle meshes: point clouds with exact truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.sim.shapes import TriangleMesh

_PAIRS_AT_ONCE = 32_768  # of a triangle and a pixel: what is made of them stays in the cache
_ASIDE = 1e-7  # tangent of the angle between two rays that meet the same triangle
_LEAST_COSINE = 0.02  # noise grows no more from there on
_LARGE = 400  # pixels from which a triangle's box is worth a turn of its own


@dataclass(frozen=True)
class ToFDisturbances:
    """What a real sensor adds to range noise.

    outlier_fraction : of the target's pixels as many get a random range, half of them on the
        target, half on empty pixels around it.
    occluded_fraction : of the target's pixels as many, one round patch of them, return nothing.
    mixed_pixels : a pixel at a depth edge returns the mean range of what it covers.
    """

    outlier_fraction: float = 0.0
    occluded_fraction: float = 0.0
    mixed_pixels: bool = False

    def __post_init__(self) -> None:
        for name in ("outlier_fraction", "occluded_fraction"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must be in [0, 1], got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class ToFScan:
    """One exposure.

    points : (H, W, 3) float32, metres, optical frame (x right, y down, z forward); NaN: no return.
    pose_cam_from_target : (4, 4), the truth.
    """

    points: np.ndarray
    pose_cam_from_target: np.ndarray

    def plain(self) -> np.ndarray:
        """(N, 3) the returned points alone, as of an unorganised cloud."""
        return self.points[np.isfinite(self.points[..., 2])]


@dataclass(frozen=True)
class ToFCamera:
    """Pinhole range camera; the defaults are the paper's PMD CamCube 2.0.

    The range of each pixel is measured along its ray, with Gaussian noise ``range_noise_m`` where
    the surface is seen squarely; its variance grows as 1 + ``slant_growth`` (1/c^2 - 1) with the
    cosine c between ray and normal. Ranges outside ``range_min_m .. range_max_m`` return nothing.
    Raises ValueError for values that make no camera.
    """

    width: int = 204
    height: int = 204
    pixel_pitch_m: float = 40e-6
    focal_length_m: float = 12.8e-3
    range_min_m: float = 0.3
    range_max_m: float = 7.0
    range_noise_m: float = 0.005
    slant_growth: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "height", "pixel_pitch_m", "focal_length_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 <= self.range_min_m < self.range_max_m:
            raise ValueError(
                f"need 0 <= range_min_m < range_max_m, got {self.range_min_m}, {self.range_max_m}"
            )
        for name in ("range_noise_m", "slant_growth"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.focal_length_m / self.pixel_pitch_m

    def rays(self, oversampling: int = 1) -> np.ndarray:
        """(H k, W k, 3) unit rays of the pixel centres, or of k x k places inside each pixel."""
        u, v = self._tangents(oversampling)
        scale = 1.0 / np.sqrt(u * u + (v * v)[:, None] + 1.0)
        return np.stack([u * scale, v[:, None] * scale, scale], axis=-1)

    def _tangents(self, oversampling: int) -> tuple[np.ndarray, np.ndarray]:
        """x / z (W k,) of the columns of rays, and y / z (H k,) of the rows."""
        k = oversampling
        u = ((np.arange(self.width * k) + 0.5) / k - self.width / 2) / self.focal_px
        v = ((np.arange(self.height * k) + 0.5) / k - self.height / 2) / self.focal_px
        return u, v

    def ranges(
        self, mesh: TriangleMesh, pose_cam_from_target: np.ndarray, oversampling: int = 1
    ) -> np.ndarray:
        """(H k, W k) exact range (m) of the nearest surface along each ray; NaN where there is
        none.
        """
        pose = _checked_pose(pose_cam_from_target)
        corners = (mesh.vertices @ pose[:3, :3].T + pose[:3, 3])[mesh.faces]
        u, v = self._tangents(oversampling)
        depth = _cast(corners, u, v, self.focal_px * oversampling)
        depth *= np.sqrt(u * u + (v * v)[:, None] + 1.0)
        return depth

    def cosines(self, mesh: TriangleMesh, pose_cam_from_target: np.ndarray) -> np.ndarray:
        """(H, W) cosine between each ray and the normal of the surface it meets; NaN where there is
        none.
        """
        pose = _checked_pose(pose_cam_from_target)
        corners = (mesh.vertices @ pose[:3, :3].T + pose[:3, 3])[mesh.faces]
        u, v = self._tangents(1)
        # Inverse depth is linear over a triangle: a n.(u, v, 1), told by rays close by.
        here, right, below = (
            1.0 / _cast(corners, u + du, v + dv, self.focal_px)
            for du, dv in ((0.0, 0.0), (_ASIDE, 0.0), (0.0, _ASIDE))
        )
        slope_u, slope_v = (right - here) / _ASIDE, (below - here) / _ASIDE
        rest = here - slope_u * u - slope_v * v[:, None]
        length = np.sqrt(slope_u**2 + slope_v**2 + rest**2)
        return here / (length * np.sqrt(u * u + (v * v)[:, None] + 1.0))

    def _noise_m(self, mesh: TriangleMesh, pose: np.ndarray) -> np.ndarray | float:
        """Standard deviation of each range (H, W), or of all of them."""
        if not self.slant_growth:
            return self.range_noise_m
        cosine = np.nan_to_num(self.cosines(mesh, pose), nan=1.0)
        steep = np.maximum(cosine, _LEAST_COSINE) ** -2.0 - 1.0
        return self.range_noise_m * np.sqrt(1.0 + self.slant_growth * steep)

    def scan(
        self,
        mesh: TriangleMesh,
        pose_cam_from_target: np.ndarray,
        rng: np.random.Generator | None = None,
        disturbances: ToFDisturbances | None = None,
    ) -> ToFScan:
        """Expose once. Without ``rng`` there is no noise, and disturbances that need chance raise
        ValueError.
        """
        extra = ToFDisturbances() if disturbances is None else disturbances
        if rng is None and (extra.outlier_fraction or extra.occluded_fraction):
            raise ValueError("outliers and occlusion need rng")
        see = self._mixed if extra.mixed_pixels else self.ranges
        measured = see(mesh, pose_cam_from_target)
        if rng is not None:
            _occlude(measured, extra.occluded_fraction, rng)
            measured += rng.normal(0.0, self._noise_m(mesh, pose_cam_from_target), measured.shape)
            _add_outliers(measured, extra.outlier_fraction, rng)
        measured[~((measured >= self.range_min_m) & (measured <= self.range_max_m))] = np.nan
        points = (measured[..., None] * self.rays()).astype(np.float32)
        return ToFScan(points, _checked_pose(pose_cam_from_target))

    def _mixed(self, mesh: TriangleMesh, pose: np.ndarray) -> np.ndarray:
        k = 3
        split = self.ranges(mesh, pose, k).reshape(self.height, k, self.width, k)
        fine = np.moveaxis(split, 2, 1).reshape(self.height, self.width, k * k)
        hit = np.isfinite(fine)
        count = hit.sum(axis=-1)
        total = np.where(hit, fine, 0.0).sum(axis=-1)
        return np.where(2 * count > k * k, total / np.maximum(count, 1), np.nan)


def _checked_pose(pose: np.ndarray) -> np.ndarray:
    pose = np.asarray(pose, dtype=float)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(f"pose_cam_from_target must be finite, (4, 4), got shape {pose.shape}")
    return pose


def _cast(corners: np.ndarray, u: np.ndarray, v: np.ndarray, focal_px: float) -> np.ndarray:
    """Depth z (H, W) of the nearest triangle along each ray (u, v, 1), u (W,) and v (H,); NaN where
    there is none.

    A ray d passes through triangle (a, b, c) where d.(a x b), d.(b x c) and d.(c x a) agree in
    sign, and meets it at z = a.(b x c) / their sum; this holds for triangles that reach behind the
    camera as well.
    """
    depth = np.full((len(v), len(u)), np.inf)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    sides = np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a)], axis=1)
    volume = np.einsum("ij,ij->i", a, sides[:, 1])
    low, high = _pixel_boxes(corners, (len(u), len(v)), focal_px)
    wide = np.maximum(high - low, 0)
    area = wide[:, 0] * wide[:, 1]
    area[(corners[..., 2] <= 0).all(axis=1)] = 0
    for triangle in np.flatnonzero(area >= _LARGE):
        box = tuple(slice(low[triangle, i], high[triangle, i]) for i in (1, 0))
        z = _crossings(sides[triangle], volume[triangle], u[box[1]], v[box[0], None])
        np.minimum(depth[box], z, out=depth[box])
    area[area >= _LARGE] = 0
    for chunk in _chunks(area):
        count = area[chunk]
        place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        down, across = np.divmod(place.astype(np.int32), np.repeat(wide[chunk, 0], count))
        row = np.repeat(low[chunk, 1], count) + down
        column = np.repeat(low[chunk, 0], count) + across
        side = np.repeat(sides[chunk].reshape(-1, 9).T, count, axis=1).reshape(3, 3, -1)
        z = _crossings(side, np.repeat(volume[chunk], count), u[column], v[row])
        hit = np.flatnonzero(np.isfinite(z))
        np.minimum.at(depth.reshape(-1), row[hit] * len(u) + column[hit], z[hit])
    depth[np.isinf(depth)] = np.nan
    return depth


def _crossings(
    sides: np.ndarray, volume: np.ndarray | float, x: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """Depths (...) at which rays (x, y, 1) pass through triangles; infinite where they do not.

    sides : (3, 3) or (3, 3, ...), one row the cross product of two corners.
    """
    first, second, third = (side[0] * x + side[1] * y + side[2] for side in sides)
    total = first + second + third
    least = np.minimum(np.minimum(first, second), third)
    most = np.maximum(np.maximum(first, second), third)
    hit = ((least >= 0.0) | (most <= 0.0)) & (total != 0.0)
    z = np.divide(volume, total, out=np.full(total.shape, np.inf), where=hit)
    z[z <= 0.0] = np.inf
    return z


def _pixel_boxes(
    corners: np.ndarray, size_px: tuple[int, int], focal_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """The pixels (low inclusive, high exclusive; (F, 2) column, row) that each triangle may
    cover, of a frame so wide and high.
    """
    size = np.array(size_px)
    z = corners[..., 2:]
    ahead = (z > 1e-9).all(axis=(1, 2))
    spot = corners[..., :2] / np.where(z > 1e-9, z, 1.0) * focal_px + (size - 1) / 2
    spot = np.clip(spot, -2, size + 1)
    low = np.floor(spot.min(axis=1)).astype(np.int64)
    high = np.ceil(spot.max(axis=1)).astype(np.int64) + 1
    low[~ahead], high[~ahead] = 0, size
    return np.clip(low, 0, size), np.clip(high, 0, size)


def _chunks(area: np.ndarray) -> list[np.ndarray]:
    """Indices of the triangles with work to do, in groups of bounded total work."""
    active = np.flatnonzero(area)
    if not len(active):
        return []
    group = np.cumsum(area[active]) // _PAIRS_AT_ONCE
    return np.split(active, np.flatnonzero(np.diff(group)) + 1)


def _occlude(measured: np.ndarray, fraction: float, rng: np.random.Generator) -> None:
    seen = np.argwhere(np.isfinite(measured))
    count = round(fraction * len(seen))
    if count:
        centre = seen[rng.integers(len(seen))]
        nearest = np.argsort(((seen - centre) ** 2).sum(axis=1), kind="stable")[:count]
        measured[tuple(seen[nearest].T)] = np.nan


def _add_outliers(measured: np.ndarray, fraction: float, rng: np.random.Generator) -> None:
    seen = np.argwhere(np.isfinite(measured))
    count = round(fraction * len(seen))
    if not count:
        return
    low, high = seen.min(axis=0), seen.max(axis=0) + 1
    near, far = np.nanmin(measured), np.nanmax(measured)
    spread = (near - (far - near) / 2, far + (far - near) / 2)
    on_target = seen[rng.permutation(len(seen))[: (count + 1) // 2]]
    block = measured[low[0] : high[0], low[1] : high[1]]
    empty = np.argwhere(np.isnan(block)) + low
    around = empty[rng.permutation(len(empty))[: count // 2]]
    pixels = np.concatenate([on_target, around])
    measured[tuple(pixels.T)] = rng.uniform(*spread, len(pixels))

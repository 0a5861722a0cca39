"""Surface elements of a range image: local planes, and the sharp depth edges and thin parts around
them.

In a pinhole image a plane n.p = d has inverse depth w = (n / d).(x/z, y/z, 1): linear in the
image. So a local least squares plane takes ten box filters over the whole image and no neighbour
search.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .range_image import RangeImage

# A plane is trusted down to this cosine between ray and normal; a borrowed one down to the second.
_MIN_COSINE = 0.03
_MIN_BORROWED_COSINE = 0.1
# So much of a pixel's width a surface may bend within a window and still count as flat.
_BEND_PX = 0.12
# Mean square residual of a window over the expected one, up to which it holds one plane.
_FLAT = 2.0
# What a plane borrowed from the next window may lean by on a curved surface, alike in both views.
_BORROWED_TILT_RAD = 0.08
# Standard deviation of an edge half way between two pixels.
_EDGE_PX = 0.5
_THIN_PX = 7
_FEWEST_PLACES = 8
_EDGE_REACH_PX = 4.6


def normal_noise(
    sigma_m: float, footprint_m: float, cosine: np.ndarray, tilt_rad: np.ndarray
) -> np.ndarray:
    """Standard deviation (m) along the normal of one measurement on a plane seen at ``cosine`` to
    its normal.

    Range noise shrinks with the cosine. A window that passed as flat bends little between its
    pixels; a borrowed plane (``tilt_rad`` not 0) may, the more so at a slant, where pixels lie
    wide apart.
    """
    bend = 0.05 + np.where(tilt_rad > 0, 0.008 / np.maximum(cosine, _MIN_BORROWED_COSINE) ** 2, 0.0)
    return np.hypot(sigma_m * cosine, footprint_m * bend)


@dataclass(frozen=True, eq=False)
class Surfels:
    """N observations "this point lies on this plane": ``normal . (x - point) = 0`` within
    ``sigma_m``.

    points, normals : (N, 3).  sigma_m : (N,) of one raw measurement.  weight : (N,) raw
        measurements that each stands for.
    tilt_rad : (N,) error of the normal that is not independent from view to view.
    The first ``num_planes`` come from planes; the others are bare returns where there is no plane
    (thin parts, slants too steep for the window, corners). Those have normal 0: they take over
    that of the other view's plane, with its noise.
    """

    points: np.ndarray
    normals: np.ndarray
    sigma_m: np.ndarray
    weight: np.ndarray
    tilt_rad: np.ndarray
    num_planes: int


@dataclass(frozen=True, eq=False)
class Edges:
    """E points on depth edges: sharp ones of faces, and both sides of thin parts.

    points : (E, 3).  sides : (E, 3) unit normals of the plane through the sensor and the edge,
        away from the
    surface.  sigma_m : (E,) across the edge.  fronts : (E, 3) unit normals towards the sensor,
        across the part, where it
    is thin (a line); NaN elsewhere.
    """

    points: np.ndarray
    sides: np.ndarray
    sigma_m: np.ndarray
    fronts: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, eq=False)
class SurfaceView:
    """All that the registration needs of one cloud; lengths in metres, in the view frame.

    sigma_m : range noise.  footprint_m : a pixel's width at the target.  size_m : the target's rms
        radius.
    point_map, normal_map : (H W, 3) point and normal (towards the sensor) of the local plane at
        each pixel.
    plane : (H W) bool, where there is one.  tilt_rad : (H W) of its normal, see Surfels;
        normal_noise_rad : of all.  nearest : (H W) index of the nearest pixel with a plane.
    surfels, edges : what is registered.
    depth_map : (H W) depth of the return, 0 where there is none.
    gap_px : (H W) distance to the nearest return or unknown pixel.
    """

    image: RangeImage
    sigma_m: float
    footprint_m: float
    size_m: float
    point_map: np.ndarray
    normal_map: np.ndarray
    plane: np.ndarray
    tilt_rad: np.ndarray
    normal_noise_rad: float
    nearest: np.ndarray
    depth_map: np.ndarray
    gap_px: np.ndarray
    surfels: Surfels
    edges: Edges

    @property
    def coplanar(self) -> bool:
        """Whether nearly all returns lie on one plane, within noise."""
        points = self.sample(1000)[0].astype(float)
        # Of returns on one line the plane is arbitrary, and some of all planes leave noise outside.
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1]
        if spread / np.sqrt(len(points)) < self.footprint_m + 4 * self.sigma_m:
            return True
        close = np.ones(len(points), bool)
        for _ in range(3):
            centre = points[close].mean(axis=0)
            normal = np.linalg.svd(points[close] - centre, full_matrices=False)[2][2]
            off = np.abs((points - centre) @ normal)
            # The better half decides, so that speckle and a few odd returns do not tilt the plane.
            close = off <= np.median(off)
        return bool(np.mean(off < 4 * self.sigma_m + 0.1 * self.footprint_m) > 0.97)

    def sample(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points and normals (up to about ``count``, 3) float32 spread evenly over all returns; no
        plane: normal 0."""
        seen = np.flatnonzero(self.depth_map)
        index = seen[:: max(1, round(len(seen) / count))]
        points = self.point_map[index]
        rough = np.flatnonzero(~self.plane[index])
        if len(rough):
            row, column = np.divmod(index[rough], self.image.inverse_depth.shape[1])
            depth = self.depth_map[index[rough]]
            tan_u, tan_v = self.image.tangents()
            points[rough] = np.column_stack([tan_u[column] * depth, tan_v[row] * depth, depth])
        return points, self.normal_map[index]


def surface_view(image: RangeImage, sigma_m: float | None = None) -> SurfaceView:
    """Fit planes and edges to a range image whose status is OK.

    sigma_m : range noise; None: estimated from the image.
    """
    inverse = image.inverse_depth
    seen = inverse > 0
    middle = float(np.median(inverse[seen]))
    footprint = 1 / (middle * image.focal_px)
    sigma = max(_range_noise(inverse, seen) if sigma_m is None else sigma_m, 1e-3 * footprint)
    radius = _window_radius(sigma / footprint)
    fit = _plane_fit(inverse, seen, middle, radius)
    if sigma_m is None:
        sigma = max(fit.noise_m(sigma, radius), 1e-3 * footprint)
    noise = np.float32(sigma) * inverse * inverse + inverse * np.float32(_BEND_PX / image.focal_px)
    flat = fit.flat(noise)
    own = flat.copy()
    slope_u, slope_v, level = _borrow_planes(fit, flat, seen, inverse, noise, radius)
    width = inverse.shape[1]
    at = np.flatnonzero(flat)
    tan_u, tan_v = (tangent.astype(np.float32) for tangent in image.tangents())
    x, y = tan_u[at % width], tan_v[at // width]
    focal = np.float32(image.focal_px)
    a, b, w = slope_u.ravel()[at] * focal, slope_v.ravel()[at] * focal, level.ravel()[at]
    c = w - a * x - b * y
    length = np.sqrt(a * a + b * b + c * c)
    slant = w / (length * np.sqrt(1 + x * x + y * y))
    good = slant > np.where(own.ravel()[at], _MIN_COSINE, _MIN_BORROWED_COSINE)
    at = at[good]
    plane = np.zeros(inverse.shape, bool)
    cosine = np.zeros(inverse.shape, np.float32)
    point_map = np.zeros((inverse.size, 3), np.float32)
    normal_map = np.zeros((inverse.size, 3), np.float32)
    plane.flat[at], cosine.flat[at] = True, slant[good]
    point_map[at] = (np.stack([x, y, np.ones_like(x)], axis=1) / w[:, None])[good]
    normal_map[at] = (np.stack([a, b, c], axis=1) / -length[:, None])[good]
    tilt = np.where(own, np.float32(0), np.float32(_BORROWED_TILT_RAD)).ravel()
    normal_noise_rad = sigma / footprint / _slope_gain(radius)
    row, column = np.nonzero(seen)
    depth = 1 / inverse[row, column]
    size = np.sqrt((tan_u[column] * depth).var() + (tan_v[row] * depth).var() + depth.var())
    depth_map = np.zeros(inverse.size, np.float32)
    depth_map[row * width + column] = depth
    hidden = (~(seen | image.unknown)).astype(np.uint8)
    return SurfaceView(
        image, sigma, footprint, float(size), point_map, normal_map, plane.ravel(), tilt,
        normal_noise_rad, _nearest(plane), depth_map,
        cv2.distanceTransform(hidden, cv2.DIST_L2, 3).ravel(),
        _surfels(
            image, plane, point_map, normal_map, cosine, tilt, sigma, footprint, normal_noise_rad
        ),
        _edges(image, plane, slope_u, slope_v, level, cosine, sigma, noise),
    )  # fmt: skip


def _range_noise(inverse: np.ndarray, seen: np.ndarray) -> float:
    """Standard deviation (m) from second differences along the rows, which planes do not have."""
    three = seen[:, :-2] & seen[:, 1:-1] & seen[:, 2:]
    bend = np.abs(inverse[:, :-2] - 2 * inverse[:, 1:-1] + inverse[:, 2:])[three]
    if not bend.size:
        return 0.0
    # The lower quarter, as edges and thin parts bend as well: 0.319 standard deviations of a
    # normal distribution.
    return float(np.quantile(bend / inverse[:, 1:-1][three] ** 2, 0.25)) / (0.3186 * np.sqrt(6))


def _window_radius(noise_px: float) -> int:
    """Smallest window (2 r + 1 wide) whose normals are good to some 3 deg; noise in pixel
    widths."""
    for radius in (2, 3, 4, 5):
        if noise_px < 0.065 * _slope_gain(radius):
            return radius
    return 6


def _slope_gain(radius: int) -> float:
    """By how much a window's slope (depth a pixel) is better known than one depth."""
    return float((2 * radius + 1) * np.sqrt(radius * (radius + 1) / 3))


@dataclass(frozen=True, eq=False)
class _PlaneFit:
    """Windowed least squares at every pixel: level, slopes a pixel, mean square residual, returns
    used, where defined."""

    level: np.ndarray
    slope_u: np.ndarray
    slope_v: np.ndarray
    mean_square: np.ndarray
    count: np.ndarray
    defined: np.ndarray

    def noise_m(self, guess_m: float, radius: int) -> float:
        """Range noise from the flattest windows; ``guess_m`` where they are few or it is the
        lower."""
        dof = (2 * radius + 1) ** 2 - 3
        full = self.defined & (self.count > dof)
        if np.count_nonzero(full) < 50:
            return guess_m
        # Of chi squared per degree of freedom a tenth lies below this (Wilson and Hilferty).
        tenth = (1 - 2 / (9 * dof) - 1.2816 * np.sqrt(2 / (9 * dof))) ** 3
        square = self.mean_square[full] / self.level[full] ** 4
        return min(guess_m, float(np.sqrt(np.quantile(square, 0.1) / tenth)))

    def flat(self, noise: np.ndarray) -> np.ndarray:
        return self.defined & (self.mean_square < _FLAT * noise * noise)


def _plane_fit(inverse: np.ndarray, seen: np.ndarray, middle: float, radius: int) -> _PlaneFit:
    mask = seen.astype(np.float32)
    # About the middle, so that single precision does for the squares.
    w = (inverse - np.float32(middle)) * mask
    one = np.ones(2 * radius + 1, np.float32)
    ramp = np.arange(-radius, radius + 1, dtype=np.float32)

    def box(image: np.ndarray, kernel_u: np.ndarray, kernel_v: np.ndarray) -> np.ndarray:
        return cv2.sepFilter2D(
            image, cv2.CV_32F, kernel_u, kernel_v, borderType=cv2.BORDER_CONSTANT
        )

    n = box(mask, one, one)
    count = np.maximum(n, 1)
    mean_u, mean_v = box(mask, ramp, one) / count, box(mask, one, ramp) / count
    mean_w = box(w, one, one) / count
    uu = box(mask, ramp * ramp, one) - n * mean_u * mean_u
    vv = box(mask, one, ramp * ramp) - n * mean_v * mean_v
    uv = box(mask, ramp, ramp) - n * mean_u * mean_v
    uw = box(w, ramp, one) - n * mean_u * mean_w
    vw = box(w, one, ramp) - n * mean_v * mean_w
    ww = box(w * w, one, one) - n * mean_w * mean_w
    full = (2 * radius + 1) ** 2
    det = uu * vv - uv * uv
    spread = full * radius * (radius + 1) / 3
    defined = seen & (n >= 0.45 * full) & (det > 0.02 * spread * spread)
    det[~defined] = 1
    slope_u, slope_v = (vv * uw - uv * vw) / det, (uu * vw - uv * uw) / det
    rest = np.maximum(ww - slope_u * uw - slope_v * vw, 0)
    level = mean_w - slope_u * mean_u - slope_v * mean_v + np.float32(middle)
    defined &= level > 0.2 * middle
    return _PlaneFit(level, slope_u, slope_v, rest / np.maximum(n - 3, 1), n, defined)


def _borrow_planes(
    fit: _PlaneFit,
    flat: np.ndarray,
    seen: np.ndarray,
    inverse: np.ndarray,
    noise: np.ndarray,
    radius: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slopes and level everywhere; where a window straddles an edge, of a window beside it that
    does not.

    Marks the pixels that found one in ``flat``.
    """
    slope_u, slope_v, level = fit.slope_u.copy(), fit.slope_v.copy(), fit.level.copy()
    height, width = flat.shape
    row, column = np.nonzero(seen & ~flat)
    if not len(row):
        return slope_u, slope_v, level
    shifts = np.array(
        [(r, c) for r in (-radius, 0, radius) for c in (-radius, 0, radius) if r or c]
    )
    there_row = np.clip(row[:, None] + shifts[:, 0], 0, height - 1)
    there_column = np.clip(column[:, None] + shifts[:, 1], 0, width - 1)
    there = there_row * width + there_column
    guess = (
        fit.level.ravel()[there]
        + fit.slope_u.ravel()[there] * (column[:, None] - there_column)
        + fit.slope_v.ravel()[there] * (row[:, None] - there_row)
    )
    off = (guess - inverse[row, column][:, None]) / noise[row, column][:, None]
    off[~flat.ravel()[there] | (guess <= 0)] = np.inf
    best = np.argmin(np.abs(off), axis=1)
    pick = np.arange(len(row)), best
    good = np.abs(off[pick]) < 2.5
    row, column = row[good], column[good]
    pick = pick[0][good], best[good]
    level[row, column] = guess[pick]
    slope_u[row, column] = fit.slope_u.ravel()[there[pick]]
    slope_v[row, column] = fit.slope_v.ravel()[there[pick]]
    flat[row, column] = True
    return slope_u, slope_v, level


def _nearest(plane: np.ndarray) -> np.ndarray:
    """(H W) index of the nearest pixel with a plane; zeros where there is none at all."""
    place = np.flatnonzero(plane)
    if not len(place):
        return np.zeros(plane.size, np.int64)
    label = cv2.distanceTransformWithLabels(
        (~plane).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )[1]
    of_label = np.zeros(int(label.max()) + 1, np.int64)
    of_label[label.ravel()[place]] = place
    return of_label[label.ravel()]


def _surfels(
    image: RangeImage,
    plane: np.ndarray,
    point_map: np.ndarray,
    normal_map: np.ndarray,
    cosine: np.ndarray,
    tilt: np.ndarray,
    sigma: float,
    footprint: float,
    normal_noise_rad: float,
) -> Surfels:
    """Planes on a lattice thin enough to keep their number moderate, and bare returns."""
    row, column = np.nonzero(plane)
    share = 1
    if len(row) > 1200:
        # Neighbours share most of their window anyway.
        keep = (row + column) % 2 == 0
        share = 2
        if len(row) > 2400:
            step = 2 * int(np.ceil(np.sqrt(len(row) / 6000)))
            keep = (row % step == 0) & (column % step == 0)
            share = step * step
        row, column = row[keep], column[keep]
    index = row * plane.shape[1] + column
    noise = normal_noise(sigma, footprint, cosine[row, column], tilt[index])
    row, column = np.nonzero((image.inverse_depth > 0) & ~plane)
    step = 1 + len(row) // 800
    row, column = row[::step], column[::step]
    tan_u, tan_v = image.tangents()
    ray = np.column_stack([tan_u[column], tan_v[row], np.ones(len(row))])
    bare = ray / image.inverse_depth[row, column, None]
    return Surfels(
        np.concatenate([point_map[index], bare]),
        np.concatenate([normal_map[index], np.zeros_like(bare)]),
        np.concatenate([noise, np.full(len(bare), sigma)]),
        # Planes of both views are matched with each other twice, once in each direction.
        np.repeat([share / 2, float(step)], [len(index), len(bare)]),
        np.concatenate([tilt[index], np.full(len(bare), normal_noise_rad)]),
        len(index),
    )


def _edges(
    image: RangeImage,
    plane: np.ndarray,
    slope_u: np.ndarray,
    slope_v: np.ndarray,
    level: np.ndarray,
    cosine: np.ndarray,
    sigma: float,
    noise: np.ndarray,
) -> Edges:
    """Places between a surface's last pixel and what lies behind it, gathered into short lines.

    The round limb of a curved body is no edge of it (it moves over the surface as the body turns),
    so only flat pixels count, and those of parts a few pixels thin.
    """
    inverse = image.inverse_depth.ravel()
    width = image.inverse_depth.shape[1]
    # The image has an empty margin, so that every return has neighbours.
    here = np.flatnonzero(inverse)
    w, flat = inverse[here], plane.ravel()[here]
    u, v = slope_u.ravel()[here], slope_v.ravel()[here]
    expected = np.where(flat, level.ravel()[here], w)
    u, v = np.where(flat, u, 0), np.where(flat, v, 0)
    drop = 4 * noise.ravel()[here] + 1.5 * w / image.focal_px
    sharp = flat & (cosine.ravel()[here] > 0.25)
    unknown = image.unknown.ravel()
    found = []
    for du, dv in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        step = dv * width + du
        half = 0.5 * (u * du + v * dv)
        open_ = (inverse[here + step] < expected + 2 * half - drop) & ~unknown[here + step]
        k = np.flatnonzero(open_)
        thin = np.zeros(len(k), bool)
        for back in range(1, _THIN_PX + 1):
            thin |= inverse[here[k] - back * step] < w[k] - drop[k]
        k = k[sharp[k] | thin]
        row, column = np.divmod(here[k], width)
        spot = np.column_stack([column + 0.5 * du, row + 0.5 * dv])
        out = np.broadcast_to(np.array([du, dv], float), spot.shape)
        found.append((spot, out, np.where(sharp[k], expected[k] + half[k], w[k]), sharp[k]))
    spot, out, w, sharp = (np.concatenate(part) for part in zip(*found, strict=True))
    return _edge_lines(image, spot, out, w.astype(float), sharp, sigma)


def _edge_lines(
    image: RangeImage,
    spot: np.ndarray,
    out: np.ndarray,
    w: np.ndarray,
    flat: np.ndarray,
    sigma: float,
) -> Edges:
    """Fit a short straight line through each edge place and its neighbours on the same edge."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  heavy to import, and only used here

    size = len(spot)
    if size < _FEWEST_PLACES:
        none = np.empty((0, 3))
        return Edges(none, none, np.empty(0), none)
    i, j = cKDTree(spot).query_pairs(_EDGE_REACH_PX, output_type="ndarray").T
    reach = 6 * sigma * w * w + 3 * w / image.focal_px
    dw = w[j] - w[i]
    same = (np.abs(dw) < reach[i]) & ((out[i] * out[j]).sum(axis=1) > -0.5)
    i, j, dw = i[same], j[same], dw[same]
    x, y = (spot[j] - spot[i]).T

    def even(value: np.ndarray) -> np.ndarray:
        """Mean over each place and its neighbours of what both of a pair have alike; 0 of
        itself."""
        return (np.bincount(i, value, size) + np.bincount(j, value, size)) / n

    def odd(value: np.ndarray) -> np.ndarray:
        return (np.bincount(i, value, size) - np.bincount(j, value, size)) / n

    n = 1.0 + np.bincount(i, minlength=size) + np.bincount(j, minlength=size)
    mean_u, mean_v, mean_w = odd(x), odd(y), odd(dw)
    xx, yy = even(x * x) - mean_u * mean_u, even(y * y) - mean_v * mean_v
    xy = even(x * y) - mean_u * mean_v
    xw, yw = even(x * dw) - mean_u * mean_w, even(y * dw) - mean_v * mean_w
    out_u, out_v = (
        (o + np.bincount(i, o[j], size) + np.bincount(j, o[i], size)) / n for o in out.T
    )
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    spread = np.hypot((xx - yy) / 2, xy)
    wide, long = (xx + yy) / 2 - spread, (xx + yy) / 2 + spread
    turn = across[:, 0] * out_u + across[:, 1] * out_v
    across *= np.sign(turn)[:, None]
    good = (n >= 5) & (wide < 0.25) & (long > 1.0) & (np.abs(turn) > 0.3)
    # The place on the line, and inverse depth along it.
    slope = (along[:, 0] * xw + along[:, 1] * yw) / np.maximum(long, 1e-9)
    on_line = spot + across * (mean_u * across[:, 0] + mean_v * across[:, 1])[:, None]
    level = w + mean_w
    smooth = np.where(flat, w, level - slope * (mean_u * along[:, 0] + mean_v * along[:, 1]))
    good &= smooth > 0
    index = np.flatnonzero(good)
    tangent = image.origin + on_line[index] / image.focal_px
    ray = np.column_stack([tangent, np.ones(len(index))])
    smooth, slope, along, across = smooth[index], slope[index], along[index], across[index]
    side = np.column_stack([across, -np.einsum("ij,ij->i", across, tangent)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    points = ray / smooth[:, None]
    # d point / d s: the edge's direction in space.
    direction = np.column_stack([along / image.focal_px, np.zeros(len(index))])
    direction -= ray * (slope / smooth)[:, None]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    front = np.cross(side, direction)
    front *= -np.sign(np.einsum("ij,ij->i", front, ray))[:, None]
    front[flat[index]] = np.nan
    return Edges(points, side, _EDGE_PX / (smooth * image.focal_px), front)

"""Where a surface ends before what lies behind it, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes

# Standard deviation, in pixels, of the place of a face's end, and of a thin part.
EDGE_PX, THIN_EDGE_PX = 0.25, 0.5
# Standard deviation of where in its last pixel a surface ends.
WITHIN_PIXEL = 12**-0.5
# A return lies behind a face by more than this many of its noise; and by so many pixels' widths
# beyond where there is a plane as well.
OFF_PLANE, _BEHIND = 2.5, 4.0
_BEHIND_PX = 1.5
_MIN_SHARP_COSINE = 0.25
# A part up to so many pixels wide is thin; and so many without a return are a hole in a surface.
_THIN_PX, _HOLE_PX = 7, 2
# Where pixels are not the sensor's own, a scan may leave as many of them out of a surface.
_GAP_PX = 16
_MOST_PLACES = 6000
# Steps outwards, in pixels (u, v).
WAYS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])


@dataclass(frozen=True, eq=False)
class Places:
    """Half way between a surface's last pixel and the next one: that pixel (flat) and which of
    WAYS leads outwards, (P,), in the order of the ways; pixel coordinates (2, P); inverse depth,
    and how much more it is a pixel inwards, NaN where the surface is one pixel wide; whether it is
    a face's; how many pixels wide the surface is there, along the way; 0 where it is more than a
    few; whether the next pixel, which it covers in part, was cropped for what lies behind.
    """

    pixel: np.ndarray
    way: np.ndarray
    spot: np.ndarray
    inverse_depth: np.ndarray
    inwards: np.ndarray
    sharp: np.ndarray
    width_px: np.ndarray
    mixed: np.ndarray

    @property
    def thin(self) -> np.ndarray:
        """(P,) bool, whether it is but a few."""
        return self.width_px > 0


def places_of_ends(image: RangeImage, planes: Planes) -> Places:
    """Where faces and thin parts end, pixel by pixel.

    The round limb of a curved body is no edge of it (it moves over the surface as the body turns),
    so only flat pixels count, and those of parts a few pixels thin. These are told only where the
    pixels are the sensor's own: elsewhere there are pixels that nothing fell in, and what lies
    between two of them, or between two lines of a lidar, looks as thin.
    """
    inverse, unknown = image.inverse_depth.ravel(), image.unknown.ravel()
    width = image.inverse_depth.shape[1]
    found, cosine, noise = planes.found.ravel(), planes.cosine.ravel(), planes.noise.ravel()
    level, slope_u, slope_v = (m.ravel() for m in (planes.level, planes.slope_u, planes.slope_v))
    k, way = _falling_back(image, planes)
    step, (du, dv) = (WAYS @ (1, width))[way], WAYS[way].T
    q = k + step
    own, slope = level[k], du * slope_u[k] + dv * slope_v[k]
    behind = own - _BEHIND * noise[k] - np.float32(_BEHIND_PX / image.focal_px) * inverse[k]
    next_found = found[q]
    keep = ~next_found | (inverse[q] < behind + slope)
    # Speckle tells nothing, but the pixel beyond may.
    dark = np.flatnonzero(unknown[q])
    beyond = q[dark] + step[dark]
    keep[dark] &= ~unknown[beyond] & (inverse[beyond] < behind[dark] + 2 * slope[dark])
    # A small hole in a surface that goes on behind it is no end of it.
    keep &= ~_goes_on(image, planes, k, way)
    # Where the next pixel's plane comes to lie in front, both meet in a crease.
    lead = level[q] - du * slope_u[q] - dv * slope_v[q] > own
    keep &= ~(next_found & found[k] & lead)
    sharp = cosine[k] > _MIN_SHARP_COSINE
    backs = k - np.arange(1, _THIN_PX + 1)[:, None] * step
    past = inverse[k] - own + behind
    thin = image.on_grid & (inverse[backs] < past).any(axis=0)
    keep &= sharp | thin
    # Of a cloud with holes all over, a part bounds the time.
    keep = np.flatnonzero(keep)
    keep = keep[:: 1 + len(keep) // _MOST_PLACES]
    k, way, sharp = k[keep], way[keep], sharp[keep]
    # Before a small hole a surface is not thin.
    backs = k - np.arange(1, _THIN_PX + _HOLE_PX + 1)[:, None] * step[keep]
    gap = inverse.take(backs, mode="clip") < past[keep]
    other_side = np.logical_and.reduce([gap[n : n + _THIN_PX] for n in range(_HOLE_PX + 1)])
    thin = image.on_grid & other_side.any(axis=0)
    width_px = np.where(thin, 1 + other_side.argmax(axis=0), 0)
    row, column = np.divmod(k, width)
    spot = np.array([column, row]) + 0.5 * WAYS[way].T
    end = np.where(sharp, own[keep] + 0.5 * slope[keep], inverse[k]).astype(float)
    inwards = np.where(gap[0], np.nan, inverse[k - step[keep]] - inverse[k]).astype(float)
    mixed = image.mixed.ravel()[q[keep]]
    return Places(k, way, spot, end, inwards, sharp, width_px, mixed)


def _falling_back(image: RangeImage, planes: Planes) -> tuple[np.ndarray, np.ndarray]:
    """Flat pixel indices, and of `WAYS` the one (N,), where the next return does not lie on the
    plane of a pixel but behind it.
    """
    inverse, noise = image.inverse_depth.ravel(), planes.noise.ravel()
    width = image.inverse_depth.shape[1]
    slopes = planes.slope_u.ravel(), planes.slope_v.ravel()
    # A return that is on no plane may belong to a narrow face seen at a slant.
    off_plane = planes.level.ravel() - OFF_PLANE * noise
    # The image has an empty margin, so that every return has neighbours.
    margin = 2 * width + 2
    inner = slice(margin, -margin)
    starts = []
    for du, dv in WAYS.tolist():
        ahead = du + width * dv
        slope = slopes[0 if du else 1][inner]
        limit = off_plane[inner] + slope if du + dv > 0 else off_plane[inner] - slope
        beyond = inverse[margin + ahead : ahead - margin]
        starts.append(margin + np.flatnonzero(beyond < limit))
    k = np.concatenate(starts)
    way = np.repeat(np.arange(4), [len(start) for start in starts])
    # Between lines no return was to be expected.
    across = ~image.in_lines[np.abs(WAYS[way, 1])]
    return k[across], way[across]


def _goes_on(image: RangeImage, planes: Planes, k: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Whether the planes of flat pixel indices k (N,) meet returns beyond a gap that begins there.

    Where the pixels are not the sensor's own that may be one of its scan, however wide: of a
    rosette between two petals.
    """
    ahead = np.arange(2, (_HOLE_PX if image.on_grid else _GAP_PX) + 2)[:, None]
    height, width = image.inverse_depth.shape
    row, column = np.divmod(k, width)
    du, dv = WAYS[way].T
    column, row = column + ahead * du, row + ahead * dv
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    beyond = image.inverse_depth.ravel().take(row * width + column, mode="clip")
    level, slope_u, slope_v, noise = (
        each.ravel()[k] for each in (planes.level, planes.slope_u, planes.slope_v, planes.noise)
    )
    off = beyond - level - ahead * (du * slope_u + dv * slope_v)
    # Farther on a plane is known as well as its slope.
    if not image.on_grid:
        noise = np.hypot(
            noise, ahead * level * np.float32(planes.normal_noise_rad / image.focal_px)
        )
    return (inside & (np.abs(off) < OFF_PLANE * noise)).any(axis=0)

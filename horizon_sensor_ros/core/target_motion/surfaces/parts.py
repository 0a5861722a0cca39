"""Planes of thin parts: bars, struts, what stands beside another surface.

A window over them holds more than one surface. A plane is fitted to those of its returns that may
go with the middle one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.columns import column_dots
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.planes import (
    MIN_BORROWED_COSINE,
    Planes,
    normal_noise,
)

# What the normals of parts may lean by, alike in both views.
PART_TILT_RAD = 0.04
# Returns go with the middle one up to this slope (depth over width) and so many times the noise.
_STEEPEST, _OFF = 1.5, 4.0
# Residual, in units of the noise, at which a return counts half in the second fit.
_HALF = 2.5
# Fewest returns of a plane, their mean square residual at most in units of the noise, and the
# largest standard deviation of a slope (depth over width).
_FEWEST, _ROUGHEST, _MAX_SLOPE_NOISE = 8, 6.0, 0.26
# Of wider windows every second row and column does, and of more returns a part, in bounded time.
_WIDEST_PX, _MOST = 3, 4000


@dataclass(frozen=True, eq=False)
class Parts:
    """P returns without a plane of their window's, each with that of its own part of it.

    place : (P,) flat index of the pixel.  points : (P, 3) float32 returns.  normals : (P, 3)
        float32, towards the sensor.  sigma_m : (P,) of a return along the normal.
    """

    place: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    sigma_m: np.ndarray

    def __len__(self) -> int:
        return len(self.place)


def find_parts(image: RangeImage, planes: Planes) -> Parts:
    """Planes where there are none in ``planes``."""
    inverse = image.inverse_depth.ravel()
    place = np.flatnonzero((inverse > 0) & ~planes.found.ravel())
    place = place[:: 1 + len(place) // _MOST]
    place, level, slope_u, slope_v = _fit_planes(image, place, planes)
    ray = planes.points.take(place, axis=0).T * inverse[place]
    slopes = np.array([slope_u, slope_v]) * np.float32(image.focal_px)
    normal = -np.array([*slopes, level - (slopes * ray[:2]).sum(axis=0)])
    normal /= np.sqrt(column_dots(normal, normal))
    cosine = -column_dots(normal, ray) / np.sqrt(column_dots(ray, ray))
    kept = np.flatnonzero(cosine > MIN_BORROWED_COSINE)
    place = place[kept]
    tilt = np.full(len(kept), PART_TILT_RAD, np.float32)
    sigma = normal_noise(
        planes.sigma_m, planes.slant_growth, planes.footprint_m, cosine[kept], tilt,
        planes.off_px[place],
    )  # fmt: skip
    return Parts(place, planes.points.take(place, axis=0), normal.T[kept], sigma)


def _fit_planes(
    image: RangeImage, place: np.ndarray, planes: Planes
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Those of ``place`` with a plane, and its inverse depth and slopes a pixel."""
    radius = max(2, planes.radius_px - 1)
    step = 1 + (radius > _WIDEST_PX)
    ramp = np.arange(-(radius // step) * step, radius + 1, step)
    u, v = np.repeat(ramp, len(ramp)), np.tile(ramp, len(ramp))
    disc = u * u + v * v < (radius + 0.5) ** 2
    u, v = u[disc], v[disc]
    terms = np.array([np.ones(len(u)), u, v, u * u, v * v, u * v], np.float32)
    values = image.inverse_depth.ravel()
    middle = values[place]
    # Of inverse depth in units of the noise at the middle return; width of a pixel in them.
    unit = np.float32(planes.sigma_m) * middle * middle
    pixel = 1 / (np.float32(image.focal_px * planes.sigma_m) * middle)
    # The image's margin is wider than a window: no index is clipped.
    off = values.take((u + v * image.inverse_depth.shape[1])[:, None] + place, mode="clip")
    off -= middle
    off *= 1 / unit
    limit = np.float32(_STEEPEST) * np.sqrt(terms[3] + terms[4])[:, None] * pixel
    limit += np.float32(_OFF)
    weight = (np.abs(off) < limit).astype(np.float32)
    square = _square(terms, _fit(terms, weight, off), off)
    weight /= 1 + square * np.float32(1 / _HALF**2)
    plane = _fit(terms, weight, off)
    square = np.einsum("kn,kn->n", weight, _square(terms, plane, off))
    level, slope_u, slope_v, count, least = plane
    good = (count >= _FEWEST) & (square < _ROUGHEST * (count - 3)) & (np.abs(level) < _HALF)
    kept = np.flatnonzero(good & (least * (_MAX_SLOPE_NOISE * pixel) ** 2 > 1))
    unit, (level, slope_u, slope_v) = unit[kept], plane[:3, kept]
    return place[kept], middle[kept] + level * unit, slope_u * unit, slope_v * unit


def _square(terms: np.ndarray, plane: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(K, N) squared residuals."""
    rest = terms[:3].T @ plane[:3]
    rest -= off
    rest *= rest
    return rest


def _fit(terms: np.ndarray, weight: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(5, N) of weighted planes: level and slopes, sum of the weights, and the scatter of the
    returns along the direction in which they spread least.

    terms : (6, K) of the returns' places: 1, u, v, u u, v v, u v.  weight, off : (K, N).
    """
    n, u, v, uu, vv, uv = terms @ weight
    w, uw, vw = terms[:3] @ (weight * off)
    # The middle return always counts.
    u, v, w = u / n, v / n, w / n
    uu, vv, uv = uu - n * u * u, vv - n * v * v, uv - n * u * v
    uw, vw = uw - n * u * w, vw - n * v * w
    # A little more scatter than there is leaves lines defined.
    det = (uu + np.float32(0.01)) * (vv + np.float32(0.01)) - uv * uv
    slope_u, slope_v = (vv * uw - uv * vw) / det, (uu * vw - uv * uw) / det
    least = (uu + vv) / 2 - np.hypot((uu - vv) / 2, uv)
    return np.array([w - slope_u * u - slope_v * v, slope_u, slope_v, n, least])

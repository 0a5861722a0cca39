"""Relief finer than the windows of planes (crumpled foil, gravel): like noise, but the same in both
views.

At a slant its heights hide its hollows: the mean of what is seen moves outwards, with the cosine of
the slant as all ranges would if they were too short.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.alignment.consistency import project
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# By how much all ranges seem too short for each metre of relief, one sigma: over turns of 8 to 20
# deg foil was off by 0.6 times that, in the mean over its faces, and by more from face to face.
_RANGE_PER_RELIEF = 2.0
# Planes of both views within this cosine of each other, and so many pixels' widths, are one.
_SAME_NORMAL, _SAME_PX = 0.9, 3.0
_MOST, _FEWEST = 20_000, 200  # pixels that are looked at
_CLIP = 3.0  # standard deviations as which an odd return counts at most
# Relief counts beyond so many standard deviations of what noise feigns, and beyond such a share of
# a return's noise, which creases have.
_SURE, _LEAST = 6.0, 0.3


def range_error_of_relief_m(
    a: SurfaceView, b: SurfaceView, rotation: np.ndarray, translation_m: np.ndarray
) -> float:
    """Range (m) by which the relief that both views show makes all ranges seem too short, one
    sigma; 0 where none shows.

    rotation (3, 3), translation_m (3,) : the motion p_b = R p_a + t between the views.
    """
    of_a = np.flatnonzero(a.plane & (a.tilt_rad == 0.0))
    of_a = of_a[:: 1 + len(of_a) // _MOST]
    point = a.point_map.take(of_a, axis=0) @ rotation.T + translation_m
    of_b = project(b, *point.T)
    normal = a.normal_map.take(of_a, axis=0) @ rotation.T
    same = b.plane[of_b] & (b.tilt_rad[of_b] == 0.0)
    same &= np.einsum("ij,ij->i", normal, b.normal_map[of_b]) > _SAME_NORMAL
    same &= np.abs(point[:, 2] - b.point_map[of_b, 2]) < _SAME_PX * b.footprint_m
    if np.count_nonzero(same) < _FEWEST:
        return 0.0
    most_m = _CLIP * max(a.sigma_m, b.sigma_m)
    alike = _off_plane_m(a, of_a[same], most_m) * _off_plane_m(b, of_b[same], most_m)
    variance = float(alike.mean())
    feigned = float(alike.std()) / np.sqrt(len(alike))
    least = (_LEAST * min(a.sigma_m, b.sigma_m)) ** 2
    if variance <= max(_SURE * feigned, least):
        return 0.0
    return _RANGE_PER_RELIEF * float(np.sqrt(variance - least))


def _off_plane_m(view: SurfaceView, pixel: np.ndarray, most_m: float) -> np.ndarray:
    """(N,) how far the returns in pixels lie beyond their planes, along the normals."""
    point, normal = view.point_map.take(pixel, axis=0), view.normal_map.take(pixel, axis=0)
    farther = view.depth_map[pixel] / point[:, 2] - 1.0
    return np.clip(farther * np.einsum("ij,ij->i", point, normal), -most_m, most_m)

"""Creases between two faces, both of them seen."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.edges.edges import (
    Edges,
    in_space,
    range_noise,
)
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes

_CREASE_PX = 0.35  # standard deviation of its place
# Planes of a crease: least difference of their slopes, and largest distance of where they meet
# from the pixels between which they change.
_MIN_BEND = 0.5
# And the cosine of the least angle between them: near a limb planes of windows side by side differ
# much in slope, and little in direction.
_CREASE_BEND = np.cos(np.radians(25.0))
_CREASE_REACH_PX = 1.0
_MIN_CREASE_COSINE = 0.1


def find_creases(image: RangeImage, planes: Planes) -> Edges:
    """Where two faces meet, both of them seen: the line that their planes have in common.

    Of two views that see both faces it tells nothing that the planes do not; but where the other
    view sees only one of them, this is its end.
    """
    width = planes.found.shape[1]
    found, cosine = planes.found.ravel(), planes.cosine.ravel()
    level, slope_u, slope_v = (m.ravel() for m in (planes.level, planes.slope_u, planes.slope_v))
    crossings, pixels = [], []
    for du, dv in ((1, 0), (0, 1)):
        step = dv * width + du
        slope = slope_u if du else slope_v
        # By how much each plane, carried on, lies in front of the other one at its own pixel.
        rise = level[:-step] - level[step:]
        a_leads, b_leads = rise + slope[:-step], -rise - slope[step:]
        k = np.flatnonzero((a_leads > 0) & (b_leads > 0))
        k = k[found[k] & found[k + step]]
        q, w = k + step, level[k]
        gap = 0.5 * (a_leads[k] - b_leads[k])
        bend_u, bend_v = slope_u[q] - slope_u[k], slope_v[q] - slope_v[k]
        bend = np.hypot(bend_u, bend_v)
        keep = bend * image.focal_px > _MIN_BEND * w
        keep &= (slope[k] - slope[q]) * image.focal_px > 0.5 * _MIN_BEND * w
        keep &= np.minimum(cosine[k], cosine[q]) > _MIN_CREASE_COSINE
        keep = np.flatnonzero(keep & (np.abs(gap) < _CREASE_REACH_PX * bend))
        normal = planes.normals
        turned = np.einsum("ij,ij->i", normal.take(k[keep], axis=0), normal.take(q[keep], axis=0))
        keep = keep[turned < _CREASE_BEND]
        k, gap, bend = k[keep], gap[keep], bend[keep]
        across = np.array([bend_u[keep], bend_v[keep]]) / bend
        off = across * (gap / bend) + np.array([[0.5 * du], [0.5 * dv]])
        row, column = np.divmod(k, width)
        w = w[keep] + off[0] * slope_u[k] + off[1] * slope_v[k]
        fall = across[0] * slope_v[k] - across[1] * slope_u[k]
        crossings.append(np.array([off[0] + column, off[1] + row, w, fall, *across]))
        pixels.append(k)
    place_u, place_v, w, fall, across_u, across_v = np.concatenate(crossings, axis=1)
    pixel = np.concatenate(pixels)
    along, out = np.array([-across_v, across_u]), -np.array([across_u, across_v])
    # From the first face to the second inverse depth falls the faster.
    ray, points, side, direction = in_space(
        image, np.array([place_u, place_v]), w, fall, along, out
    )
    none = np.zeros(2 * len(w))
    return Edges(
        np.concatenate([points, points], axis=1).T,
        np.concatenate([side, -side], axis=1).T,
        np.concatenate([direction, direction], axis=1).T,
        np.tile(_CREASE_PX / (w * image.focal_px), 2),
        np.tile(range_noise(planes, pixel, ray), 2).T,
        np.full((2 * len(w), 3), np.nan),
        none,
        none,
        none,
        np.ones(2 * len(w), bool),
        np.zeros(2 * len(w), np.int32),
        none,
        none,
    )

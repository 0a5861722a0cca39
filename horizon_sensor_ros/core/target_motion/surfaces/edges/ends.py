"""Ends of faces before what lies behind them, and both sides of thin parts."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.columns import column_crosses, column_dots
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.body_limb import LIMB_BEND, limb_reach_px
from horizon_sensor_ros.core.target_motion.surfaces.edges.edges import (
    Edges,
    along_ray,
    in_space,
    no_edges,
    range_noise,
)
from horizon_sensor_ros.core.target_motion.surfaces.edges.hidden_ends import may_be_hidden
from horizon_sensor_ros.core.target_motion.surfaces.edges.lines import (
    WIDEST_LINE,
    Sums,
    gather,
    widths,
)
from horizon_sensor_ros.core.target_motion.surfaces.edges.places import (
    EDGE_PX,
    OFF_PLANE,
    THIN_EDGE_PX,
    WAYS,
    WITHIN_PIXEL,
    Places,
    places_of_ends,
)
from horizon_sensor_ros.core.target_motion.surfaces.edges.runs import find_runs, mean_of_run
from horizon_sensor_ros.core.target_motion.surfaces.fading_limb import fading_limb
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes

# A plate's rim, of unknown thickness and seen at the cosine c, moves the face's end by as much as
# c pixels, all along the edge alike; so many pixels do for that as if they were independent.
_RIM_PX = 8.0
# Of a thin part that runs obliquely: along the whole of it its places are off alike.
_OBLIQUE_EDGE_PX = 1.5
_FEWEST_PLACES = 8
# Least number of places of a line, and their mean square along it, pixels^2.
_FEWEST_ON_LINE = 5
_SHORTEST_LINE = 1.0
# Returns of a thin part lie on a line to their noise and this, in pixels' widths. Their mean square
# is beyond it where it is by so many of its standard deviations.
_STRAIGHT_PX, _BY_CHANCE = 0.07, 2.0


def find_ends(image: RangeImage, planes: Planes) -> Edges:
    """Ends of faces and thin parts: a short straight line through each place where a surface ends
    and its neighbours on the same edge.
    """
    places = places_of_ends(image, planes)
    if len(places.pixel) < _FEWEST_PLACES:
        return no_edges()
    gathered, oblique, i, j = gather(image, planes, places)
    wide, long, angle = widths(gathered)
    sums = Sums(*gathered)
    along = np.array([np.cos(angle), np.sin(angle)])
    turn = along[0] * (sums.out_v / sums.n) - along[1] * (sums.out_u / sums.n)
    across = np.array([-along[1], along[0]]) * np.sign(turn)
    straight = (sums.n >= _FEWEST_ON_LINE) & (wide < WIDEST_LINE) & (long > _SHORTEST_LINE)
    k = np.flatnonzero(straight & (np.abs(turn) > 0.3))
    limb, normal = _before_end(planes, places.pixel[k], across[:, k])
    run, *off_px = find_runs(places, angle, i, j)
    limb |= _not_seen_to_end(image, planes, places, k, across[:, k], run)
    edge = ~(limb & places.sharp[k])
    k, normal = k[edge], normal[:, edge]
    sums, long, along, across = sums.take(k), long[k], along[:, k], across[:, k]
    (u, v), w, sharp = places.spot[:, k], places.inverse_depth[k], places.sharp[k]
    # The place on the line, and inverse depth along it.
    mean_u, mean_v, level = sums.u / sums.n, sums.v / sums.n, sums.w / sums.n
    slope = along[0] * (sums.uw / sums.n - mean_u * level)
    slope += along[1] * (sums.vw / sums.n - mean_v * level)
    slope /= long
    mean_u, mean_v = mean_u - u, mean_v - v
    on_line = np.array([u, v]) + across * (mean_u * across[0] + mean_v * across[1])
    smooth = level - slope * (mean_u * along[0] + mean_v * along[1])
    smooth = np.maximum(np.where(sharp, w, smooth), 1e-9)
    ray, points, side, direction = in_space(image, on_line, smooth, slope, along, across)
    front = column_crosses(side, direction)
    front *= -np.sign(column_dots(front, ray))
    depth = _scatter_m(planes, sums, smooth, slope, along, long)
    rough = np.where(sharp, 0, depth * -column_dots(front, ray))
    front[:, sharp] = np.nan
    tilt = rough * smooth * image.focal_px / np.sqrt(sums.n * long)
    shown = _rim_cosine(normal, ray, side, direction)
    # Normals are noisy, and a rim shows all along an edge or not at all.
    shown = np.maximum(np.maximum(shown, mean_of_run(run[k], shown)), 0)
    end_px = np.hypot(EDGE_PX, _RIM_PX * shown)
    edge_px = np.where(sharp, end_px, THIN_EDGE_PX)
    edge_px = np.where(oblique[k], np.maximum(edge_px, _OBLIQUE_EDGE_PX), edge_px)
    sigma = edge_px / (smooth * image.focal_px)
    noise = range_noise(planes, places.pixel[k], ray)
    # Returns of what is thin stand for themselves.
    alone = np.flatnonzero(places.thin[k] | ~sharp)
    noise[:, alone] = along_ray(ray[:, alone], planes.sigma_m)
    alike, leaning = (each[k] / (smooth * image.focal_px) for each in off_px)
    # Of a rim as thick as passes for the face's own noise.
    alike = np.hypot(alike, shown * OFF_PLANE * planes.sigma_m)
    half_width = _half_widths_px(image, planes, places, angle, run)[k] / (smooth * image.focal_px)
    creases = np.zeros(len(k), bool)
    return Edges(
        points.T, side.T, direction.T, sigma, noise.T, front.T, rough, tilt, half_width, creases,
        run[k], alike, leaning,
    )  # fmt: skip


def _not_seen_to_end(
    image: RangeImage,
    planes: Planes,
    places: Places,
    k: np.ndarray,
    across: np.ndarray,
    run: np.ndarray,
) -> np.ndarray:
    """Which of the places k (N,) are where the sensor has lost a curved surface, or what such a one
    may hide; across : (2, N). run : (P,) of all places.
    """
    pixel, way = places.pixel[k], places.way[k]
    fades = fading_limb(planes, pixel, across, run[k])
    return fades | may_be_hidden(image, planes, pixel, way, fading=bool(fades.any()))


def _scatter_m(
    planes: Planes,
    sums: Sums,
    inverse_depth: np.ndarray,
    slope: np.ndarray,
    along: np.ndarray,
    long: np.ndarray,
) -> np.ndarray:
    """(N,) scatter of the returns of lines in depth, beyond their noise.

    inverse_depth, slope : (N,) of the lines, and of that a pixel along them.  along : (2, N) their
        directions.  long : (N,) as of `widths`.
    """
    # A rim, or the end of a steep surface, shows now more, now less of what lies behind it; and
    # where an outline stays while the body turns under it, both views show the same.
    n = sums.n
    level = sums.w / n
    scatter = (sums.ww / n - level * level - slope * slope * long) * n / (n - 2)
    chance = 1 + _BY_CHANCE * np.sqrt(2 / (n - 2))
    noise2 = chance * (planes.sigma_m**2 + (_STRAIGHT_PX * planes.footprint_m) ** 2)
    # And where in its pixel a steep surface ends nobody knows: alike for all of a line along the
    # rows, which then scatters little.
    count = np.maximum(sums.wider, 1)
    fall = (sums.inwards + slope * (along[0] * sums.wider_u + along[1] * sums.wider_v)) / count
    within = np.maximum(fall * fall / inverse_depth**4 - 2 * noise2 / count, 0) * WITHIN_PIXEL**2
    return np.asarray(np.sqrt(np.maximum(scatter / inverse_depth**4 - noise2, 0) + within))


def _rim_cosine(
    normal: np.ndarray, ray: np.ndarray, side: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """(N,) how far a side at right angles to the face would be turned towards the sensor: cosine of
    the angle at which it is seen, less than 0 where it faces away.

    normal : (3, N) of the face.  ray, side, direction : (3, N) as of `in_space`.
    """
    outward = column_crosses(normal, direction)
    outward *= np.sign(column_dots(outward, side))
    return -column_dots(outward, ray) / np.sqrt(column_dots(ray, ray))


def _half_widths_px(
    image: RangeImage, planes: Planes, places: Places, angle: np.ndarray, run: np.ndarray
) -> np.ndarray:
    """(P,) half of how wide a narrow face is across each run of places at its end; 0 of others, and
    of those without a plane.

    One that most of a run is not of is none, but a corner of what is wide. And a bar shows a face
    within 45 deg of the sight: what falls back faster is a plate at a slant, which ends on its
    plane.
    """
    share = mean_of_run(run, places.thin)
    across = np.array([-np.sin(angle), np.cos(angle)])
    slopes = np.array([planes.slope_u.ravel(), planes.slope_v.ravel()])[:, places.pixel]
    facing = image.focal_px * np.abs(column_dots(across, slopes)) < places.inverse_depth
    width_px = places.width_px * np.abs(column_dots(across, WAYS[places.way].T))
    return np.where(places.sharp & facing & (share > 0.5), width_px / 2, 0.0)


def _before_end(
    planes: Planes, pixel: np.ndarray, across: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether flat pixel indices (N,) at the end of a surface, which ``across`` (2, N) leads over,
    show the limb of a curved one; and the surface's normal before its end (3, N).

    The end's plane may be that of a window some pixels inwards, so that it is held against one that
    shares no return with it. Towards a limb the surface falls back and bends away; before a rim
    that shows it comes nearer.
    """
    du, dv = np.rint(across * limb_reach_px(planes.radius_px)).astype(np.int64)
    inwards = np.clip(pixel - (dv * planes.found.shape[1] + du), 0, planes.found.size - 1)
    bend = np.einsum("ij,ij->i", planes.normals[pixel], planes.normals[inwards])
    same = planes.found.ravel()[inwards] & (bend > LIMB_BEND[1])
    rise = across[0] * planes.slope_u.ravel()[inwards] + across[1] * planes.slope_v.ravel()[inwards]
    # A rim that shows bends the windows over it.
    normal = planes.normals[np.where(same, inwards, pixel)].T.astype(float)
    return same & (bend < LIMB_BEND[0]) & (rise < 0), normal

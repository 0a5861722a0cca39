"""Edges of a range image: where a face ends before what lies behind it, thin parts, and creases
between two faces."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from horizon_sensor_ros.core.target.planes import Planes
from horizon_sensor_ros.core.target.range_image import RangeImage

# Standard deviation, in pixels, of the place of a face's end, a limb, a thin part, a crease.
_EDGE_PX, _LIMB_EDGE_PX, _THIN_EDGE_PX, _CREASE_PX = 0.25, 0.6, 0.5, 0.35
# A plate's rim, of unknown thickness and seen at the cosine c, moves the face's end by as much as
# c pixels, all along the edge alike; so many pixels do for that as if they were independent.
_RIM_PX = 8.0
# A return lies behind a face by more than this many of its noise; and by so many pixels' widths
# beyond where there is a plane as well.
_OFF_PLANE, _BEHIND = 2.5, 4.0
_BEHIND_PX = 1.5
_MIN_SHARP_COSINE = 0.25
# Within so many pixels before its limb a curved body bends by an angle with a cosine between
# these; what bends more is another face.
_LIMB_PX = 5
_LIMB_BEND = np.cos(np.radians([10.0, 55.0]))
_THIN_PX, _HOLE_PX = 7, 2
_FEWEST_PLACES, _MOST_PLACES = 8, 6000
_EDGE_REACH_PX = 4.6
# So far along both steps outwards may lie two places with different ones.
_SLANT_PX = 2.5
# Planes of a crease: least difference of their slopes, and largest distance of where they meet
# from the pixels between which they change.
_MIN_BEND = 0.5
_CREASE_REACH_PX = 1.0
_MIN_CREASE_COSINE = 0.1


@dataclass(frozen=True, eq=False)
class Edges:
    """E points on edges: ends of faces, both sides of thin parts, and creases.

    points : (E, 3).  sides : (E, 3) unit normals of the plane through the sensor and the edge,
        away from the surface.  directions : (E, 3) unit vectors along the edge.
    sigma_m : (E,) across the edge.
    fronts : (E, 3) unit normals towards the sensor, across the part, where it is thin (a line);
        NaN elsewhere.
    creases : (E,) bool, where the face meets another one that is seen as well. Each is there
        twice, as the end of either face.
    """

    points: np.ndarray
    sides: np.ndarray
    directions: np.ndarray
    sigma_m: np.ndarray
    fronts: np.ndarray
    creases: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


def find_edges(image: RangeImage, planes: Planes) -> Edges:
    """All edges of an image with its planes."""
    parts = [_ends(image, planes), _creases(image, planes)]
    return Edges(
        *(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Edges))
    )


def _none() -> Edges:
    empty = np.empty((0, 3))
    return Edges(empty, empty, empty, np.empty(0), empty, np.empty(0, bool))


@dataclass(frozen=True, eq=False)
class _Places:
    """Half way between a surface's last pixel and the next one: pixel coordinates, step outwards,
    (P, 2) each; inverse depth; whether it is a face's, and may be its limb; its normal (P, 3)."""

    spot: np.ndarray
    out: np.ndarray
    inverse_depth: np.ndarray
    sharp: np.ndarray
    limb: np.ndarray
    normal: np.ndarray


def _ends(image: RangeImage, planes: Planes) -> Edges:
    """Ends of faces and thin parts, gathered into short lines.

    The round limb of a curved body is no edge of it (it moves over the surface as the body turns),
    so only flat pixels count, and those of parts a few pixels thin.
    """
    inverse, unknown = image.inverse_depth.ravel(), image.unknown.ravel()
    width = image.inverse_depth.shape[1]
    found = planes.found.ravel()
    slope_u, slope_v = (
        np.where(planes.found, slope, 0).ravel() for slope in (planes.slope_u, planes.slope_v)
    )
    level = np.where(planes.found, planes.level, image.inverse_depth).ravel()
    noise = planes.noise.ravel()
    behind = level - _BEHIND * noise - np.float32(_BEHIND_PX / image.focal_px) * inverse
    # A return that is on no plane may belong to a narrow face seen at a slant.
    off_plane = level - _OFF_PLANE * noise
    sharp_here = found & (planes.cosine.ravel() > _MIN_SHARP_COSINE)
    # The image has an empty margin, so that every return has neighbours.
    margin = 2 * width + 2
    inner = slice(margin, -margin)
    seen = inverse[inner] > 0
    starts, ways = [], ((1, 0), (-1, 0), (0, 1), (0, -1))
    for du, dv in ways:
        step = dv * width + du
        there = slice(margin + step, step - margin)
        limit = np.where(found[there], behind[inner], off_plane[inner])
        limit += du * slope_u[inner] + dv * slope_v[inner]
        starts.append(margin + np.flatnonzero(seen & (inverse[there] < limit)))
    k = np.concatenate(starts)
    out = np.repeat(np.array(ways), [len(start) for start in starts], axis=0)
    step = out[:, 1] * width + out[:, 0]
    slope = out[:, 0] * slope_u[k] + out[:, 1] * slope_v[k]
    # Speckle tells nothing, but the pixel beyond may.
    keep = ~unknown[k + step]
    dark = np.flatnonzero(~keep)
    beyond = k[dark] + 2 * step[dark]
    keep[dark] = ~unknown[beyond] & (inverse[beyond] < behind[k[dark]] + 2 * slope[dark])
    # A small hole in a surface that goes on behind it is no end of it.
    ahead = np.arange(2, _HOLE_PX + 2)[:, None]
    on = np.abs(inverse[k + ahead * step] - level[k] - ahead * slope) < _OFF_PLANE * noise[k]
    keep &= ~on.any(axis=0)
    # Where the next pixel's plane comes to lie in front, both meet in a crease.
    q = k + step
    lead = level[q] - out[:, 0] * slope_u[q] - out[:, 1] * slope_v[q] > level[k]
    keep &= ~(found[q] & found[k] & lead)
    backs = k - np.arange(1, _THIN_PX + 1)[:, None] * step
    thin = (inverse[backs] < inverse[k] - level[k] + behind[k]).any(axis=0)
    keep &= sharp_here[k] | thin
    # Of a cloud with holes all over, a part bounds the time.
    keep = np.flatnonzero(keep)
    keep = keep[:: 1 + len(keep) // _MOST_PLACES]
    k, out, step, slope = k[keep], out[keep], step[keep], slope[keep]
    # Where the surface bends before its end, that may be a limb, which moves over the surface as
    # the body turns.
    inwards = k - _LIMB_PX * step
    cosine = np.einsum("ij,ij->i", planes.normals[k], planes.normals[inwards])
    same = found[inwards] & (cosine > _LIMB_BEND[1])
    limb = same & (cosine < _LIMB_BEND[0])
    # A rim that shows bends the windows over it.
    normal = planes.normals[np.where(same, inwards, k)].astype(float)
    sharp = sharp_here[k]
    row, column = np.divmod(k, width)
    spot = np.column_stack([column, row]) + 0.5 * out
    end = np.where(sharp, level[k] + 0.5 * slope, inverse[k]).astype(float)
    return _lines(image, planes, _Places(spot, out, end, sharp, limb, normal))


def _lines(image: RangeImage, planes: Planes, places: _Places) -> Edges:
    """Fit a short straight line through each place and its neighbours on the same edge."""
    from scipy.sparse import csr_matrix  # noqa: PLC0415  heavy to import, and only used here
    from scipy.spatial import cKDTree  # noqa: PLC0415

    spot, w = places.spot, places.inverse_depth
    size = len(spot)
    if size < _FEWEST_PLACES:
        return _none()
    i, j = cKDTree(spot).query_pairs(_EDGE_REACH_PX, output_type="ndarray").T
    (u, v), (out_u, out_v) = spot.T.copy(), places.out.T.copy()
    reach = 6 * planes.sigma_m * w * w + 3 * w / image.focal_px
    # Steps outwards of -1, 0, 1: both sides of a part point apart.
    both_u, both_v = out_u[i] + out_u[j], out_v[i] + out_v[j]
    same = (np.abs(w[j] - w[i]) < reach[i]) & (np.abs(both_u) + np.abs(both_v) > 0)
    # On slanted lines a pixel thin: not the other side.
    off = np.abs((u[j] - u[i]) * both_u + (v[j] - v[i]) * both_v)
    same &= off < np.where(np.abs(both_u * both_v) > 0, _SLANT_PX, np.inf)
    i, j = i[same], j[same]
    near = csr_matrix((np.ones(len(i)), (i, j)), shape=(size, size))
    # Sums over each place and its neighbours.
    own = np.column_stack([np.ones(size), u, v, w, u * u, v * v, u * v, u * w, v * w, out_u, out_v])
    sums = near @ own + near.T @ own + own
    n = sums[:, 0]
    mean_u, mean_v, level, xx, yy, xy, xw, yw, out_u, out_v = (sums[:, 1:] / n[:, None]).T
    xx, yy, xy = xx - mean_u * mean_u, yy - mean_v * mean_v, xy - mean_u * mean_v
    xw, yw = xw - mean_u * level, yw - mean_v * level
    mean_u, mean_v = mean_u - u, mean_v - v
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
    smooth = level - slope * (mean_u * along[:, 0] + mean_v * along[:, 1])
    smooth = np.where(places.sharp, w, smooth)
    k = np.flatnonzero(good & (smooth > 0))
    sharp, smooth = places.sharp[k], smooth[k]
    ray, points, side, direction = _in_space(
        image, on_line[k], smooth, slope[k], along[k], across[k]
    )
    front = np.cross(side, direction)
    front *= -np.sign(np.einsum("ij,ij->i", front, ray))[:, None]
    front[sharp] = np.nan
    # How far a side at right angles to the face would be turned towards the sensor.
    outward = np.cross(places.normal[k], direction)
    outward *= np.sign(np.einsum("ij,ij->i", outward, side))[:, None]
    rim = -np.einsum("ij,ij->i", outward, ray) / np.sqrt(np.einsum("ij,ij->i", ray, ray))
    edge_px = np.where(places.limb[k], _LIMB_EDGE_PX, _EDGE_PX)
    edge_px = np.where(sharp, np.hypot(edge_px, _RIM_PX * np.maximum(rim, 0)), _THIN_EDGE_PX)
    sigma = edge_px / (smooth * image.focal_px)
    return Edges(points, side, direction, sigma, front, np.zeros(len(k), bool))


def _creases(image: RangeImage, planes: Planes) -> Edges:
    """Where two faces meet, both of them seen: the line that their planes have in common.

    Of two views that see both faces it tells nothing that the planes do not; but where the other
    view sees only one of them, this is its end.
    """
    width = planes.found.shape[1]
    found = planes.found.ravel()
    level, slope_u, slope_v = (m.ravel() for m in (planes.level, planes.slope_u, planes.slope_v))
    crossings = []
    for du, dv in ((1, 0), (0, 1)):
        step = dv * width + du
        here, there = slice(None, -step), slice(step, None)
        slope = du * slope_u + dv * slope_v
        # By how much each plane, carried on, lies in front of the other one at its own pixel.
        a_leads = level[here] + slope[here] - level[there]
        b_leads = level[there] - slope[there] - level[here]
        k = np.flatnonzero(found[here] & found[there] & (a_leads > 0) & (b_leads > 0))
        w = level[k]
        k = k[(slope[k] - slope[k + step]) * image.focal_px > 0.5 * _MIN_BEND * w]
        gap = 0.5 * (a_leads[k] - b_leads[k])
        bend_u, bend_v = slope_u[k + step] - slope_u[k], slope_v[k + step] - slope_v[k]
        bend = np.hypot(bend_u, bend_v)
        cosine = np.minimum(planes.cosine.flat[k], planes.cosine.flat[k + step])
        keep = (bend * image.focal_px > _MIN_BEND * level[k]) & (cosine > _MIN_CREASE_COSINE)
        keep &= np.abs(gap) < _CREASE_REACH_PX * bend
        k, gap, bend, bend_u, bend_v = (m[keep] for m in (k, gap, bend, bend_u, bend_v))
        across = np.column_stack([bend_u, bend_v]) / bend[:, None]
        off = across * (gap / bend)[:, None]
        row, column = np.divmod(k, width)
        place = off + np.array([0.5 * du, 0.5 * dv])
        w = level[k] + place[:, 0] * slope_u[k] + place[:, 1] * slope_v[k]
        along = np.column_stack([-across[:, 1], across[:, 0]])
        fall = along[:, 0] * slope_u[k] + along[:, 1] * slope_v[k]
        # From the first face to the second inverse depth falls the faster.
        crossings.append((place + np.column_stack([column, row]), w, fall, along, -across))
    place, w, fall, along, out = (
        np.concatenate(part).astype(float) for part in zip(*crossings, strict=True)
    )
    _, points, side, direction = _in_space(image, place, w, fall, along, out)
    return Edges(
        np.concatenate([points, points]),
        np.concatenate([side, -side]),
        np.concatenate([direction, direction]),
        np.tile(_CREASE_PX / (w * image.focal_px), 2),
        np.full((2 * len(w), 3), np.nan),
        np.ones(2 * len(w), bool),
    )


def _in_space(
    image: RangeImage,
    place: np.ndarray,
    inverse_depth: np.ndarray,
    slope: np.ndarray,
    along: np.ndarray,
    across: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rays (depth 1), points, side normals and directions, (N, 3) each, of lines in the image.

    place, along, across : (N, 2) pixels.  slope : of inverse depth, a pixel along the line.
    """
    tangent = image.origin + place / image.focal_px
    ray = np.column_stack([tangent, np.ones(len(place))])
    side = np.column_stack([across, -np.einsum("ij,ij->i", across, tangent)])
    side /= np.sqrt(np.einsum("ij,ij->i", side, side))[:, None]
    # d point / d s, but for its length.
    direction = -ray * (slope / inverse_depth)[:, None]
    direction[:, :2] += along / image.focal_px
    direction /= np.sqrt(np.einsum("ij,ij->i", direction, direction))[:, None]
    return ray, ray / inverse_depth[:, None], side, direction

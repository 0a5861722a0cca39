"""Edges of a range image: where a face ends before what lies behind it, thin parts, and creases
between two faces."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from horizon_sensor_ros.core.mathematics.columns import column_crosses, column_dots
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.planes import LIMB_BEND, Planes, limb_reach_px

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# Standard deviation, in pixels, of the place of a face's end, a thin part, one that runs obliquely,
# a crease. An oblique one counts little: along the whole of it its places are off alike.
_EDGE_PX, _THIN_EDGE_PX, _OBLIQUE_EDGE_PX, _CREASE_PX = 0.25, 0.5, 1.5, 0.35
# A plate's rim, of unknown thickness and seen at the cosine c, moves the face's end by as much as
# c pixels, all along the edge alike; so many pixels do for that as if they were independent.
_RIM_PX = 8.0
# A return lies behind a face by more than this many of its noise; and by so many pixels' widths
# beyond where there is a plane as well.
_OFF_PLANE, _BEHIND = 2.5, 4.0
_BEHIND_PX = 1.5
_MIN_SHARP_COSINE = 0.25
_THIN_PX, _HOLE_PX = 7, 2
# Where pixels are not the sensor's own, a scan may leave as many of them out of a surface.
_GAP_PX = 16
_FEWEST_PLACES, _MOST_PLACES = 8, 6000
_EDGE_REACH_PX = 4.6
# So far along both steps outwards may lie two places with different ones.
_SLANT_PX = 2.5
# Least number of places of a line, and of one along an oblique thin part, which has both kinds of
# them: fewer lie between two holes as well. Their mean squares across a line at most, and along it
# at least, pixels^2.
_FEWEST_ON_LINE, _FEWEST_OBLIQUE, _WIDEST_LINE, _SHORTEST_LINE = 5, 8, 0.25, 1.0
# Returns of a thin part lie on a line to their noise and this, in pixels' widths. Their mean square
# is beyond it where it is by so many of its standard deviations.
_STRAIGHT_PX, _BY_CHANCE = 0.07, 2.0
# Standard deviation of where in its last pixel a surface ends.
_WITHIN_PIXEL = 12**-0.5
# An edge that runs along one of these lattice lines (u, v) crosses all pixels alike. All of it may
# be off by what these lie apart, in pixels; and by as much again where it is the end of rows and of
# columns, which err together and are runs of their own.
_LATTICE = np.array([(1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1)])
_LATTICE_PX = np.where(_LATTICE.all(axis=1), 2**0.5, 1.0) / np.hypot(*_LATTICE.T)
# And it may lean: without a step to the next lattice line its ends are anything up to a pixel
# apart, small slopes the likelier; this is one standard deviation of that.
_LEANING_PX = 6**-0.5
# Cosine between the lines through two places of one run.
_SAME_RUN = np.cos(np.radians(10.0))
# Planes of a crease: least difference of their slopes, and largest distance of where they meet
# from the pixels between which they change.
_MIN_BEND = 0.5
# And the cosine of the least angle between them: near a limb planes of windows side by side differ
# much in slope, and little in direction.
_CREASE_BEND = np.cos(np.radians(25.0))
_CREASE_REACH_PX = 1.0
_MIN_CREASE_COSINE = 0.1
# Steps outwards, in pixels (u, v).
_WAYS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
# Of two places with such ways: 1 where they are on the same side of a line that falls to the right,
# as up and right are, -1 of one that rises, 0 of either.
_LEAN = -np.sign(np.multiply.outer(*_WAYS.T) + np.multiply.outer(*_WAYS.T).T)


def _beside(way: int) -> np.ndarray:
    """(M, 3) steps in u and v, and of the way outwards, from a place to all those that may lie on
    one line with it; of two places the later one from the earlier one."""
    steps = []
    reach = range(-5, 6)
    for other, du, dv in product(range(way, 4), reach, reach):
        step = np.array([du, dv]) + 0.5 * (_WAYS[other] - _WAYS[way])
        both = _WAYS[other] + _WAYS[way]
        near = np.hypot(*step) <= _EDGE_REACH_PX and (other > way or (dv, du) > (0, 0))
        # On slanted lines a pixel thin: not the other side.
        if near and both.any() and (other == way or abs(step @ both) < _SLANT_PX):
            steps.append((du, dv, other - way))
    return np.array(steps)


_BESIDE = [_beside(way) for way in range(4)]


@dataclass(frozen=True, eq=False)
class Edges:
    """E points on edges: ends of faces, both sides of thin parts, and creases.

    points : (E, 3).  sides : (E, 3) unit normals of the plane through the sensor and the edge,
        away from the surface.  directions : (E, 3) unit vectors along the edge.
    sigma_m : (E,) across the edge.
    fronts : (E, 3) unit normals towards the sensor, across the part, where it is thin (a line);
        NaN elsewhere.
    rough_m : (E,) scatter of the returns about that line, along its front, beyond the noise; 0
        where there is none.  tilt_rad : (E,) error of the front that comes of it.
    half_width_m : (E,) of the narrow face that it ends; 0 where it ends none.
    creases : (E,) bool, where the face meets another one that is seen as well. Each is there
        twice, as the end of either face.
    run : (E,) number of the run of places that err together across it.  alike_m : (E,) one sigma of
        what all of a run is off by.  leaning_m : (E,) and of what it is off by as it leans, with
        its sign: a straight line through 0 in the middle of the run.  0 where there is none.
    """

    points: np.ndarray
    sides: np.ndarray
    directions: np.ndarray
    sigma_m: np.ndarray
    fronts: np.ndarray
    rough_m: np.ndarray
    tilt_rad: np.ndarray
    half_width_m: np.ndarray
    creases: np.ndarray
    run: np.ndarray
    alike_m: np.ndarray
    leaning_m: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


def find_edges(image: RangeImage, planes: Planes) -> Edges:
    """All edges of an image with its planes."""
    parts = [_ends(image, planes), _creases(image, planes)]
    whole = (np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Edges))
    return Edges(*(np.ascontiguousarray(values) for values in whole))


def _none() -> Edges:
    empty = np.empty((0, 3))
    none = np.empty(0)
    one = np.empty(0, np.int32)
    return Edges(
        empty, empty, empty, none, empty, none, none, none, np.empty(0, bool), one, none, none
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Places:
    """Half way between a surface's last pixel and the next one: that pixel (flat) and which of
    _WAYS leads outwards, (P,), in the order of the ways; pixel coordinates (2, P); inverse depth,
    and how much more it is a pixel inwards, NaN where the surface is one pixel wide; whether it is
    a face's; how many pixels wide the surface is there, along the way; 0 where it is more than a
    few."""

    pixel: np.ndarray
    way: np.ndarray
    spot: np.ndarray
    inverse_depth: np.ndarray
    inwards: np.ndarray
    sharp: np.ndarray
    width_px: np.ndarray

    @property
    def thin(self) -> np.ndarray:
        """(P,) bool, whether it is but a few."""
        return self.width_px > 0


def _ends(image: RangeImage, planes: Planes) -> Edges:
    """Ends of faces and thin parts, gathered into short lines.

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
    step, (du, dv) = (_WAYS @ (1, width))[way], _WAYS[way].T
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
    spot = np.array([column, row]) + 0.5 * _WAYS[way].T
    end = np.where(sharp, own[keep] + 0.5 * slope[keep], inverse[k]).astype(float)
    inwards = np.where(gap[0], np.nan, inverse[k - step[keep]] - inverse[k]).astype(float)
    return _lines(image, planes, _Places(k, way, spot, end, inwards, sharp, width_px))


def _falling_back(image: RangeImage, planes: Planes) -> tuple[np.ndarray, np.ndarray]:
    """Flat pixel indices, and of `_WAYS` the one (N,), where the next return does not lie on the
    plane of a pixel but behind it."""
    inverse, noise = image.inverse_depth.ravel(), planes.noise.ravel()
    width = image.inverse_depth.shape[1]
    slopes = planes.slope_u.ravel(), planes.slope_v.ravel()
    # A return that is on no plane may belong to a narrow face seen at a slant.
    off_plane = planes.level.ravel() - _OFF_PLANE * noise
    # The image has an empty margin, so that every return has neighbours.
    margin = 2 * width + 2
    inner = slice(margin, -margin)
    starts = []
    for du, dv in _WAYS.tolist():
        ahead = du + width * dv
        slope = slopes[0 if du else 1][inner]
        limit = off_plane[inner] + slope if du + dv > 0 else off_plane[inner] - slope
        beyond = inverse[margin + ahead : ahead - margin]
        starts.append(margin + np.flatnonzero(beyond < limit))
    k = np.concatenate(starts)
    way = np.repeat(np.arange(4), [len(start) for start in starts])
    # Between lines no return was to be expected.
    across = ~image.in_lines[np.abs(_WAYS[way, 1])]
    return k[across], way[across]


def _goes_on(image: RangeImage, planes: Planes, k: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Whether the planes of flat pixel indices k (N,) meet returns beyond a gap that begins there.

    Where the pixels are not the sensor's own that may be one of its scan, however wide: of a
    rosette between two petals.
    """
    ahead = np.arange(2, (_HOLE_PX if image.on_grid else _GAP_PX) + 2)[:, None]
    height, width = image.inverse_depth.shape
    row, column = np.divmod(k, width)
    du, dv = _WAYS[way].T
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
    return (inside & (np.abs(off) < _OFF_PLANE * noise)).any(axis=0)


def _neighbours(places: _Places, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Indices i, in order, and j of all places that may lie on the same line, each pair once.

    All are looked up in an image of the places for each way outwards; those of opposite ways are
    both sides of a part.
    """
    size, width = shape[0] * shape[1], shape[1]
    slot = np.full(4 * size, -1, np.int32)
    at = places.way * size + places.pixel
    slot[at] = np.arange(len(at), dtype=np.int32)
    ends = np.searchsorted(places.way, np.arange(5))
    pairs = []
    for way, beside in enumerate(_BESIDE):
        start = int(ends[way])
        there = slot[at[start : ends[way + 1], None] + beside @ (1, width, size)].ravel()
        hit = np.flatnonzero(there >= 0)
        pairs.append((start + hit // len(beside), there[hit]))
    i, j = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return i, j


def _graph(i: np.ndarray, j: np.ndarray, size: int) -> csr_matrix:
    """(size, size) matrix of ones at the pairs (i, j), i in order."""
    from scipy.sparse import csr_matrix  # noqa: PLC0415  heavy to import, and only used here

    first = np.zeros(size + 1, np.int32)
    np.cumsum(np.bincount(i, minlength=size), out=first[1:])
    return csr_matrix((np.ones(len(j)), j, first), shape=(size, size))


class _Sums(NamedTuple):
    """Sums (P,) over each place and its neighbours on the same edge.

    n : how many these are.  u, v, w and two of them : of pixels and inverse depths, and of their
        products.  out_u, out_v : of the steps outwards.
    wider : how many of them know `_Places.inwards`.  wider_u, wider_v : of the steps outwards at
        those, and inwards : of that itself.
    """

    n: np.ndarray
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    uu: np.ndarray
    vv: np.ndarray
    uv: np.ndarray
    uw: np.ndarray
    vw: np.ndarray
    out_u: np.ndarray
    out_v: np.ndarray
    ww: np.ndarray
    wider: np.ndarray
    wider_u: np.ndarray
    wider_v: np.ndarray
    inwards: np.ndarray

    def take(self, k: np.ndarray) -> _Sums:
        """Those of some of the places, by number."""
        return _Sums(*(each[k] for each in self))


def _widths(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean squares (pixels^2) across and along the lines through places, and the angle of these to
    the rows, (P,) each; sums : (16, P) as of `_Sums`."""
    n, u, v, _, uu, vv, uv = sums[:7]
    u, v = u / n, v / n
    uu, vv, uv = uu / n - u * u, vv / n - v * v, uv / n - u * v
    mean, spread = (uu + vv) / 2, np.hypot((uu - vv) / 2, uv)
    return mean - spread, mean + spread, 0.5 * np.arctan2(2 * uv, uu - vv)


def _gathered(
    image: RangeImage, planes: Planes, places: _Places
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`_Sums` (16, P); which places (P,) lie on an oblique thin part; and the neighbours, i in
    order, and j."""
    (u, v), w = places.spot, places.inverse_depth
    size = len(w)
    i, j = _neighbours(places, image.inverse_depth.shape)
    reach = 6 * planes.sigma_m * w * w + 3 * w / image.focal_px
    same = np.flatnonzero(np.abs(w[j] - w[i]) < reach[i])
    i, j = i[same], j[same]
    out_u, out_v = _WAYS[places.way].T
    wider = np.isfinite(places.inwards)
    inwards = np.where(wider, places.inwards, 0)
    own = np.column_stack(
        [np.ones(size), u, v, w, u * u, v * v, u * v, u * w, v * w, out_u, out_v, w * w,
         wider, wider * out_u, wider * out_v, inwards]
    )  # fmt: skip
    near = _graph(i, j, size)
    sums = np.ascontiguousarray((near @ own + near.T @ own + own).T)
    oblique = places.thin & (_widths(sums)[0] >= _WIDEST_LINE)
    place = np.flatnonzero(oblique)
    if len(place) >= _FEWEST_OBLIQUE:
        sums[:, place] = _of_one_side(sums[:, place], own, places.way, place, i, j)
    return sums, oblique, i, j


def _lines(image: RangeImage, planes: Planes, places: _Places) -> Edges:
    """Fit a short straight line through each place and its neighbours on the same edge."""
    if len(places.pixel) < _FEWEST_PLACES:
        return _none()
    gathered, oblique, i, j = _gathered(image, planes, places)
    wide, long, angle = _widths(gathered)
    sums = _Sums(*gathered)
    along = np.array([np.cos(angle), np.sin(angle)])
    turn = along[0] * (sums.out_v / sums.n) - along[1] * (sums.out_u / sums.n)
    across = np.array([-along[1], along[0]]) * np.sign(turn)
    straight = (sums.n >= _FEWEST_ON_LINE) & (wide < _WIDEST_LINE) & (long > _SHORTEST_LINE)
    k = np.flatnonzero(straight & (np.abs(turn) > 0.3))
    limb, normal = _before_end(planes, places.pixel[k], across[:, k])
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
    ray, points, side, direction = _in_space(image, on_line, smooth, slope, along, across)
    front = column_crosses(side, direction)
    front *= -np.sign(column_dots(front, ray))
    depth = _scatter_m(planes, sums, smooth, slope, along, long)
    rough = np.where(sharp, 0, depth * -column_dots(front, ray))
    front[:, sharp] = np.nan
    tilt = rough * smooth * image.focal_px / np.sqrt(sums.n * long)
    end_px = np.hypot(_EDGE_PX, _RIM_PX * np.maximum(_rim_cosine(normal, ray, side, direction), 0))
    edge_px = np.where(sharp, end_px, _THIN_EDGE_PX)
    edge_px = np.where(oblique[k], np.maximum(edge_px, _OBLIQUE_EDGE_PX), edge_px)
    sigma = edge_px / (smooth * image.focal_px)
    run, *off_px = _runs(places, angle, i, j)
    alike, leaning = (each[k] / (smooth * image.focal_px) for each in off_px)
    half_width = _half_widths_px(image, planes, places, angle, run)[k] / (smooth * image.focal_px)
    creases = np.zeros(len(k), bool)
    return Edges(
        points.T, side.T, direction.T, sigma, front.T, rough, tilt, half_width, creases, run[k],
        alike, leaning,
    )  # fmt: skip


def _scatter_m(
    planes: Planes,
    sums: _Sums,
    inverse_depth: np.ndarray,
    slope: np.ndarray,
    along: np.ndarray,
    long: np.ndarray,
) -> np.ndarray:
    """(N,) scatter of the returns of lines in depth, beyond their noise.

    inverse_depth, slope : (N,) of the lines, and of that a pixel along them.  along : (2, N) their
        directions.  long : (N,) as of `_widths`.
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
    within = np.maximum(fall * fall / inverse_depth**4 - 2 * noise2 / count, 0) * _WITHIN_PIXEL**2
    return np.asarray(np.sqrt(np.maximum(scatter / inverse_depth**4 - noise2, 0) + within))


def _rim_cosine(
    normal: np.ndarray, ray: np.ndarray, side: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """(N,) how far a side at right angles to the face would be turned towards the sensor: cosine of
    the angle at which it is seen, less than 0 where it faces away.

    normal : (3, N) of the face.  ray, side, direction : (3, N) as of `_in_space`.
    """
    outward = column_crosses(normal, direction)
    outward *= np.sign(column_dots(outward, side))
    return -column_dots(outward, ray) / np.sqrt(column_dots(ray, ray))


def _half_widths_px(
    image: RangeImage, planes: Planes, places: _Places, angle: np.ndarray, run: np.ndarray
) -> np.ndarray:
    """(P,) half of how wide a narrow face is across each run of places at its end; 0 of others, and
    of those without a plane.

    One that most of a run is not of is none, but a corner of what is wide. And a bar shows a face
    within 45 deg of the sight: what falls back faster is a plate at a slant, which ends on its
    plane.
    """
    share = np.bincount(run, places.thin) / np.bincount(run)
    across = np.array([-np.sin(angle), np.cos(angle)])
    slopes = np.array([planes.slope_u.ravel(), planes.slope_v.ravel()])[:, places.pixel]
    facing = image.focal_px * np.abs(column_dots(across, slopes)) < places.inverse_depth
    width_px = places.width_px * np.abs(column_dots(across, _WAYS[places.way].T))
    return np.where(places.sharp & facing & (share[run] > 0.5), width_px / 2, 0.0)


def _runs(
    places: _Places, angle: np.ndarray, i: np.ndarray, j: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which run of places with the same way outwards each is of, by how many pixels all of a run is
    off alike (one sigma), and by how many at each place as it leans, with its sign; (P,) each.

    angle : (P,) of the line through a place.  i, j : of neighbours on one edge. Where in its pixels
    an edge lies, and how it leans, shows by the steps from one row of them to the next. Along the
    rows there is none, and all of it may lie anywhere in a pixel; of S rows it is known to an S-th
    of that, and by S - 1 steps its lean to as large a part. One step may lie anywhere along it, and
    tells no more of that than none. Nor is there one along a diagonal, from one diagonal row to the
    next.
    """
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    size = len(places.way)
    same = places.way[i] == places.way[j]
    same &= np.abs(np.cos(angle[i] - angle[j])) > _SAME_RUN
    count, run = connected_components(_graph(i[same], j[same], size), directed=False)
    order = np.argsort(run, kind="stable")
    first = np.searchsorted(run[order], np.arange(count))
    row = (_LATTICE @ places.spot)[:, order]
    rows = _rows(row, first)
    apart = _LATTICE_PX[:, None]
    alike = (apart * _WITHIN_PIXEL / rows).max(axis=0)
    leaning = (apart * _LEANING_PX / np.maximum(rows - 1, 1)).max(axis=0)
    # The places' own claims, of errors that are independent, make up some of that already: of their
    # mean, and twelve times as much of the ends of a line of length 1 through them.
    edge_px = np.where(places.sharp, _EDGE_PX, _THIN_EDGE_PX)
    own = np.bincount(run, edge_px * edge_px) / np.bincount(run) ** 2
    alike = np.sqrt(np.maximum(alike * alike - own, 0))
    leaning = np.sqrt(np.maximum(leaning * leaning - 12 * own, 0))
    return run, alike[run], leaning[run] * _along_run(places.spot, angle, run)


def _rows(row: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(L, R) how many rows of pixels the places of each of R runs lie in, along each of L lattice
    lines: S where as many lie in each of S, and hardly more than one where a few of many are beside
    the rest, which noise puts there or the end of an edge.

    row : (L, P) of places in the order of their runs, of which ``first`` (R,) is each one's first.
    """
    count = np.diff(first, append=row.shape[1])
    least = np.minimum.reduceat(row, first, axis=1)
    span = np.maximum.reduceat(row, first, axis=1) - least + 1
    start = (np.cumsum(span) - span.ravel()).reshape(span.shape)
    there = np.bincount((row + np.repeat(start - least, count, axis=1)).astype(int).ravel())
    squares = np.add.reduceat(there * there, start.astype(int).ravel())
    return count * count / squares.reshape(span.shape)


def _along_run(spot: np.ndarray, angle: np.ndarray, run: np.ndarray) -> np.ndarray:
    """(P,) how far each place (2, P) is from the middle of its run along it, in lengths of the run:
    -.5 to .5 where places lie evenly."""
    count = np.bincount(run)

    def mean(values: np.ndarray) -> np.ndarray:
        return (np.bincount(run, values) / count)[run]

    heading = np.arctan2(mean(np.sin(2 * angle)), mean(np.cos(2 * angle))) / 2
    u, v = (each - mean(each) for each in spot)
    along = np.cos(heading) * u + np.sin(heading) * v
    return along / np.sqrt(np.maximum(12 * mean(along * along), 1.0))


def _of_one_side(
    sums: np.ndarray,
    own: np.ndarray,
    way: np.ndarray,
    place: np.ndarray,
    i: np.ndarray,
    j: np.ndarray,
) -> np.ndarray:
    """The (16, B) sums of the places ``place`` (B,) without the neighbours that lie on the other
    side of a part, if that makes a narrower line.

    Where a part is a few pixels thin and runs obliquely, a place that differs in its way by a right
    angle may be on either side: beside the upper end of a column lies, of a part that falls to the
    right, the right end of a row on the same side, and the left end on the other one.
    """
    row = np.full(len(own), -1, np.int32)
    row[place] = np.arange(len(place))
    of, other = np.concatenate([i, j]), np.concatenate([j, i])
    some = np.flatnonzero(row[of] >= 0)
    of, other = of[some], other[some]
    lean = _LEAN[way[of], way[other]]
    narrowest, wide = sums, _widths(sums)[0]
    for falling in (-1, 1):
        odd = np.flatnonzero(lean == falling)
        at, left_out = row[of[odd]], own[other[odd]].T
        narrow = sums - [np.bincount(at, each, len(place)) for each in left_out]
        narrow_wide = _widths(narrow)[0]
        better = (narrow_wide < wide) & (narrow[0] >= _FEWEST_OBLIQUE)
        narrowest = np.where(better, narrow, narrowest)
        wide = np.where(better, narrow_wide, wide)
    return narrowest


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


def _creases(image: RangeImage, planes: Planes) -> Edges:
    """Where two faces meet, both of them seen: the line that their planes have in common.

    Of two views that see both faces it tells nothing that the planes do not; but where the other
    view sees only one of them, this is its end.
    """
    width = planes.found.shape[1]
    found, cosine = planes.found.ravel(), planes.cosine.ravel()
    level, slope_u, slope_v = (m.ravel() for m in (planes.level, planes.slope_u, planes.slope_v))
    crossings = []
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
    place_u, place_v, w, fall, across_u, across_v = np.concatenate(crossings, axis=1)
    along, out = np.array([-across_v, across_u]), -np.array([across_u, across_v])
    # From the first face to the second inverse depth falls the faster.
    _, points, side, direction = _in_space(image, np.array([place_u, place_v]), w, fall, along, out)
    none = np.zeros(2 * len(w))
    return Edges(
        np.concatenate([points, points], axis=1).T,
        np.concatenate([side, -side], axis=1).T,
        np.concatenate([direction, direction], axis=1).T,
        np.tile(_CREASE_PX / (w * image.focal_px), 2),
        np.full((2 * len(w), 3), np.nan),
        none,
        none,
        none,
        np.ones(2 * len(w), bool),
        np.zeros(2 * len(w), np.int32),
        none,
        none,
    )


def _in_space(
    image: RangeImage,
    place: np.ndarray,
    inverse_depth: np.ndarray,
    slope: np.ndarray,
    along: np.ndarray,
    across: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rays (depth 1), points, side normals and directions, (3, N) each, of lines in the image.

    place, along, across : (2, N) pixels.  slope : of inverse depth, a pixel along the line.
    """
    ray = np.ones((3, place.shape[1]))
    ray[:2] = image.origin[:, None] + place / image.focal_px
    side = np.array([across[0], across[1], -column_dots(across, ray[:2])])
    side /= np.sqrt(column_dots(side, side))
    # d point / d s, but for its length.
    direction = ray * (-slope / inverse_depth)
    direction[:2] += along / image.focal_px
    direction /= np.sqrt(column_dots(direction, direction))
    return ray, ray / inverse_depth, side, direction

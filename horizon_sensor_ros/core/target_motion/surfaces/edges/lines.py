"""Short lines through places at the ends of surfaces, by sums over their neighbours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.edges.neighbours import graph, neighbours
from horizon_sensor_ros.core.target_motion.surfaces.edges.places import WAYS, Places
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes

# Least number of places along an oblique thin part, of both kinds of them: fewer lie between two
# holes as well.
_FEWEST_OBLIQUE = 8
# Mean squares of places across a line at most, pixels^2.
WIDEST_LINE = 0.25
# Of two places, by their ways outwards: 1 where they are on the same side of a line that falls to
# the right, as up and right are, -1 of one that rises, 0 of either.
_LEAN = -np.sign(np.multiply.outer(*WAYS.T) + np.multiply.outer(*WAYS.T).T)


class Sums(NamedTuple):
    """Sums (P,) over each place and its neighbours on the same edge.

    n : how many these are.  u, v, w and two of them : of pixels and inverse depths, and of their
        products.  out_u, out_v : of the steps outwards.
    wider : how many of them know `Places.inwards`.  wider_u, wider_v : of the steps outwards at
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

    def take(self, k: np.ndarray) -> Sums:
        """Those of some of the places, by number."""
        return Sums(*(each[k] for each in self))


def widths(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean squares (pixels^2) across and along the lines through places, and the angle of these to
    the rows, (P,) each; sums : (16, P) as of `Sums`.
    """
    n, u, v, _, uu, vv, uv = sums[:7]
    u, v = u / n, v / n
    uu, vv, uv = uu / n - u * u, vv / n - v * v, uv / n - u * v
    mean, spread = (uu + vv) / 2, np.hypot((uu - vv) / 2, uv)
    return mean - spread, mean + spread, 0.5 * np.arctan2(2 * uv, uu - vv)


def gather(
    image: RangeImage, planes: Planes, places: Places
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`Sums` (16, P); which places (P,) lie on an oblique thin part; and the neighbours, i in
    order, and j.
    """
    (u, v), w = places.spot, places.inverse_depth
    size = len(w)
    i, j = neighbours(places, image.inverse_depth.shape)
    reach = 6 * planes.sigma_m * w * w + 3 * w / image.focal_px
    same = np.flatnonzero(np.abs(w[j] - w[i]) < reach[i])
    i, j = i[same], j[same]
    out_u, out_v = WAYS[places.way].T
    wider = np.isfinite(places.inwards)
    inwards = np.where(wider, places.inwards, 0)
    own = np.column_stack(
        [np.ones(size), u, v, w, u * u, v * v, u * v, u * w, v * w, out_u, out_v, w * w,
         wider, wider * out_u, wider * out_v, inwards]
    )  # fmt: skip
    near = graph(i, j, size)
    sums = np.ascontiguousarray((near @ own + near.T @ own + own).T)
    oblique = places.thin & (widths(sums)[0] >= WIDEST_LINE)
    place = np.flatnonzero(oblique)
    if len(place) >= _FEWEST_OBLIQUE:
        sums[:, place] = _of_one_side(sums[:, place], own, places.way, place, i, j)
    return sums, oblique, i, j


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
    narrowest, wide = sums, widths(sums)[0]
    for falling in (-1, 1):
        odd = np.flatnonzero(lean == falling)
        at, left_out = row[of[odd]], own[other[odd]].T
        narrow = sums - [np.bincount(at, each, len(place)) for each in left_out]
        narrow_wide = widths(narrow)[0]
        better = (narrow_wide < wide) & (narrow[0] >= _FEWEST_OBLIQUE)
        narrowest = np.where(better, narrow, narrowest)
        wide = np.where(better, narrow_wide, wide)
    return narrowest

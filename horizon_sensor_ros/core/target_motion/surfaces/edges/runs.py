"""Runs of places that lie on the pixels alike, and so err together."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.surfaces.edges.neighbours import graph
from horizon_sensor_ros.core.target_motion.surfaces.edges.places import (
    EDGE_PX,
    THIN_EDGE_PX,
    WITHIN_PIXEL,
    Places,
)

# An edge that runs along one of these lattice lines (u, v) crosses all pixels alike. All of it may
# be off by what these lie apart, in pixels; and by as much again where it is the end of rows and of
# columns, which err together and are runs of their own.
_LATTICE = np.array([(1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1)])
_LATTICE_PX = np.where(_LATTICE.all(axis=1), 2**0.5, 1.0) / np.hypot(*_LATTICE.T)
# And it may lean: without a step to the next lattice line its ends are anything up to a pixel
# apart, small slopes the likelier; this is one standard deviation of that.
_LEANING_PX = 6**-0.5
# Where pixels that mix a surface with what is behind are cropped, the end is drawn in by what it
# covers of them: by half a pixel where all of them are.
_DRAWN_IN_PX = 0.5
# Cosine between the lines through two places of one run.
_SAME_RUN = np.cos(np.radians(10.0))


def find_runs(
    places: Places, angle: np.ndarray, i: np.ndarray, j: np.ndarray
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
    count, run = connected_components(graph(i[same], j[same], size), directed=False)
    order = np.argsort(run, kind="stable")
    first = np.searchsorted(run[order], np.arange(count))
    row = (_LATTICE @ places.spot)[:, order]
    rows = _rows(row, first)
    apart = _LATTICE_PX[:, None]
    alike = (apart * WITHIN_PIXEL / rows).max(axis=0)
    leaning = (apart * _LEANING_PX / np.maximum(rows - 1, 1)).max(axis=0)
    # The places' own claims, of errors that are independent, make up some of that already: of their
    # mean, and twelve times as much of the ends of a line of length 1 through them.
    edge_px = np.where(places.sharp, EDGE_PX, THIN_EDGE_PX)
    own = np.bincount(run, edge_px * edge_px) / np.bincount(run) ** 2
    alike = np.sqrt(np.maximum(alike * alike - own, 0))
    leaning = np.sqrt(np.maximum(leaning * leaning - 12 * own, 0))
    mixed = np.bincount(run, places.mixed) / np.bincount(run)
    alike = np.hypot(alike, _DRAWN_IN_PX * np.minimum(2 * mixed, 1.0))
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
    -.5 to .5 where places lie evenly.
    """
    sine, cosine = (mean_of_run(run, each(2 * angle)) for each in (np.sin, np.cos))
    heading = np.arctan2(sine, cosine) / 2
    u, v = (each - mean_of_run(run, each) for each in spot)
    along = np.cos(heading) * u + np.sin(heading) * v
    return along / np.sqrt(np.maximum(12 * mean_of_run(run, along * along), 1.0))


def mean_of_run(run: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(P,) mean of values (P,) over the run of each place; run : (P,) its number."""
    return np.asarray((np.bincount(run, values) / np.maximum(np.bincount(run), 1))[run])

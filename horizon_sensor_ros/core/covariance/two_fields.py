"""Limbs in interlaced frames: what even and odd rows, seen one after the other, are apart by.

Where the craft turns, each field shows the limb where it was then, and a fix lies somewhere between
the two. Which field the stamp is of is not known either.
Near the limb each row is compared with the mean of its two neighbours, which are of the other
field: what is left of it there follows the gradient, with another sign from row to row. No limb
does that by itself: where it is not the same in even and odd rows it changes back and forth as it
crosses rows. Nor do a rolling shutter, whose rows move on evenly, noise of rows, nor patterns that
follow brightness and not its gradient.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.covariance.shared_error import moved_by_fields
from horizon_sensor_ros.core.fits.assessment import tangent_rows
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb_points import STRETCHES, LimbPoints, SharedError
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.parts import starts_and_sizes
from horizon_sensor_ros.core.mathematics.robust import median, robust_sigma
from horizon_sensor_ros.core.mathematics.symmetric3 import inverse

# Pixels to each side of a limb point, along the limb and across it, that are looked at.
_ALONG, _ACROSS = 8, 3
_ON_PX, _ASIDE_PX = (
    each.ravel()
    for each in np.mgrid[-_ALONG : _ALONG + 1, -_ACROSS : _ACROSS + 1].astype(np.float64)
)
# A limb that crosses fewer rows than four within these is even or odd by where it lies.
_LEAST_SLANT = 0.25
_FEWEST, _ENOUGH = 8, 24  # points
_FIELD_S = 1.0 / 50.0  # from one field to the other, at most
_LEAST_APART_PX = 0.05  # less is nothing beside what edges are off by
_SIGMAS = 5.0  # fields are apart that differ by more
# What a limb's crossing of rows leaves, one sigma: of sharp ones without fields at most 0.014 px.
_OF_CROSSING_PX = 0.004
_ROUNDS = 3


def with_two_fields(
    observations: Sequence[LimbObservation],
    images: Sequence[np.ndarray],
    nadir_base: np.ndarray,
    moves_rad_s: float | None = None,
) -> tuple[LimbObservation, ...]:
    """Return the limbs with what two fields of their frames may be moving them by.

    images : (H, W) as the cameras gave them, one per limb. nadir_base : of the limb. moves_rad_s :
    how fast that moves; None: not known. Where it is too slow for fields to differ none is asked.
    """
    apart_px = [
        fields_apart_px(seen.limb, image) if _may_differ(seen, moves_rad_s) else 0.0
        for seen, image in zip(observations, images, strict=True)
    ]
    if not any(apart_px):
        return tuple(observations)
    cones = [
        _moved_cone(seen, each_px, nadir_base) if each_px > 0.0 else None
        for seen, each_px in zip(observations, apart_px, strict=True)
    ]
    return tuple(
        _with_fields(seen, px, i, cones)
        for i, (seen, px) in enumerate(zip(observations, apart_px, strict=True))
    )


def _may_differ(seen: LimbObservation, moves_rad_s: float | None) -> bool:
    if moves_rad_s is None:
        return True
    return moves_rad_s * _FIELD_S > _LEAST_APART_PX * seen.view.camera.pixel_rad


def _with_fields(
    seen: LimbObservation, apart_px: float, number: int, cones: Sequence[np.ndarray | None]
) -> LimbObservation:
    """The limb with what fields move it by, and its cone by what is its own, not other cameras'."""
    limb = seen.limb
    shared = limb.shared.besides(SharedError(fields_px=apart_px))
    if limb.cone_errors is None:
        return LimbObservation(seen.view, replace(limb, shared=shared))
    own = [
        each if i == number else np.zeros_like(each)
        for i, each in enumerate(cones)
        if each is not None
    ]
    errors = np.concatenate([limb.cone_errors, *own], axis=1)
    return LimbObservation(seen.view, replace(limb, shared=shared, cone_errors=errors))


def _moved_cone(
    seen: LimbObservation, apart_px: float, nadir_base: np.ndarray
) -> np.ndarray | None:
    """Errors (4, K) of the cone that was fitted to a limb; None without one."""
    if seen.limb.cone_errors is None:
        return None
    basis = tangent_basis(nadir_base)
    rows = seen.rays.design_sigmas(nadir_base, basis)
    by_px = rows @ inverse(rows.T @ rows) / seen.rays.sigma_px[:, None]
    moved = moved_by_fields(apart_px, seen.rays.along_limb(nadir_base), by_px)
    return np.asarray(tangent_rows(basis).T @ moved.T)


def fields_apart_px(limb: LimbPoints, image: np.ndarray) -> float:
    """How far apart even and odd rows of an image (H, W) show a limb, RMS along it, pixels across
    it; 0 where they do not differ, or where the limb lies along the rows and does not tell.
    """
    height, width = image.shape
    margin = _ALONG + _ACROSS + 2
    px, normal = limb.px, limb.normal_px
    inside = ((px >= margin) & (px < (width - margin, height - margin))).all(axis=1)
    usable = np.flatnonzero(inside & (np.abs(normal[:, 0]) > _LEAST_SLANT))
    if len(usable) < _FEWEST:
        return 0.0
    usable = usable[:: -(-len(usable) // _ENOUGH)]
    at, weight = _apart(px[usable], normal[usable], image)
    fall = np.linspace(-1.0, 1.0, len(at))
    line = np.column_stack([np.ones_like(fall), fall])
    trusted = weight = weight / (weight + median(weight))
    for _ in range(_ROUNDS):
        of_line = line.T * trusted
        shown = line @ np.linalg.solve(of_line @ line, of_line @ at)
        off = at - shown
        scatter = robust_sigma(off) + 1e-6
        trusted = weight / (1.0 + np.square(off / (3.0 * scatter)))
    # Neighbours look at the same pixels, and what texture does to one it does to the next.
    starts, sizes = starts_and_sizes(len(off), min(STRETCHES, len(off) // 2))
    means = np.add.reduceat(off, starts) / sizes
    by_stretches = float(means.std(ddof=1)) / len(means) ** 0.5
    sigma = math.hypot(max(scatter / len(off) ** 0.5, by_stretches), _OF_CROSSING_PX)
    apart_px = float(np.sqrt(np.mean(np.square(shown))))
    return apart_px if apart_px > _SIGMAS * sigma else 0.0


def _apart(px: np.ndarray, normal: np.ndarray, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how far one field shows an edge outside of where the other does, beside each point (N, 2),
    by least squares, and the weights of that: (N,) each.
    """
    width = image.shape[1]
    here = _beside(px, normal, width)
    around = image.reshape(-1).take(here + _around(width)).astype(np.float32)
    (above_left, above, above_right), (left, gray, right), (below_left, below, below_right) = around
    other_field = 0.5 * (above + below)
    across_rows = 0.5 * (below - above)
    along_rows = 0.25 * (
        right - left + 0.5 * (above_right + below_right) - 0.5 * (above_left + below_left)
    )
    gradient = along_rows * normal[:, :1] + across_rows * normal[:, 1:]
    sign = 1 - 2 * (here // width % 2)
    weight = np.square(gradient).sum(axis=1).astype(np.float64) + 1e-6
    return (sign * (gray - other_field) * gradient).sum(axis=1) / weight, weight


@lru_cache(maxsize=8)
def _around(width: int) -> np.ndarray:
    """How many pixels farther on each neighbour of a pixel lies, and it itself: (3, 3, 1, 1), in an
    image so many pixels wide.
    """
    return np.add.outer(np.arange(-1, 2) * width, np.arange(-1, 2))[:, :, None, None]


def _beside(px: np.ndarray, normal: np.ndarray, width: int) -> np.ndarray:
    """Pixels (N, K) near the limb beside each point, by number in an image so many pixels wide."""
    # A pixel at a time along rows or columns, of which the limb crosses more.
    steep = (np.abs(normal[:, 0]) >= np.abs(normal[:, 1]))[:, None]
    larger, smaller = np.where(steep, normal, normal[:, ::-1]).T
    aside_px = _ASIDE_PX - (smaller / larger)[:, None] * _ON_PX
    columns = np.rint(px[:, :1] + np.where(steep, aside_px, _ON_PX)).astype(np.intp)
    rows = np.rint(px[:, 1:] + np.where(steep, _ON_PX, aside_px)).astype(np.intp)
    return rows * width + columns

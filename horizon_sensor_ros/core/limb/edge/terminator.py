"""Edges where not the planet ends but its light: those of a terminator that curves like a limb.

Just inside the limb brightness is that of the limb itself and what the ground gains with depth, by
Lambert's law with the root of it, ``s + g sqrt(depth)``. Along a terminator there is no s, and
brightness rises from nothing, with the root or faster. Such an edge is sharp enough to pass for a
blurred step, and lies anywhere inside of the limb. Where the Sun stands right behind the craft s is
0 all round the limb too, and an arc does not tell which of them it is; of the outline of what is
lit the terminator is half at most. Clouds farther in may look like that for a few pixels, but where
light fades ground goes on to be brighter the farther in it lies. Derived here.
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.white_level import full_scale
from horizon_sensor_ros.core.limb.edge.near_edge import DEEP_PX, beside_and_deep_unblurred
from horizon_sensor_ros.core.limb.profiles import ProfileGrid, space_mean
from horizon_sensor_ros.core.limb_points import STRETCHES, LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.parts import starts_and_sizes
from horizon_sensor_ros.core.mathematics.robust import median

# Brightness beside the edge over that farther in where half of the latter is the limb's own, by the
# law above, blurred by .5 to .6 px, and a blurred step that is fitted to it lies .3 px too far in.
_HALF = 0.81
# The darkest edge of an end of the lit arc, over what is usual along the rest of it: light that
# fades goes on to nothing, where dark ground at the end of an arc stays as dark as it is.
FADED = 1.0 / 3.0
_ALIKE = 3  # neighbouring edges whose mean is taken: noise and texture differ from one to the next
_OUTERMOST = np.array([0, 1, -2, -1])  # those of them that are at the ends of a limb
_BY_CHANCE = 2.0  # sigmas of the mean of stretches
# By the same law ground is one and a half times as bright four times as deep, and as bright where
# nothing fades: what is seen there tells one from the other.
_FARTHER = 4.0
_GOES_ON = 1.25
_WHITE = 0.9  # of full scale, beyond which brightness has no way to go on


def beside_over_deep(profiles: np.ndarray, grid: ProfileGrid) -> float:
    """How bright the planet is beside its edge, over how bright it is farther in: the most that the
    mean of stretches of limb may be, for all that clouds are brighter here and darker there.

    profiles (N, J) : across the edge. NaN where there are too few of them.
    """
    if len(profiles) < STRETCHES:
        return np.nan
    first, count = starts_and_sizes(len(profiles), STRETCHES)
    means = np.add.reduceat(profiles.T, first, axis=1, dtype=np.float64) / count
    beside, deep = beside_and_deep_unblurred(grid).T @ means - 2.0 * space_mean(profiles)
    share = beside / np.maximum(deep, 1e-9)
    mean = float(np.add.reduce(share)) / STRETCHES
    off = share - mean
    return mean + _BY_CHANCE * math.sqrt(float(off @ off) / (STRETCHES * (STRETCHES - 1)))


def fading_ends(profiles: np.ndarray, grid: ProfileGrid, step: np.ndarray) -> np.ndarray:
    """Which edges (N,), in order along a limb, lie at an end of it where light fades.

    profiles (N, J) : across them. step : (N,) gray levels from space to the planet beside each.
    None do where all fade alike: see `terminator`.
    """
    ends = np.zeros(len(profiles), dtype=bool)
    if len(profiles) < STRETCHES:
        return ends
    parts, space2 = beside_and_deep_unblurred(grid), 2.0 * space_mean(profiles)
    # Light lasts to both ends as a rule, which the outermost edges tell.
    (a, b), (c, d), (e, f), (g, h) = (profiles[_OUTERMOST] @ parts - space2).tolist()
    if a + c >= _HALF * (b + d) and e + g >= _HALF * (f + h):
        return ends
    beside, deep = (
        np.convolve(part, np.ones(_ALIKE), "same") for part in (profiles @ parts).T - space2
    )
    lasting = np.flatnonzero(beside >= _HALF * deep)
    if len(lasting) == 0:
        return ends
    usual = median(step[lasting[0] : lasting[-1] + 1])
    for end in (slice(0, lasting[0]), slice(lasting[-1] + 1, None)):
        ends[end] = step[end].min(initial=np.inf) < FADED * usual
    return ends


def terminator(
    limb: LimbPoints, view: CameraView, nadir_base: np.ndarray, gray: np.ndarray, space_level: float
) -> str:
    """Why a limb may be a terminator; empty where it is none, or was not measured for it.

    nadir_base : (3,) of the cone that it was found on. gray : (H, W) the frame, whose space is at
    space_level.
    """
    if not limb.beside_over_deep < _HALF:
        return ""
    if _farther_over_deep(limb, gray, space_level) < _GOES_ON:
        return ""
    across = view.camera.rays(limb.px) @ view.rot_base_from_cam.T @ tangent_basis(nadir_base)
    azimuth = np.sort(np.arctan2(across[:, 1], across[:, 0]))
    if np.diff(azimuth, append=azimuth[0] + 2.0 * np.pi).max() < np.pi:
        return ""
    return (
        f"a terminator, or a limb that fades like one: beside its edge the ground is "
        f"{limb.beside_over_deep:.0%} as bright as a few pixels farther in"
    )


def _farther_over_deep(limb: LimbPoints, gray: np.ndarray, space_level: float) -> float:
    """How bright the planet is `_FARTHER` times as deep as `DEEP_PX`, over how bright it is there:
    of points that see both. Infinite where these are too few, or white.
    """
    height, width = gray.shape
    deep_px = 0.5 * limb.factor * np.array(DEEP_PX).sum()
    steps = deep_px * np.array([[0.8, 1.0, 1.2], [0.8 * _FARTHER, _FARTHER, 1.2 * _FARTHER]])
    at = np.rint(limb.px[:, None, None] + steps[..., None] * limb.normal_px[:, None, None])
    column, row = np.moveaxis(at.astype(int), -1, 0)
    inside = ((column >= 0) & (column < width) & (row >= 0) & (row < height)).all(axis=(1, 2))
    if np.count_nonzero(inside) < STRETCHES:
        return np.inf
    deep, farther = gray[row[inside], column[inside]].mean(axis=(0, 2))
    if farther > _WHITE * full_scale(gray):
        return np.inf
    return float((farther - space_level) / max(deep - space_level, 1e-9))

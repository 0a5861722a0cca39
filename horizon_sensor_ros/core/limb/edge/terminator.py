"""Edges where not the planet ends but its light: those of a terminator that curves like a limb.

Just inside the limb brightness is that of the limb itself and what the ground gains with depth, by
Lambert's law with the root of it, ``s + g sqrt(depth)``. Along a terminator there is no s, and
brightness rises from nothing, with the root or faster. Such an edge is sharp enough to pass for a
blurred step, and lies anywhere inside of the limb. Where the Sun stands right behind the craft s is
0 all round the limb too, and an arc does not tell which of them it is; of the outline of what is
lit the terminator is half at most. Derived here.
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.limb.edge.model import BESIDE_PX
from horizon_sensor_ros.core.limb.profiles import ProfileGrid, space_mean
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.robust import stretches

DEEP_PX = (-6.0, -4.0)  # where the planet farther in is seen
_STRETCHES = 6
# Brightness beside the edge over that farther in where half of the latter is the limb's own, by the
# law above, blurred by .5 to .6 px, and a blurred step that is fitted to it lies .3 px too far in.
_HALF = 0.81
# Sigmas of the mean of six stretches that one in a thousand exceeds, by Student's law: with two of
# them clouds of real limbs were taken for a terminator's.
_BY_CHANCE = 5.9


def mean_at(profiles: np.ndarray, grid: ProfileGrid, part_px: tuple[float, float]) -> np.ndarray:
    """Mean brightness (N,) of profiles (N, J) in a part of them."""
    d_px = grid.d_px
    return np.asarray(profiles[:, (d_px >= part_px[0]) & (d_px <= part_px[1])].mean(axis=1))


def beside_over_deep(profiles: np.ndarray, grid: ProfileGrid) -> float:
    """How bright the planet is beside its edge, over how bright it is farther in: the most that the
    mean of stretches of limb may be, for all that clouds are brighter here and darker there.

    profiles (N, J) : across the edge. NaN where there are too few of them.
    """
    if len(profiles) < _STRETCHES:
        return np.nan
    beside, deep = (
        np.array([part.mean() for part in stretches(_unblurred(profiles, grid, where), _STRETCHES)])
        for where in (BESIDE_PX, DEEP_PX)
    )
    share = beside / np.maximum(deep, 1e-9)
    return float(share.mean() + _BY_CHANCE * share.std() / math.sqrt(_STRETCHES - 1))


def _unblurred(profiles: np.ndarray, grid: ProfileGrid, part_px: tuple[float, float]) -> np.ndarray:
    """Brightness (N,) above space in a part of profiles (N, J), and as far outside the edge: a step
    that is blurred, by whatever is alike on both sides, loses to there what it lacks here.
    """
    outside = mean_at(profiles, grid, (-part_px[1], -part_px[0]))
    return mean_at(profiles, grid, part_px) + outside - 2.0 * space_mean(profiles)


def terminator(limb: LimbPoints, view: CameraView, nadir_base: np.ndarray) -> str:
    """Why a limb may be a terminator; empty where it is none, or was not measured for it.

    nadir_base : (3,) of the cone that it was found on.
    """
    if not limb.beside_over_deep < _HALF:
        return ""
    across = view.camera.rays(limb.px) @ view.rot_base_from_cam.T @ tangent_basis(nadir_base)
    azimuth = np.sort(np.arctan2(across[:, 1], across[:, 0]))
    if np.diff(azimuth, append=azimuth[0] + 2.0 * np.pi).max() < np.pi:
        return ""
    return (
        f"a terminator, or a limb that fades like one: beside its edge the ground is "
        f"{limb.beside_over_deep:.0%} as bright as a few pixels farther in"
    )

"""Motion during the exposure: it smears a limb by as much as the limb lies across it.

A motion by m pixels adds m^2 / 12 to the square of the edge's blur along itself and nothing across,
so that the blur goes with twice the angle of the limb's normal.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.edge.raster import BLUR_SIGMA_PX

_BLUR_SIGMA_PX = 0.03  # how well a limb's blur is known beforehand
_SMEAR_SIGMA_PX = 0.3  # of what motion may add to it
_SURE = 12.0  # times its variance, the square of a smear that chance does not make


def blur_along(
    normal_px: np.ndarray,
    raster: np.ndarray,
    lacking: np.ndarray,
    information: np.ndarray,
    alone: np.ndarray,
) -> np.ndarray:
    """What an assumed blur lacks at each edge (N,), px: the same for all, what the raster makes of
    it, and what goes with the direction.

    raster : `Raster.blur`. lacking : (N,) what each edge says of it, and information : (N,) how
    well; alone : (N,) so much of that as its neighbours do not say too.
    """
    weighted = information * raster
    common, pixels = _solved(
        float(information.sum()) + _BLUR_SIGMA_PX**-2.0,
        float(weighted.sum()),
        float(weighted @ raster) + BLUR_SIGMA_PX**-2.0,
        float(information @ lacking),
        float(weighted @ lacking),
    )
    known = common + pixels * raster
    design = _twice_the_angle(normal_px)
    total = alone.sum()
    design -= (design @ alone / total)[:, None]
    # What the raster may do is no smear.
    aside = raster - raster @ alone / total
    told_aside = aside * alone
    aside_of = design @ told_aside / (told_aside @ aside + BLUR_SIGMA_PX**-2.0)
    design -= aside_of[:, None] * aside
    weighted = design * alone
    told = weighted @ (lacking - known)
    (a, b), (_, c) = (weighted @ design.T).tolist()
    before = _SMEAR_SIGMA_PX**-2.0
    smear = np.array(_solved(a + before, b, c + before, *told.tolist()))
    if smear @ told < _SURE:
        return np.asarray(known)
    return np.asarray(known + smear @ design)


def _solved(a: float, b: float, c: float, u: float, v: float) -> tuple[float, float]:
    """Solution of ``a x + b y = u, b x + c y = v``."""
    size = a * c - b * b
    return (c * u - b * v) / size, (a * v - b * u) / size


def _twice_the_angle(normal_px: np.ndarray) -> np.ndarray:
    """Cosine and sine (2, N) of twice the angle of normals (N, 2)."""
    x, y = normal_px.T
    return np.array([x * x - y * y, 2.0 * x * y])

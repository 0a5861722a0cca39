"""Motion during the exposure: it smears a limb by as much as the limb lies across it.

A motion by m pixels adds m^2 / 12 to the square of the edge's blur along itself and nothing across,
so that the blur goes with twice the angle of the limb's normal.
"""

from __future__ import annotations

import numpy as np

_BLUR_SIGMA_PX = 0.03  # how well a limb's blur is known beforehand
_SMEAR_SIGMA_PX = 0.3  # of what motion may add to it
_SURE = 12.0  # times its variance, the square of a smear that chance does not make


def blur_along(
    normal_px: np.ndarray, lacking: np.ndarray, information: np.ndarray, alone: np.ndarray
) -> np.ndarray:
    """What an assumed blur lacks at each edge (N,), px: the same for all, or with the direction.

    lacking : (N,) what each edge says of it, and information : (N,) how well; alone : (N,) so much
    of that as its neighbours do not say too.
    """
    common = float(information @ lacking) / (float(information.sum()) + _BLUR_SIGMA_PX**-2.0)
    design = _twice_the_angle(normal_px)
    design -= (design @ alone / alone.sum())[:, None]
    weighted = design * alone
    told = weighted @ (lacking - common)
    (a, b), (_, c) = (weighted @ design.T + _SMEAR_SIGMA_PX**-2.0 * np.eye(2)).tolist()
    smear = np.array([[c, -b], [-b, a]]) @ told / (a * c - b * b)
    if smear @ told < _SURE:
        return np.full(len(lacking), common)
    return np.asarray(common + smear @ design)


def _twice_the_angle(normal_px: np.ndarray) -> np.ndarray:
    """Cosine and sine (2, N) of twice the angle of normals (N, 2)."""
    x, y = normal_px.T
    return np.stack([x * x - y * y, 2.0 * x * y])

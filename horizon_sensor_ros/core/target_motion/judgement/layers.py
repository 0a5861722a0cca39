"""Does every layer of a cloud, near to far, move alike? An arm before a target, or a body behind
it, may be too little off in each place to tell there, but is off all over.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.core.target_motion.alignment.pairs import FACE, Pairs
from horizon_sensor_ros.core.target_motion.alignment.refinement import comparable, jacobian
from horizon_sensor_ros.core.target_motion.alignment.uncertainty import block_m, block_sums
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# The cloud is cut at so many depths less one, into what is nearer and what is farther.
_LAYERS = 8
# Chi square of the motion that a layer has by itself, six degrees of freedom and the largest of all
# cuts; and how far off a layer of one body may be all the same, in pixels' widths, and for each
# radian by which the sensor has come to see it from elsewhere. One of 370 pairs of single bodies
# (turns up to 30 deg, 2 to 10 mm of noise) was beyond both, and 80 % of 96 wrong motions that an
# arm in front led to.
_MOST_CHI2, _ALIKE_PX, _TURNED_PX = 22.0, 0.02, 0.2
# And over the noise, where pixels are narrower than that: none of 26 wrong motions was off by less
# (640 x 480 pixels, 5 and 10 mm), and half of what that many pixels take for layers of one body is.
_ALIKE_NOISE = 0.05
# A layer may move by some pixels' widths, in which pairs are found, one sigma.
_MOVES_PX = 3.0


@dataclass(frozen=True, eq=False)
class Layer:
    """What would fit better with a motion of its own.

    nearer : whether it is what lies nearer than ``depth_m``, else what lies farther.  off_m : how
        far it moved otherwise along its normals, RMS.
    """

    nearer: bool
    depth_m: float
    off_m: float


def layer_off(pairs: Pairs, robust: np.ndarray, a: SurfaceView, b: SurfaceView) -> Layer | None:
    """Return the layer of view b that moved, since view a, most clearly otherwise than the pairs of
    a refined motion do together, or None where all move alike.

    robust : (N,) weights of the pairs. Either side of each cut gets a small motion of its own, by
    linear least squares over its faces. Where the rest varies from place to place by more than the
    noise that is known, as on slanted faces it may, chi square counts for as much less.
    """
    # Edges lie where pixels do, alike all along a layer's, and what is behind them is as thick as
    # nobody knows.
    faces = np.flatnonzero(pairs.kind == FACE)
    if not len(faces):
        return None
    order = faces[np.argsort(pairs.point_b[2, faces])]
    weight = pairs.information(robust)[order]
    total = np.cumsum(weight)
    first = np.searchsorted(total, total[-1] * np.arange(_LAYERS) / _LAYERS)
    rows = jacobian(pairs.point_a[:, order], pairs.normal[:, order], b.image.centroid_m)
    rows *= comparable(b.size_m)[:, None]
    weighted, residual = rows * weight, pairs.residual[order]
    layers = [slice(i, j) for i, j in pairwise([*first, len(order)])]
    information = _both_sides(np.array([weighted[:, each] @ rows[:, each].T for each in layers]))
    pull = _both_sides(np.array([weighted[:, each] @ residual[each] for each in layers]))
    prior = np.eye(6) / (_MOVES_PX * b.footprint_m) ** 2
    step = np.linalg.solve(information + prior, pull[..., None])[..., 0]
    chi2 = np.einsum("ki,ki->k", step, pull)
    best = int(chi2.argmax())
    if not chi2[best] > _MOST_CHI2:
        return None
    near = best % (_LAYERS - 1)
    far, nearer, cut = near + _LAYERS - 1, best < _LAYERS - 1, first[1 + near]
    rest = residual - np.concatenate([step[near] @ rows[:, :cut], step[far] @ rows[:, cut:]])
    sums = block_sums(weighted * rest, pairs.point_b[:, order], pairs.kind[order], block_m(a, b))
    varies = np.trace(np.linalg.solve(information[near] + information[far] + prior, sums @ sums.T))
    if not chi2[best] > _MOST_CHI2 * varies / 6:
        return None
    side = slice(None, cut) if nearer else slice(cut, None)
    off = step[best] @ rows[:, side]
    off_m = float(np.sqrt(np.average(np.square(off), weights=weight[side])))
    turn_rad = float(np.linalg.norm(vector_from_rotation(pairs.rotation)))
    alike_m = (_ALIKE_PX + _TURNED_PX * turn_rad) * b.footprint_m
    if off_m < max(alike_m, _ALIKE_NOISE * max(a.sigma_m, b.sigma_m)):
        return None
    return Layer(nearer, float(pairs.point_b[2, order[cut]]), off_m)


def _both_sides(of_layers: np.ndarray) -> np.ndarray:
    """Sums of what is nearer than each cut between layers (K, ...), then of what is farther."""
    nearer = np.cumsum(of_layers, axis=0)
    return np.concatenate([nearer[:-1], nearer[-1] - nearer[:-1]])

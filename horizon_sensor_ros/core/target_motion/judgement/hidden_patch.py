"""How well views agree with motions if something hid a patch of the target in each of them.

An arm, its shadow or a dirty window leaves a hole, or takes a bite out of the outline. What one
view shows where the other one has that hole speaks against the right motion, and all of it in one
place. A wrong motion is contradicted in several.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.alignment.consistency import against
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

_SHARE = 0.12  # of the pixels of a view, hidden at most: as large as what should still be noticed
_SAMPLES, _SLACK_PX = 300, 1.0  # as rivals are seen


def scores_but_for_a_patch(
    a: SurfaceView, b: SurfaceView, rotations: np.ndarray, translations: np.ndarray
) -> np.ndarray:
    """Scores (C,) as of `view_consistency` of motions p_b = R p_a + t, (C, 3, 3) and (C, 3), each
    with the one round patch of either view left out that speaks most against it.
    """
    back = rotations.transpose(0, 2, 1)
    there = _one_way(a, b, rotations, translations)
    here = _one_way(b, a, back, -np.einsum("cij,cj->ci", back, translations))
    confirmed, contradicted = there[0] + here[0], there[1] + here[1]
    return np.asarray(confirmed / np.maximum(confirmed + contradicted, 1))


def _one_way(
    a: SurfaceView, b: SurfaceView, rotations: np.ndarray, translations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (C,) of a's points that b confirms, and contradicts outside the patch."""
    points, normals = a.sample(_SAMPLES)
    seen = against(a, b, points, normals, rotations, translations, _SLACK_PX)
    place = np.stack(np.divmod(seen.index, b.image.inverse_depth.shape[1]), axis=-1)
    radius2_px = _SHARE * b.image.num_used / np.pi
    confirmed = seen.confirmed.sum(axis=1)
    contradicted = (seen.before | seen.beside).sum(axis=1)
    missing = seen.beside & ~seen.before
    hidden = [
        _most_in_a_patch(*of_motion, radius2_px)
        for of_motion in zip(place, missing, seen.confirmed, strict=True)
    ]
    return confirmed, contradicted - np.array(hidden)


def _most_in_a_patch(
    place_px: np.ndarray, missing: np.ndarray, confirmed: np.ndarray, radius2_px: float
) -> int:
    """How many of the points (N, 2) that are missing (N,) lie in one patch about one of them: in
    the one with most of them over those that are confirmed there, as nothing is seen through it.
    """
    apart = place_px[missing][:, None] - place_px
    near = np.einsum("mni,mni->mn", apart, apart) < radius2_px
    in_patch = (near & missing).sum(axis=1)
    more = in_patch - (near & confirmed).sum(axis=1)
    best = int(np.argmax(more)) if len(more) else 0
    return int(in_patch[best]) if len(more) and more[best] > 0 else 0

"""How well views agree with motions if something hid a patch of the target in each of them.

An arm, its shadow or a dirty window leaves a hole, or takes a bite out of the outline. What one
view shows where the other one has that hole speaks against the right motion, and all of it in one
place. A wrong motion is contradicted in several.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.alignment.consistency import Against, view_consistency
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

_SHARE = 0.12  # of the pixels of a view, hidden at most: as large as what should still be noticed
_SAMPLES, _SLACK_PX = 300, 1.0  # as rivals are seen


def scores_but_for_a_patch(
    a: SurfaceView, b: SurfaceView, rotations: np.ndarray, translations: np.ndarray
) -> np.ndarray:
    """Scores (C,) as of `view_consistency` of motions p_b = R p_a + t, (C, 3, 3) and (C, 3), each
    with the one round patch of either view left out that speaks most against it.
    """
    seen = view_consistency(a, b, rotations, translations, _SAMPLES, _SLACK_PX, spared=_in_a_patch)
    return seen.score


def _in_a_patch(view: SurfaceView, seen: Against) -> np.ndarray:
    """Which points (C, N) that a view misses lie in one patch about one of them, of each motion: in
    the one with most of them over those that are confirmed there, as nothing is seen through it.
    """
    place_px = np.stack(np.divmod(seen.index, view.image.inverse_depth.shape[1]), axis=-1)
    radius2_px = _SHARE * view.image.num_used / np.pi
    missing = seen.beside & ~seen.before
    hidden = np.zeros_like(missing)
    for place, missed, confirmed, out in zip(
        place_px, missing, seen.confirmed, hidden, strict=True
    ):
        apart = place[missed][:, None] - place
        near = np.einsum("mni,mni->mn", apart, apart) < radius2_px
        more = (near & missed).sum(axis=1) - (near & confirmed).sum(axis=1)
        if more.max(initial=0) > 0:
            out[:] = near[np.argmax(more)] & missed
    return hidden

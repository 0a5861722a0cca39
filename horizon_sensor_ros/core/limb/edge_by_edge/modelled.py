"""Edges that a model places, where it holds: one by one, and kriged where they are sharp."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import PSF_LADDER_PX, EdgeLook
from horizon_sensor_ros.core.limb.edge.places import place_edges
from horizon_sensor_ros.core.limb.edge_by_edge.edges import LimbEdges, believable, there
from horizon_sensor_ros.core.limb.edge_by_edge.kriged_limb import KrigedLimb, to_be_kriged
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, scatter_px
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES, LimbSample, RefinePass
from horizon_sensor_ros.core.limb.texture.fitted_limb import fitted_limb
from horizon_sensor_ros.core.limb_points import STRETCHES, SharedError
from horizon_sensor_ros.core.mathematics.robust import median, medians

_MODEL_SHARE = 0.7  # of the edges found without a model, the least share that must follow it
_CALM, CALM_PX = 3.0, 0.2  # jumps from profile to profile: over those without a model, and at all
# Jumps of the steepest fall from which on texture moves it, and no cone that fits it is near enough
# to krige about.
_STEADY_PX = 0.05
_MOVED_PX = 0.5
# Steepest falls so steady are moved by texture up to .34 px along simulated limbs at rest; where a
# model moves some of them farther the blur is not the same along the limb, as motion makes it.
_DRIFT_PX = 0.4
# An edge as sharp as the sharpest modelled one may be sharper, and then lies beside where the model
# has it: as measured of simulated lenses without blur, so much of pixels alone.
_TOO_SHARP = SharedError(0.02, 0.05)


def modelled_edges(
    sample: LimbSample, look: EdgeLook, steepest: LimbEdges, rho_rad: float, step: RefinePass
) -> LimbEdges | None:
    """Edges placed by a model of them, and kriged where they are sharp enough for it.

    None where the model is wrong: too few edges follow it (`_MODEL_SHARE`); it makes neighbouring
    edges jump (`_CALM`); or, without glow, it moves all edges (`_MOVED_PX`), or a whole stretch of
    edges that lie steadily (`_DRIFT_PX`), away from where brightness falls most steeply.
    """
    places, good = steepest.places, steepest.good
    plain = good & ~sample.clipped
    sharp = look.glow_px == 0.0
    jumps_px = steepest.jumps_px
    kriged = KrigedLimb(sample, look, rho_rad)
    enough = np.count_nonzero(plain) >= MIN_PROFILES
    kriging = sharp and enough and to_be_kriged(look, places.step[plain])
    found = None
    if kriging and jumps_px < _STEADY_PX and not step.expected:
        found = kriged.about_prediction(good)
    if found is None:
        likely = place_edges(sample.profiles, sample.noise, look, sample.grid)
    else:
        likely = found.places
    fits = believable(likely)
    moved = median((likely.offset_px - places.offset_px)[good])
    if (
        np.count_nonzero(fits) <= _MODEL_SHARE * np.count_nonzero(good)
        or not scatter_px(likely.offset_px[fits]) < max(_CALM * jumps_px, CALM_PX)
        or (sharp and not abs(moved) < _MOVED_PX)
    ):
        return None
    if kriging and found is None:
        limb = fitted_limb(kriged.base[fits], likely.offset_px[fits], likely.sigma_px[fits])
        found = kriged.about(limb, fits, there(likely) & ~fits)
        likely = found.places
        fits = believable(likely)
    if sharp and jumps_px < _STEADY_PX and _drift_px(likely, places, good & fits) > _DRIFT_PX:
        return None
    shared, corner_blur = steepest.shared, None
    if found is not None:
        shared, corner_blur = found.shared, found.corner_blur
    return LimbEdges(
        likely,
        fits,
        model_free=False,
        shared=of_sharpness(shared, look),
        corner_blur=corner_blur,
    )


def of_sharpness(shared: SharedError, look: EdgeLook) -> SharedError:
    """Error that edges share, with that of a model which is not sharp enough for them."""
    return shared.besides(_TOO_SHARP) if look.psf_px <= PSF_LADDER_PX[0] else shared


def _drift_px(moved: EdgePlaces, places: EdgePlaces, good: np.ndarray) -> float:
    """By how much good edges (M,) are moved, in the stretch of limb where it is most; infinite
    where kriging left none.
    """
    moved_px = (moved.offset_px - places.offset_px)[good]
    if len(moved_px) == 0:
        return np.inf
    return max(map(abs, medians(moved_px, min(STRETCHES, len(moved_px)))))

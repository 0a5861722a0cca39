"""Air above the limb that no frame would show, for the covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.air import USUAL_HEIGHT, usual_length_px
from horizon_sensor_ros.core.limb.edge.looks import MOST_IN_FOCUS_PX
from horizon_sensor_ros.core.limb.haze.column import seen_from_within
from horizon_sensor_ros.core.limb.haze.limb import ABOVE_M, THINNEST_PX
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet

# Air is seen above a limb only if it fades over at least this many pixels. What is not seen may
# hide the ground: simulated air, thin to thick, raised limbs by 2 to 33 km, 6500 to 60 000 km up.
_SEEN_PX = 0.5
# Air that is not told raises edges that no model fits by this many scale heights, one sigma.
_HIGHER = 0.8
# Limbs that were not separated from the air by a joint fit. (pixels, scale heights): air that fades
# over fewer pixels than the first passes for blur, and raises the limb by the second. Simulated
# above even ground with 8 to 200 gray levels of air, 350 to 6000 km up.
_PASSES_FOR_BLUR = ((1.0, 0.25), (2.5, 0.06))
# Edges that no model fits may be those of air that fades over fewer pixels than this.
_SEEN_WITHOUT_MODEL_PX = 1.0
# One sigma of blur, pixel included. An edge sharper than this (a lens in focus) has no air above
# it; up to `MOST_IN_FOCUS_PX` there is so little air that only the last row above applies.
_SHARP_PX = 0.755
# Air that hides the ground ends as exp(-exp(-height)) does, which nowhere falls by more than 1 / e
# over a scale height, and a lens only flattens it; a step blurred by one sigma falls by
# 1 / sqrt(2 pi) over it. Edges with less blur than this are hence steeper than such air's, and the
# ground's; from there on they may be either. Scale heights, where cold air has a quarter less.
_LEAST_IN_AIR = 0.75 * math.e / math.sqrt(2.0 * math.pi)
_PIXEL_PX = 1.0 / math.sqrt(12.0)  # one sigma of a pixel's width, which is in any edge's blur
# One sigma of how high a limb lies in air that hides the ground: by colour and haze.
_ABOVE_SIGMA_M = 6e3


def hidden_air_sigma_m(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> float:
    """One sigma (m) of the limb's height that air causes which no frame shows, or which hides the
    ground; as if the air were the Earth's.

    Zero around a planet without air, and where a camera that was used is near enough, or its
    pixels are small enough, in the size in which its limb shows, to show the air: its effect is
    then in the errors of the limb's points.
    Where air, or blur that may be air, fades over too few pixels to tell whether it hides the
    ground, it may; so it may where no edge is steeper than such air's.
    """
    if not sphere.has_air:
        return 0.0
    used = [each for each in observations if each.view.name in fit.cameras]
    lengths_px = [usual_length_px(each.view, fit.rho_rad, each.limb.factor) for each in used]
    finest_px = max(lengths_px, default=0.0)
    above_m = max((each.limb.above_m for each in used), default=0.0)
    in_air = finest_px < THINNEST_PX and any(_may_be_in_air(each.limb) for each in used)
    # From within the air its scale height is many pixels: an edge that is soft is the air's, or
    # overexposed.
    in_air = in_air or (
        seen_from_within(fit.rho_rad)
        and all(_may_be_in_air(each.limb) and not each.limb.glow_separated for each in used)
    )
    in_air = in_air or _nowhere_steeper([each.limb for each in used], lengths_px)
    if finest_px < _SEEN_PX or in_air:
        above_m = max(above_m, ABOVE_M)
    if above_m > 0.0:
        # What is known of the visible limb's height counts; of another planet's it may be more.
        return math.hypot(max(above_m - sphere.limb_height_m, 0.0), _ABOVE_SIGMA_M)
    if any(each.limb.glow_separated for each in used):
        return 0.0
    higher = _passed_for_blur([each.limb for each in used], finest_px)
    return higher * USUAL_HEIGHT * sphere.radius_m


def _may_be_in_air(limb: LimbPoints) -> bool:
    """Whether a limb was separated from air, or its edges are as those in air may be."""
    return limb.glow_separated or not limb.modelled or not limb.blur_px <= MOST_IN_FOCUS_PX


def _nowhere_steeper(limbs: Sequence[LimbPoints], lengths_px: Sequence[float]) -> bool:
    """Whether edges show by their blur that they may be those of air that hides the ground, and
    none that they are the ground's.

    lengths_px : the scale height in each limb, pixels. One that was separated from the glow is the
    ground's; of edges that no model fits, or in glow, no blur is known.
    """
    if any(limb.glow_separated for limb in limbs):
        return False
    blurred = [
        limb.blur_px > max(MOST_IN_FOCUS_PX, math.hypot(_LEAST_IN_AIR * length_px, _PIXEL_PX))
        for limb, length_px in zip(limbs, lengths_px, strict=True)
        if math.isfinite(limb.blur_px)
    ]
    return bool(blurred) and all(blurred)


def _passed_for_blur(limbs: Sequence[LimbPoints], length_px: float) -> float:
    """One sigma, in scale heights, by which air that passes for blur raises these limbs.

    length_px : the scale height in the camera that resolves it best, pixels.
    """
    if not all(limb.modelled for limb in limbs) and length_px < _SEEN_WITHOUT_MODEL_PX:
        return _HIGHER
    if not any(limb.blur_px > _SHARP_PX for limb in limbs):
        return 0.0
    blurred = any(limb.blur_px > MOST_IN_FOCUS_PX for limb in limbs)
    for most_px, higher in _PASSES_FOR_BLUR if blurred else _PASSES_FOR_BLUR[-1:]:
        if length_px < most_px:
            return higher
    return 0.0

"""Air above the limb that no frame would show, for the covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.glow.air import USUAL_HEIGHT
from horizon_sensor_ros.core.limb.glow.limb import usual_length_px
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet

# Pixels over which air must fade to be seen above a limb; and by how much air that is not seen lets
# the limb seem higher, over its scale height: 0.2 to 1.5 of it in simulated frames, from 40 to 130
# gray levels of air above even ground and clouds, 6500 to 60 000 km up.
_SEEN_PX, _HIGHER = 0.5, 0.8
# Limbs that are not told apart from it: over how many pixels air fades, at most, that passes for
# blur, and by how much it then lets the limb seem higher, as measured above even ground with 8 to
# 200 gray levels of it, 350 to 6000 km up. Edges that no model fits may be its up to where it would
# fade over so much.
_PASSES_FOR_BLUR = ((0.75, 0.8), (1.0, 0.25), (2.5, 0.06))
_SEEN_WITHOUT_MODEL_PX = 1.0
# Blur of a lens in focus, and of the pixels: edges that sharp are not below air. Little more blur
# is little air's, and hides as little as air does that would fade over many pixels.
_SHARP_PX, _HARDLY_BLURRED_PX = 0.755, 0.775
_ABOVE_M = 6e3  # one sigma of how high a limb lies in air that hides the ground: by colour and haze


def hidden_air_sigma_m(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> float:
    """One sigma of the limb's height by air that may be there unseen, as if it were the Earth's, or
    that hides the ground.

    Zero where a camera that was used is near enough, or its pixels are small enough, to show it: it
    is in the limb's own errors there.
    """
    used = [each for each in observations if each.view.name in fit.cameras]
    above_m = max((each.limb.above_m for each in used), default=0.0)
    if above_m > 0.0:
        # What is known of the visible limb's height counts.
        return math.hypot(above_m - sphere.limb_height_m, _ABOVE_M)
    finest_px = max((usual_length_px(each.view, fit.rho_rad) for each in used), default=0.0)
    higher = _HIGHER if finest_px < _SEEN_PX else 0.0
    if not any(each.limb.joint for each in used):
        higher = max(higher, _passed_for_blur([each.limb for each in used], finest_px))
    return higher * USUAL_HEIGHT * sphere.radius_m


def _passed_for_blur(limbs: Sequence[LimbPoints], length_px: float) -> float:
    """One sigma of what limbs seem higher by, over the air's scale height, of which that is the
    length in pixels.
    """
    if not all(limb.modelled for limb in limbs) and length_px < _SEEN_WITHOUT_MODEL_PX:
        return _HIGHER
    if not any(limb.blur_px > _SHARP_PX for limb in limbs):
        return 0.0
    blurred = any(limb.blur_px > _HARDLY_BLURRED_PX for limb in limbs)
    for most_px, higher in _PASSES_FOR_BLUR if blurred else _PASSES_FOR_BLUR[-1:]:
        if length_px < most_px:
            return higher
    return 0.0

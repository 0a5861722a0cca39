"""Limbs by night and beside it: errors that points share there, as measured beside the truth of
simulated ones.
"""

from __future__ import annotations

import math
from dataclasses import replace

from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.glow.points import GlowPoints
from horizon_sensor_ros.core.limb.search.selection import MIN_INLIERS
from horizon_sensor_ros.core.limb_curve import limb_in_sight
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status

# Over what they are by day, of edges found one by one, with a model of them and without: of a limb
# that in another camera's frame lies in the dark, since towards the night air and ground change
# faster along it than is told; and below a layer of airglow, since there the sky beside the limb is
# as bright as what lies behind it.
_MODELLED, _BESIDE_DARK, _BELOW_LAYER = 1.5, 2.0, 3.0
# The same of a limb beside the dark that is fitted together with glow that fades along it, which
# that fit knows: of 301 simulated ones 10 were turned by more than 2.5 sigma.
_FADING_BESIDE_DARK = 1.2
# By how much edges without a model lie too far out there, all of them alike.
_HEIGHT_PX = 0.7


def by_night(detection: Detection) -> Detection:
    """Return the detection with shared errors enlarged for night scenes, by factors measured on
    simulated limbs.
    """
    beside_dark = _beside_dark_limb(detection)

    def known(limb: LimbPoints) -> LimbPoints:
        if limb.glow_separated or limb.modelled:
            doubted = beside_dark or (detection.below_layer and not limb.glow_separated)
            fading = isinstance(limb, GlowPoints) and limb.twilit
            times = _FADING_BESIDE_DARK if fading else _MODELLED
            return limb.with_shared_errors_times(times) if doubted else limb
        if detection.below_layer:
            height_px = math.hypot(limb.shared.height_px, _HEIGHT_PX)
            enlarged = limb.with_shared_errors_times(_BELOW_LAYER)
            return replace(enlarged, shared=enlarged.shared._replace(height_px=height_px))
        return limb.with_shared_errors_times(_BESIDE_DARK) if beside_dark else limb

    return detection.with_limbs([known(limb) for limb in detection.limbs])


def _beside_dark_limb(detection: Detection) -> bool:
    """Whether some limbs are seen, and others that should show are not."""
    near = detection.nadir_base, detection.rho_rad
    return any(limb.status is Status.OK for limb in detection.limbs) and any(
        seen.limb.status is not Status.OK and len(limb_in_sight(seen.view, *near)) >= MIN_INLIERS
        for seen in detection.observations
    )

"""Whether what shows as a limb is the edge of a layer of airglow, 95 km above the ground's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.horizon.sighting import Sighting
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.search.air_layer import may_be_cut_off
from horizon_sensor_ros.core.limb.search.bare_edge import bare_by_night
from horizon_sensor_ros.core.limb.search.columns import LAYER_M
from horizon_sensor_ros.core.limb.search.selection import Consensus
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.planet import Planet

_BY_FADING = "by how light fades below it"
_BARE = "stars above it, and no airglow"
_CUT_OFF = "the frame ends too near to the limb"
_SIGMAS = 4.0  # by which altitudes by the limb of the ground and of a layer are told apart


def layer_of(detection: Detection) -> Consensus | None:
    """Consensus of frames in which a layer of airglow shows; else None."""
    consensus = detection.consensus
    return consensus if consensus.below_layer else None


def is_at_layer(limbs: Sequence[LimbObservation], layer: Consensus | None) -> bool:
    """Whether limbs lie rather at the edge of a layer that was seen elsewhere, by all cameras or by
    one alone, than at the limb of the ground below it; not where none was.
    """
    if layer is None:
        return False
    cosine = gather(limbs).rays_base @ layer.nadir_base
    above_rad = np.arccos(np.clip(cosine, -1.0, 1.0)) - layer.rho_rad
    return bool(len(above_rad) and median(above_rad) > 0.5 * layer.layer_rad)


def by_ground(fix: HorizonFix, consensus: Consensus) -> bool:
    """Whether there is a fix, and no layer of airglow has a part in it."""
    return fix.ok and not fix.airglow_alone and not consensus.below_layer


def shown_by_frames(sighting: Sighting, sphere: Planet) -> str:
    """What shows in all frames together that their limb may be a layer's: how light fades below it;
    borders of all frames, which hide what would tell; stars above, and nothing between that glows.
    Empty where nothing does.
    """
    detection = sighting.detection
    if detection.agreed is None:
        return ""
    if detection.consensus.perhaps_layer:
        return _BY_FADING
    views, working = sighting.views, detection.working
    edge = detection.agreed, detection.consensus, sphere
    if may_be_cut_off(views, working, *edge):
        return _CUT_OFF
    return _BARE if bare_by_night(views, sighting.images, working, *edge) else ""


def is_above(fit: HorizonFit, by_itself: HorizonFix) -> bool:
    """Whether the limb lies above the one that a camera by itself found, by about what a layer of
    airglow does: more than errors explain.
    """
    if not by_itself.ok:
        return False
    off_m = by_itself.fit.altitude_m - fit.altitude_m
    variance = fit.cov_nadir_altitude[3, 3] + by_itself.fit.cov_nadir_altitude[3, 3]
    return bool(off_m > max(0.5 * LAYER_M, _SIGMAS * np.sqrt(variance)))

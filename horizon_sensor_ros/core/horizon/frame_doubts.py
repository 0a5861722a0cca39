"""What speaks against the limb that a frame shows, by the frame itself."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np

from horizon_sensor_ros.core.cameras.white_level import full_scale
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.judgement import doubt
from horizon_sensor_ros.core.horizon.sighting import Sighting
from horizon_sensor_ros.core.limb.edge.terminator import terminator
from horizon_sensor_ros.core.limb.evidence import sky_evidence
from horizon_sensor_ros.core.limb.strip import strip
from horizon_sensor_ros.core.limb.sun_artefact import sun_artefact
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status


def doubtful_frames(
    sighting: Sighting,
    limbs: Sequence[LimbPoints],
    fit: HorizonFit,
    config: HorizonConfig,
    hidden: Container[int] = (),
) -> dict[int, LimbPoints]:
    """Frames with limb points whose sky or limb shows that these are not the limb's.

    By index into the frames: a limb without points, whose `reason` says why. hidden : numbers of
    those in which a part of the craft is known to lie before the sky.
    """
    detection = sighting.detection
    # A limb that is followed was asked when it was searched for.
    searched = detection.candidates is not None
    doubts = {}
    for i, (image, view, limb) in enumerate(
        zip(sighting.images, sighting.views, limbs, strict=True)
    ):
        if limb.status is not Status.OK:
            continue
        working = detection.working[i]
        evidence = sky_evidence(
            working,
            view,
            fit.nadir_base,
            fit.rho_rad,
            limb.predicted,
            detection.layer_rad,
        )
        found_px = len(limb.px) * limb.spacing_px if config.limb == "subpixel" else np.inf
        space_share = working.space_level / full_scale(image)
        outside = detection.left_outside(i)
        at_limb = found_px, space_share, outside
        reason = (
            doubt(evidence, *at_limb, config, sky_hidden=i in hidden)
            or sun_artefact(limb.px, working, view, fit.nadir_base, fit.rho_rad)
            or (strip(limb, image, working, view.mask) if searched else "")
            or terminator(limb, view, fit.nadir_base, image, working.space_level)
        )
        if reason:
            doubts[i] = LimbPoints.none(Status.NO_LIMB, reason)
    return doubts

"""Edges that no model fits, and that show no glow, beside limbs that show air, for the covariance.

The same air may be above them: then brightness falls most steeply in it, not at the ground's edge.
Where there is no other limb nothing tells that there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb.glow.limb import usual_length_px
from horizon_sensor_ros.core.limb_points import LimbPoints, SharedError
from horizon_sensor_ros.core.status import Status

# Errors of such edges over the length over which air usually fades, as measured beside the truth of
# simulated limbs: they lie 0.5 to 2.6 lengths too high. That excuses no bend of theirs.
_OF_LENGTH = SharedError(shift_px=0.8, slope_px=0.2)


def with_lifted_edges(
    observations: Sequence[LimbObservation], rho_rad: float
) -> tuple[LimbObservation, ...]:
    """Return the limbs of simultaneous frames; those whose edges no model fits with what air may be
    lifting them by, unless there are limbs of others and none shows air.

    rho_rad : angular radius of the limb.
    """
    limbs = [seen.limb for seen in observations if seen.limb.status is Status.OK]
    if all(limb.modelled for limb in limbs):
        return tuple(observations)
    if len(limbs) > 1 and not any(_shows_air(limb) for limb in limbs):
        return tuple(observations)
    return tuple(
        seen if seen.limb.modelled or not len(seen.limb.px) else _lifted(seen, rho_rad)
        for seen in observations
    )


def _shows_air(limb: LimbPoints) -> bool:
    """Whether a limb was separated from glow, or its edges lie in it."""
    return limb.glow_separated or len(limb.steepness) == 0


def _lifted(seen: LimbObservation, rho_rad: float) -> LimbObservation:
    """The limb with what air may lift it by."""
    limb = seen.limb
    by_air = _OF_LENGTH.times(usual_length_px(seen.view, rho_rad))
    return LimbObservation(seen.view, replace(limb, shared=limb.shared.besides(by_air)))

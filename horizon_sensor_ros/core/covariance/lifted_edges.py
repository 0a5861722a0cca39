"""What air lifts edges by in which it does not show, for the covariance.

Edges that no model fits, beside limbs that show air: the same air may be above them, and brightness
falls most steeply in it, not at the ground's edge. Where there is no other limb nothing tells that
there is none.
Edges that are less sharp than a lens in focus leaves them, where air fades over a pixel or two: it
may be air that passes for blur. By how much it lifts all of the limb is `hidden_air`'s; but it
lifts it less where the lens has more pixels to an angle, which turns the limb.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb.edge.looks import MOST_IN_FOCUS_PX
from horizon_sensor_ros.core.limb.glow.limb import usual_length_px
from horizon_sensor_ros.core.limb_points import LimbPoints, SharedError
from horizon_sensor_ros.core.status import Status

# Errors of such edges over the length over which air usually fades, as measured beside the truth of
# simulated limbs: they lie 0.5 to 2.6 lengths too high. That excuses no bend of theirs.
_OF_LENGTH = SharedError(shift_px=0.8, slope_px=0.2)
# Blur of an edge in focus, and by how much more of it edges lie too high that air makes so soft:
# beside the truth of 30 limbs that others drew 2000 to 6000 km up 1.4 to 2.4.
_IN_FOCUS_PX, _PER_BLUR = 0.76, 2.0
# At most so many lengths over which air fades, by how many pixels these have.
_MOST_LENGTHS = ((1.0, 0.5), (2.5, 0.06))
# Of that lift, what it changes by where an angle has e times as many pixels, there a half to two
# thirds; and from camera to camera, whose blur is known to a step of its ladder.
_OF_LIFT = SharedError(shift_px=0.1, scale_px=0.6)


def with_lifted_edges(
    observations: Sequence[LimbObservation], rho_rad: float
) -> tuple[LimbObservation, ...]:
    """Return the limbs of simultaneous frames, with what air may be lifting their edges by: those
    that no model fits, unless there are limbs of others and none shows air, and soft ones.

    rho_rad : angular radius of the limb.
    """
    observations = tuple(_softened(seen, rho_rad) for seen in observations)
    limbs = [seen.limb for seen in observations if seen.limb.status is Status.OK]
    if all(limb.modelled for limb in limbs):
        return observations
    if len(limbs) > 1 and not any(_shows_air(limb) for limb in limbs):
        return observations
    return tuple(
        seen if seen.limb.modelled or not len(seen.limb.px) else _lifted(seen, rho_rad)
        for seen in observations
    )


def _softened(seen: LimbObservation, rho_rad: float) -> LimbObservation:
    """The limb with what air that passes for blur may turn it by."""
    limb = seen.limb
    if not limb.blur_px > MOST_IN_FOCUS_PX:
        return seen
    length_px = usual_length_px(seen.view, rho_rad)
    most = next((times for px, times in _MOST_LENGTHS if length_px < px), 0.0)
    lift_px = min(_PER_BLUR * (limb.blur_px - _IN_FOCUS_PX), most * length_px)
    return seen if lift_px == 0.0 else _with(seen, _OF_LIFT.times(lift_px))


def _shows_air(limb: LimbPoints) -> bool:
    """Whether a limb was separated from glow, or its edges lie in it."""
    return limb.glow_separated or len(limb.steepness) == 0


def _lifted(seen: LimbObservation, rho_rad: float) -> LimbObservation:
    """The limb with what air may lift it by."""
    return _with(seen, _OF_LENGTH.times(usual_length_px(seen.view, rho_rad)))


def _with(seen: LimbObservation, by_air: SharedError) -> LimbObservation:
    limb = seen.limb
    return LimbObservation(seen.view, replace(limb, shared=limb.shared.besides(by_air)))

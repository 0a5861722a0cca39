"""What air lifts edges by in which it does not show, for the covariance.

Edges that no model fits, beside limbs that show air: the same air may be above them, and brightness
falls most steeply in it, not at the ground's edge. Where there is no other limb that a model fits
nothing tells that there is none.
Edges that are less sharp than a lens in focus leaves them, where air fades over a pixel or two: it
may be air that passes for blur. By how much it lifts all of the limb is `hidden_air`'s; but it
lifts it less where the lens has more pixels to an angle, which turns the limb.
Edges as sharp as a lens leaves them, where air fades over less than a pixel: a sharper lens under
air leaves the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.edge.looks import MOST_IN_FOCUS_PX
from horizon_sensor_ros.core.limb_points import LimbPoints, SharedError
from horizon_sensor_ros.core.planet import Planet
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
# Air that fades over less than so many pixels lifts edges by so much, over what they are less sharp
# than those of a lens as sharp as any, and at most by so many of these lengths: of 40 pairs that
# others drew 400 to 2500 km up, with a lens of .67 px, by -.05 to .35 px.
_VEIL_PX, _PER_VEILED_BLUR, _SHARPEST_PX, _MOST_VEILED = 1.0, 1.2, 0.62, 0.4
# From so many pixels on it shows where the ground beside it is dark.
_SHOWN_PX = 0.65
_BLUR_STEP_PX = 0.01  # to which blur is known


def with_lifted_edges(
    observations: Sequence[LimbObservation], planet: Planet, rho_rad: float
) -> tuple[LimbObservation, ...]:
    """Return the limbs of simultaneous frames, with what air, if the planet has any, may be lifting
    their edges by: those that no model fits, unless one fits limbs of others and none shows air,
    and soft ones.

    rho_rad : angular radius of the limb.
    """
    if not planet.has_air:
        return tuple(observations)
    observations = _veiled(tuple(_softened(seen, rho_rad) for seen in observations), rho_rad)
    limbs = [seen.limb for seen in observations if seen.limb.status is Status.OK]
    if all(limb.modelled for limb in limbs):
        return observations
    # Edges of no model do not tell that there is none, however many cameras see such.
    if any(limb.modelled for limb in limbs) and not any(_shows_air(limb) for limb in limbs):
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


def _veiled(
    observations: tuple[LimbObservation, ...], rho_rad: float
) -> tuple[LimbObservation, ...]:
    """The limbs with what air that fades over less than a pixel may turn them by.

    It adds the same light all along a limb, and lifts edges the more, the less the ground gives
    beside it: towards the terminator, and in the camera that looks there, whose edges are then the
    less sharp. A camera whose pixels are finer has its limb lower.
    """
    lengths_px = [usual_length_px(seen.view, rho_rad, seen.limb.factor) for seen in observations]
    blurs_px = {
        i: seen.limb.blur_px / seen.limb.factor
        for i, seen in enumerate(observations)
        if lengths_px[i] < _VEIL_PX and seen.limb.blur_px > 0.0
    }
    if not blurs_px:
        return observations
    shown = [i for i, seen in enumerate(observations) if seen.limb.status is Status.OK]
    finest_px = max(lengths_px[i] for i in shown)
    usual_px = sum(blurs_px.values()) / len(blurs_px)
    veiled = list(observations)
    for i, blur_px in blurs_px.items():
        lift_px = _PER_VEILED_BLUR * max(blur_px - _SHARPEST_PX, 0.0)
        lift_px = min(lift_px, _MOST_VEILED * lengths_px[i])
        above_finer_px = lift_px * (1.0 - lengths_px[i] / finest_px)
        above_sharper_px = _PER_VEILED_BLUR * max(abs(blur_px - usual_px) - _BLUR_STEP_PX, 0.0)
        shift_px = math.hypot(above_finer_px, above_sharper_px)
        dark_px = lift_px if lengths_px[i] < _SHOWN_PX else 0.0
        by_veil = SharedError(shift_px=shift_px, dark_px=dark_px)
        veiled[i] = _with(observations[i], by_veil.times(observations[i].limb.factor))
    return tuple(veiled)


def _shows_air(limb: LimbPoints) -> bool:
    """Whether a limb was separated from glow, or its edges lie in it."""
    return limb.glow_separated or len(limb.steepness) == 0


def _lifted(seen: LimbObservation, rho_rad: float) -> LimbObservation:
    """The limb with what air may lift it by."""
    return _with(seen, _OF_LENGTH.times(usual_length_px(seen.view, rho_rad)))


def _with(seen: LimbObservation, by_air: SharedError) -> LimbObservation:
    limb = seen.limb
    return LimbObservation(seen.view, replace(limb, shared=limb.shared.besides(by_air)))

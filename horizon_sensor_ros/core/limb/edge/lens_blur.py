"""Blur that a lens adds away from its axis, as one limb across the frame tells it.

Most lenses blur more in the corners than in the middle. Taken for one blur everywhere, the ends of
a limb seem to lie farther out, beside clouds by up to a pixel, which bends the limb as another
altitude does. Texture hides that blur: a lens that blurs evenly is told from one that does not by
how well what is seen agrees with either. Of a lens that was measured it is known.
Source: derived here.
"""

from __future__ import annotations

from horizon_sensor_ros.core.limb.lens_kinds import Known, of_either
from horizon_sensor_ros.core.mathematics.odds import log_odds_of

# One sigma of the blur added in the corners, pixels: by lenses that blur evenly, and by the others;
# and how many are of these.
_EVEN_PX, UNEVEN_PX = 0.01, 0.3
_UNEVEN_LENSES = 0.2
_MEASURED_PX = 0.03  # error of what was measured of a lens
MISJUDGED = 1.5  # how far off texture puts it, over what is claimed: it is no Gaussian process


def of_either_lens(seen_px: float, variance: float) -> tuple[float, float]:
    """Mean and variance of the blur added in the corners, over both kinds of lenses.

    seen_px, variance : of it by what a limb shows, without anything known beforehand.
    """
    variance *= MISJUDGED**2
    even, uneven = (Known.of(seen_px, variance, sigma_px) for sigma_px in (_EVEN_PX, UNEVEN_PX))
    return of_either(even, uneven, log_odds_of(_UNEVEN_LENSES))


def of_measured_lens(seen_px: float, variance: float, measured_px: float) -> tuple[float, float]:
    """Mean and variance of the blur added in the corners by a lens that was measured.

    seen_px, variance : as of `of_either_lens`. measured_px : that blur, beforehand.
    """
    known = Known.of(seen_px - measured_px, variance * MISJUDGED**2, _MEASURED_PX)
    return measured_px + known.mean, known.variance

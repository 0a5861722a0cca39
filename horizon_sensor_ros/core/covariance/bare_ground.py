"""What ground that no air hides moves edges by, as it brightens or darkens towards its limb.

Brightness there goes with the root of the depth below the limb: by Lommel-Seeliger's law, nearly
the Moon's, it rises, and edges lie too far out; by Lambert's it falls. How much depends on the law
and on how high the Sun stands. Under air it is air that one sees there, which is claimed elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb.texture.ground_texture import ground_across_px
from horizon_sensor_ros.core.limb_points import SharedError
from horizon_sensor_ros.core.planet import Planet

# Errors of edges, times the root of the limb's radius in pixels: of all cameras, and by where the
# Sun stands higher, in another camera or at one end of the limb. Of 230 limbs of a Moon seen from
# 30 to 1000 km up, its ground by laws between those two, by -.5 to 1.
_OF_ROOT = SharedError(height_px=0.8, shift_px=0.5, slope_px=0.2)


def with_bare_ground(
    observations: Sequence[LimbObservation], planet: Planet, rho_rad: float
) -> tuple[LimbObservation, ...]:
    """Return the limbs of simultaneous frames, around a planet without air with what its ground may
    move them by.

    rho_rad : angular radius of the limb.
    """
    if planet.has_air:
        return tuple(observations)
    return tuple(_with_ground(seen, rho_rad) for seen in observations)


def _with_ground(seen: LimbObservation, rho_rad: float) -> LimbObservation:
    if not len(seen.limb.px):
        return seen
    across = ground_across_px(seen.view.camera.pixel_rad, rho_rad)
    shared = seen.limb.shared.besides(_OF_ROOT.times(math.sqrt(across)))
    return replace(seen, limb=replace(seen.limb, shared=shared))

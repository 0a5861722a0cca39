"""Air that is overexposed, and by how much that may move its limb.

Its edge lies where it comes down to white. That is the higher, the brighter the air is, by the
length over which it fades for each factor e of light; how bright it is the frame does not tell. It
changes beside each other as the Sun's height changes along the limb, or more where a part alone is
overexposed.
"""

from __future__ import annotations

import math

from horizon_sensor_ros.core.limb_points import SharedError

# Where glow is overexposed as well it is taken for ground: error of simulated limbs' height, over
# the length over which glow fades.
_CLIPPED_HEIGHT = 0.6
# By how many times e light changes to the ends of such a limb, a radian of ground: of air above
# ground where the Sun stands 30 deg high, about.
_LIGHT_TURNS = 2.0
# Slope of the line, from one end of a limb (-1) to the other (1), that least squares fits where a
# share s at one end is off by one: 3 s (1 - s).
PART_TURNS = 3.0


def of_white_air(share: float, along_rad: float, rho_rad: float, length_px: float) -> SharedError:
    """Error that the points of a limb share of which a share (0 to 1) is overexposed.

    along_rad : angle that the limb is long in the frame. rho_rad : radius of its cone. length_px :
    over which its air fades, of the full frame.
    """
    # Of the ground below the limb, from the middle to an end.
    half_rad = 0.5 * along_rad / math.tan(rho_rad)
    turned = math.hypot(PART_TURNS * share * (1.0 - share), _LIGHT_TURNS * half_rad * share)
    height_px = _CLIPPED_HEIGHT * share * length_px
    return SharedError(height_px=height_px, slope_px=turned * length_px)

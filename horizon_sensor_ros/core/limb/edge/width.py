"""How motion smeared a limb: by how wide its edge is, whatever else it looks like.

The fall of brightness across the limb, in the mean over a long part of it, has the shape of what
blurred the edge: motion by m pixels across the limb makes it m pixels wide, where it falls by half
as steeply as at most. Of what the ground does little is left in such a mean, and air glows on one
side only: of the whole width and twice either half the least counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.profiles import sample_profiles
from horizon_sensor_ros.core.limb_curve import limb_curve
from horizon_sensor_ros.core.mathematics.robust import median

_PITCH_PX = 0.5  # between samples across the limb
_D_PX = _PITCH_PX * np.arange(-48, 49)
_SPACINGS = 400  # of profiles, to the length of a frame
_PARTS = 6  # of the limb, whose widths are measured one by one
_LEAST_PROFILES = 4  # a part
_NEAR_PX = 3.5  # from where the limb is thought to be, as far as its edge may lie
_TOP = 0.75  # share of the steepest fall that is its top
_STILL_PX = 2.1  # width of an edge that is as sharp as usual
_BY_GROUND_PX2 = 5.0  # square of the width that clouds may feign, in one frame of a hundred
_BOXED = 0.72  # width at the top over that at half the height; of a normal law 0.64
BOX = 12.0  # square of a box's width, over its variance
# What widens limbs most one way is motion. Of 788 simulated limbs under thick air, which nothing
# moved, two were wider one way by more than these.
_DIRECTED_PX2 = 1.0  # half the difference of the squares of widest and narrowest, at least
_DIRECTED = 2.0  # that over what parts of the limb differ by besides, at least
_MISFIT_PX2 = 0.3  # what they differ by besides, a frame, at least
_BEFOREHAND = np.diag([0.0, 0.02, 0.02])  # parts of a limb that tell as much as is known before


@dataclass(frozen=True, eq=False)
class Smear:
    """Smear of one frame by motion during the exposure, pixels of the full frame.

    across_px : length of the smear across the limb, where it is largest along the limb. least_px :
    where it is smallest. lacking_px2 : (2, 2) covariance, x right and y down, of the extra blur
    that makes the frame's blur equal in all directions. open_px2 : one sigma of what is then still
    unequal, as a variance. boxed : the edge falls as under a constant motion, not as with soft
    optics.
    """

    across_px: float
    least_px: float
    lacking_px2: np.ndarray
    open_px2: float
    boxed: bool = False

    @property
    def sure_px(self) -> float:
        """Length of the smear that only motion explains: less what is equal all along the limb,
        which may be soft optics, and less what clouds may feign.
        """
        optics2 = 0.0 if self.boxed else self.least_px**2
        by_ground2 = min(BOX * self.open_px2, _BY_GROUND_PX2)
        return math.sqrt(max(self.across_px**2 - optics2 - by_ground2, 0.0))


NO_SMEAR = Smear(0.0, 0.0, np.zeros((2, 2)), 0.0)


def smear_of(gray: np.ndarray, view: CameraView, nadir_base: np.ndarray, rho_rad: float) -> Smear:
    """Smear of the limb near a cone in a frame (H, W); none where it cannot be told."""
    spacing_px = max(1.0, max(gray.shape) / _SPACINGS)
    curve = limb_curve(view, nadir_base, rho_rad, spacing_px=spacing_px)
    if len(curve) < _PARTS * _LEAST_PROFILES:
        return NO_SMEAR
    profiles, valid = sample_profiles(gray, curve, _D_PX)
    if np.count_nonzero(valid) < _PARTS * _LEAST_PROFILES:
        return NO_SMEAR
    parts = np.array_split(np.flatnonzero(valid), _PARTS)
    widths = [_widths_px(profiles[part].mean(axis=0)) for part in parts]
    width, top = np.array(widths).T
    # Of a blurred box, about: its cube is the sum of those of the box's and of the blur's.
    across2 = np.maximum(width**3 - _STILL_PX**3, 0.0) ** (2.0 / 3.0)
    normal_px = np.array([curve.normal_px[part].mean(axis=0) for part in parts])
    smear = smear_from_parts(normal_px, across2)
    return replace(smear, boxed=bool(median(top) > _BOXED * median(width)))


def widened_one_way(smears: Sequence[Smear]) -> bool:
    """Whether the width of limbs goes with their direction, as nothing but motion makes it."""
    # Half of what lies between the widest and the narrowest.
    apart2 = sum(0.5 * (smear.across_px**2 - smear.least_px**2) for smear in smears)
    misfit2 = sum(BOX * smear.open_px2 + _MISFIT_PX2 for smear in smears)
    return apart2 > max(_DIRECTED_PX2, _DIRECTED * misfit2)


def smear_from_parts(normal_px: np.ndarray, across2: np.ndarray) -> Smear:
    """Smear from how far it goes across parts of a limb.

    normal_px : (N, 2) of the parts, of any length. across2 : (N,) squares, px^2; N at least 5. The
    part that looks the widest, beside the others, may not be: it is left out.
    """
    x, y = normal_px.T
    length2 = x * x + y * y
    design = np.stack([np.ones(len(x)), (x * x - y * y) / length2, 2.0 * x * y / length2], axis=1)
    keep = np.arange(len(x)) != np.argmax(across2 - design @ _motion(design, across2))
    motion = _motion(design[keep], across2[keep])
    _, a, b = motion.tolist()
    size = math.hypot(a, b)
    along = np.array([[size + a, b], [b, size - a]])
    found = design @ motion
    misfit = float(np.linalg.norm(across2 - found)) / math.sqrt(len(x) - len(motion))
    # Of what goes with the direction no more is made up for than can be told.
    share = size * size / (size * size + misfit * misfit + 1e-9)
    lacking = (share / BOX) * (2.0 * size * np.eye(2) - along)
    most, least = (math.sqrt(max(float(across), 0.0)) for across in (found.max(), found.min()))
    return Smear(most, least, lacking, misfit / BOX)


def _motion(design: np.ndarray, across2: np.ndarray) -> np.ndarray:
    """Coefficients (3,) of squares of widths (N,): the mean, and what goes with twice the angle."""
    # Where the limb hardly turns it is not known which way the motion was.
    return np.linalg.solve(design.T @ design + _BEFOREHAND, design.T @ across2)


def _widths_px(profile: np.ndarray) -> tuple[float, float]:
    """Widths of the fall of a profile (J,) at half its height and at its top; 0 where it does not
    fall.
    """
    smooth = 0.25 * (profile[:-2] + profile[2:]) + 0.5 * profile[1:-1]
    fall = smooth[:-2] - smooth[2:]
    near = np.flatnonzero(np.abs(_D_PX[2:-2]) <= _NEAR_PX)
    steepest = near[int(np.argmax(fall[near]))]
    height = float(fall[steepest])
    if not height > 0.0:
        return 0.0, 0.0
    first, last = (_end(fall, steepest, way, _TOP * height) for way in (-1, 1))
    inner, outer = (_end(fall, steepest, way, 0.5 * height) for way in (-1, 1))
    middle = 0.5 * (first + last)
    width = min(outer - inner, 2.0 * (middle - inner), 2.0 * (outer - middle))
    return _PITCH_PX * width, _PITCH_PX * (last - first)


def _end(fall: np.ndarray, start: int, way: int, level: float) -> float:
    """Where, from a sample on, one way, a curve comes down to a level: numbers of samples."""
    at = start
    while 0 < at < len(fall) - 1 and fall[at + way] > level:
        at += way
    if not 0 < at < len(fall) - 1:
        return float(at)
    return at + way * float(fall[at] - level) / float(fall[at] - fall[at + way])

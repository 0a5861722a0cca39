"""The air that glows above a limb: its unknowns, and what is known of them beforehand.

All stretches of a limb are seen through the same air. `glow.fit` has the model that the symbols
are of. A fit's P unknowns, 13 by day, are a vector, of which these are the places:

- 0 to 2, `LIMB`: nadir's two tangent components, and rho;
- 3, `BACKGROUND`: gray level of the sky;
- 4, `BLUR`: one sigma, pixels;
- 5 to 7, `LOG_GLOW`: logarithm of A, the glow's brightness at the limb: a quadratic polynomial of
  the place along the limb, -1 to 1;
- 8, `LOG_HEIGHT`: logarithm of the scale height over the planet's radius;
- 9, `SHARE`: brightness of the air in front of the ground, over that above the limb;
- 10, `FADING`: logarithm of the light that the lens loses from its axis to the frame's corners;
- 11, 12, `STRAY`: gray levels by which the background rises from the middle of the limb to its end,
  and a pixel outwards;
- from 13 on, only towards the terminator: further powers of the place along the limb in log A.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import EARTH_RADIUS_M

LIMB, BACKGROUND, BLUR, LOG_GLOW, LOG_HEIGHT, SHARE, FADING = slice(3), 3, 4, slice(5, 8), 8, 9, 10
STRAY = slice(11, 13)
NUM = 13
FURTHER = 3  # powers of log A beyond the second, towards the terminator
# What of one frame's fit is of use to other frames, limb, blur and log A: where these are among all
# unknowns, and where among these seven.
KEPT = np.r_[LIMB, BLUR, LOG_GLOW]
KEPT_LIMB, KEPT_BLUR, KEPT_LOG_GLOW = np.arange(3), 3, np.arange(4, 7)
_LOGS = slice(5, 9)
_OF_AIR = slice(5, 11)
# What is known beforehand of each unknown: its usual value, and one sigma.
USUAL_HEIGHT = 8.5e3 / EARTH_RADIUS_M  # of the Earth's air, over its radius
_HEIGHT_SIGMA = 0.15  # of the logarithm
BLUR_SIGMA_PX = 0.1  # about the blur of the edges found one by one
USUAL_SHARE = 0.5
SHARE_SIGMA = 0.15
FADING_SIGMA = 0.7  # of the logarithm of what light a lens that fades loses in the corners
_SLOPE_SIGMA = 0.1  # of the logarithm of A, from the middle of the limb to its ends; usually 0
_BEND_SIGMA = 0.02  # likewise
_BEND_OF_SLOPE = 0.4  # a steeper slope bends more: one sigma besides, over the slope
# Over A, of stray light along the limb, and outwards, where a layer of airglow shines above it.
_STRAY_SIGMA = np.array([0.05, 0.001])
# Of log A towards the terminator, by whatever law: slope and bend, and further powers.
_TWILIT_SIGMA = np.array([1.0, 0.5])
_FURTHER_SIGMA = np.array([0.2, 0.1, 0.05])
BLURS_PX = 0.35, 1.7  # blurs that pixels can tell
SHARES = 0.0, 1.2  # shares that air may have
_MOST_CHANGE = 0.3  # of logarithms, in a step
_MOST_LOG_GLOW = 30.0  # no camera shows a glow of more gray levels than 1e13
# Largest changes of the last step.
_NEAR = 0.15  # of logarithms and shares
_NEAR_BLUR_PX = 0.02


def usual_length_px(view: CameraView, rho_rad: float, factor: int = 1) -> float:
    """Length over which the Earth's air usually fades above a limb of this radius."""
    return USUAL_HEIGHT * math.tan(rho_rad) / (factor * view.camera.pixel_rad)


def usual_bend(log_glow: np.ndarray) -> float:
    """Bend of log A where A itself changes evenly along the limb, as the sine of the Sun's height
    does; log_glow : (3,) of which the slope counts.
    """
    return -0.5 * float(log_glow[1]) ** 2


@dataclass(frozen=True, eq=False)
class Air:
    """What is common to all stretches of a limb.

    height, log_glow (3,), share, psf_px, background, fading, stray (2,) : the unknowns of the air,
    see the top of this file; the height itself, not its logarithm.
    edge_psf_px : blur of edges found one by one, pixels. part : of the limb in sight that is lit
    and fitted, from 0 to 1 along it, towards the terminator; None by day, of all of it. further :
    (0,) by day, else (3,) of log A, see `glow.brightness.further_powers`. faint : the glow is so
    weak that there may be none.
    """

    height: float
    log_glow: np.ndarray
    share: float
    psf_px: float
    background: float
    edge_psf_px: float
    part: tuple[float, float] | None = None
    fading: float = 0.0
    stray: np.ndarray = field(default_factory=lambda: np.zeros(2))
    faint: bool = False
    further: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def twilit(self) -> bool:
        """Whether the glow fades towards the terminator, and the fit is of the lit part."""
        return self.part is not None

    def lit_in(self, part: tuple[float, float] | None) -> Air:
        """Air above a part of the limb towards the terminator, or above all of it by day."""
        count = 0 if part is None else FURTHER
        further = self.further if len(self.further) == count else np.zeros(count)
        return replace(self, part=part, further=further)

    @property
    def elsewhere(self) -> Air:
        """Air above another limb, of which it is not known how the Sun lights it."""
        if not self.twilit:
            return self
        return replace(self.lit_in(None), log_glow=np.array([self.log_glow[0], 0.0, 0.0]))

    @property
    def imaginable(self) -> bool:
        """Whether it glows no brighter anywhere than a camera could show: steps beside what is no
        limb may have no end.
        """
        unevenly = float(np.abs(self.log_glow[1:]).sum() + np.abs(self.further).sum())
        return float(self.log_glow[0]) + unevenly + max(-self.fading, 0.0) < _MOST_LOG_GLOW

    def changed(self, change: np.ndarray) -> Air:
        """Air after a step (P,) of the unknowns."""
        logs = np.clip(change[_LOGS], -_MOST_CHANGE, _MOST_CHANGE)
        return replace(
            self,
            background=self.background + float(change[BACKGROUND]),
            psf_px=self._blur_px(change),
            log_glow=self.log_glow + logs[:3],
            height=self.height * math.exp(logs[3]),
            share=self.share + float(change[SHARE]),
            fading=self.fading + float(change[FADING]),
            stray=self.stray + change[STRAY],
            further=self.further + np.clip(change[NUM:], -_MOST_CHANGE, _MOST_CHANGE),
        )

    def near(self, change: np.ndarray) -> bool:
        """Whether a step (P,) changes so little that what it takes to be linear is."""
        of_air = np.abs(change[_OF_AIR]).max()
        of_blur_px = abs(self._blur_px(change) - self.psf_px)
        return bool(of_air <= _NEAR and of_blur_px <= _NEAR_BLUR_PX)

    def _blur_px(self, change: np.ndarray) -> float:
        """Blur after a step (P,): no sharper and no wider than pixels can tell."""
        return float(np.clip(self.psf_px + change[BLUR], *BLURS_PX))

    def beforehand(self) -> tuple[np.ndarray, np.ndarray]:
        """Information (P,) of what is known beforehand, with a lens that fades, and its pull (P,)
        from these values.
        """
        bend = math.hypot(_BEND_SIGMA, _BEND_OF_SLOPE * self.log_glow[1])
        sigma = np.full(NUM, np.inf)
        sigma[BLUR] = BLUR_SIGMA_PX
        sigma[6:11] = _SLOPE_SIGMA, bend, _HEIGHT_SIGMA, SHARE_SIGMA, FADING_SIGMA
        sigma[STRAY] = _STRAY_SIGMA * math.exp(self.log_glow[0])
        if self.twilit:
            sigma[6:8] = _TWILIT_SIGMA
        away = np.zeros(NUM)
        away[BLUR] = self.edge_psf_px - self.psf_px
        away[6] = -self.log_glow[1]
        away[7] = usual_bend(self.log_glow) - self.log_glow[2]
        away[LOG_HEIGHT] = math.log(USUAL_HEIGHT / self.height)
        away[SHARE] = USUAL_SHARE - self.share
        away[FADING] = -self.fading
        away[STRAY] = -self.stray
        if len(self.further) > 0:
            sigma = np.concatenate([sigma, _FURTHER_SIGMA])
            away = np.concatenate([away, -self.further])
        information = sigma**-2.0
        return information, information * away

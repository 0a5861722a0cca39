"""The air that glows above a limb: the same all along it, and so in every stretch that is seen.

Its unknowns come after the limb's three, in this order: the background, the blur, the logarithm of
A (3, a polynomial along the limb), that of the scale height, the share of the air that lies in
front of the ground, how far the lens darkens towards the corners, and how the background rises
along the limb, from its middle to its end, and outwards, a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.limb.glow.fading import FADING_SIGMA

LIMB, BACKGROUND, BLUR, LOG_GLOW, LOG_HEIGHT, SHARE, FADING = slice(3), 3, 4, slice(5, 8), 8, 9, 10
STRAY = slice(11, 13)
NUM = 13
# What of one frame's fit is of use to other frames: limb, blur and log A, and where these stand
# among them.
KEPT = np.r_[LIMB, BLUR, LOG_GLOW]
KEPT_LIMB, KEPT_BLUR, KEPT_LOG_GLOW = np.arange(3), 3, np.arange(4, 7)
_LOGS, _OF_AIR = slice(5, 9), slice(5, 11)
# What is known beforehand, one sigma each: the scale height over the radius (of its logarithm), the
# blur about that of the edges, the air in front of the ground over that above it; slope and bend of
# the logarithm of A from the middle of the limb to its ends, the bend also as a share of the slope.
USUAL_HEIGHT, _HEIGHT_SIGMA = 8.5e3 / 6371e3, 0.15
BLUR_SIGMA_PX = 0.1
USUAL_SHARE, SHARE_SIGMA = 0.5, 0.15
_SLOPE_SIGMA, _BEND_SIGMA, _BEND_OF_SLOPE = 0.1, 0.02, 0.4
# Stray light along the limb, and outwards, as a layer of airglow shines above it, over A.
_STRAY_SIGMA = np.array([0.05, 0.001])
BLURS_PX, SHARES = (0.35, 1.7), (0.0, 1.2)  # what can be told, and what air may be
WHOLE = 0.0, 1.0  # limb, from one end in sight to the other
_MOST_CHANGE = 0.3  # of logarithms, in a step
_NEAR, _NEAR_BLUR_PX = 0.15, 0.02  # changes in the last step: of logarithms and shares, of the blur


@dataclass(frozen=True)
class Air:
    """What is common to a limb: scale height over the radius, log A (3,), share of the air in front
    of the ground, blur, background; edge_psf_px, the blur of edges found one by one; the part of
    the limb in sight, from 0 to 1 along it, that it is of; fading, the logarithm of what light the
    lens loses in the corners; stray (2,), how the background rises along the limb and outwards;
    faint, it may be no glow at all.
    """

    height: float
    log_glow: np.ndarray
    share: float
    psf_px: float
    background: float
    edge_psf_px: float
    part: tuple[float, float] = WHOLE
    fading: float = 0.0
    stray: np.ndarray = field(default_factory=lambda: np.zeros(2))
    faint: bool = False

    def changed(self, change: np.ndarray) -> Air:
        """The same after a step (13,)."""
        logs = np.clip(change[_LOGS], -_MOST_CHANGE, _MOST_CHANGE)
        return replace(
            self,
            background=self.background + float(change[BACKGROUND]),
            psf_px=float(np.clip(self.psf_px + change[BLUR], *BLURS_PX)),
            log_glow=self.log_glow + logs[:3],
            height=self.height * math.exp(logs[3]),
            share=self.share + float(change[SHARE]),
            fading=self.fading + float(change[FADING]),
            stray=self.stray + change[STRAY],
        )

    def near(self, change: np.ndarray) -> bool:
        """Whether a step (13,) changes so little that what it takes to be linear is."""
        of_air = np.abs(change[_OF_AIR]).max()
        return bool(of_air <= _NEAR and abs(float(change[BLUR])) <= _NEAR_BLUR_PX)

    def beforehand(self) -> tuple[np.ndarray, np.ndarray]:
        """Information (13,) of what is known beforehand, with a lens that fades, and its pull (13,)
        from these values.
        """
        bend = math.hypot(_BEND_SIGMA, _BEND_OF_SLOPE * self.log_glow[1])
        sigma = np.full(NUM, np.inf)
        sigma[BLUR] = BLUR_SIGMA_PX
        sigma[6:11] = _SLOPE_SIGMA, bend, _HEIGHT_SIGMA, SHARE_SIGMA, FADING_SIGMA
        sigma[STRAY] = _STRAY_SIGMA * math.exp(self.log_glow[0])
        away = np.zeros(NUM)
        away[BLUR] = self.edge_psf_px - self.psf_px
        away[6:8] = -self.log_glow[1:]
        away[LOG_HEIGHT] = math.log(USUAL_HEIGHT / self.height)
        away[SHARE] = USUAL_SHARE - self.share
        away[FADING] = -self.fading
        away[STRAY] = -self.stray
        information = sigma**-2.0
        return information, information * away

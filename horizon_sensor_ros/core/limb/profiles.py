"""Gray-level profiles across the predicted limb, and what is measured in them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.limb.curve import LimbCurve
from horizon_sensor_ros.core.robust import robust_sigma

# Second differences along interpolated profiles show less than the pixels' own noise, and a real
# edge is never quite the model's: on frames of known noise this factor makes the residuals of a
# clean limb as large as their sigmas.
_NOISE_FACTOR = 1.3
_PIECE = 256  # profiles that are sampled at a time
_REMAP_STEPS = np.float32(32.0)  # to a pixel: cv2.remap rounds positions to these
# Samples near an edge, and what each says about its place, over the steps to a pixel.
_NEAR_EDGE_PX = np.array([-1.0, 0.0, 1.0])
_NEAR_EDGE_SHARES = np.array([0.25, 0.5, 0.25]) / _REMAP_STEPS
_LEAST_NOISE = 0.25  # gray levels; what rounding alone adds


@dataclass(frozen=True)
class ProfileGrid:
    """Where profiles are sampled, ``first_px + arange(num)``, and where edges are sought,
    +-reach_px by grid_px.
    """

    first_px: float
    num: int
    reach_px: float
    grid_px: float

    @property
    def d_px(self) -> np.ndarray:
        """Sample positions (J,) along the normal."""
        return self.first_px + np.arange(self.num)

    @property
    def e_px(self) -> np.ndarray:
        """Candidate places (E,) of the edge."""
        count = round(self.reach_px / self.grid_px)
        return np.arange(-count, count + 1) * self.grid_px


@dataclass(frozen=True)
class EdgePlaces:
    """The most likely edge of each profile.

    offset_px (N,) along the normal; sigma_px (N,) from the likelihood's curvature; step (N,) gray
    levels; significance (N,): step over the pixel noise; misfit (N,): cost over the degrees of
    freedom, about 1 when the model holds; at_border (N,): the best place is the end of the search
    range.
    """

    offset_px: np.ndarray
    sigma_px: np.ndarray
    step: np.ndarray
    significance: np.ndarray
    misfit: np.ndarray
    at_border: np.ndarray
    log_evidence: np.ndarray

    def take(self, keep: np.ndarray) -> EdgePlaces:
        """Those of the profiles that a mask (N,) keeps."""
        return EdgePlaces(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))


def scatter_px(offset_px: np.ndarray) -> float:
    """One sigma of places (N,) from one profile to the next, robust; NaN for less than three."""
    if len(offset_px) < 3:
        return np.nan
    return robust_sigma(offset_px[1:] - offset_px[:-1]) * math.sqrt(0.5)


def sample_profiles(
    gray: np.ndarray, curve: LimbCurve, d_px: np.ndarray, factor: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Gray levels along the normals of the curve: (N, J) float32, and a mask (N,) of profiles
    inside the frame.

    gray : (H, W), already reduced by `factor`; d_px : (J,) in its pixels.
    """
    centre = curve.px if factor == 1 else (curve.px + 0.5) / factor - 0.5
    x, y = (
        np.add(at[:, None], np.multiply.outer(normal, d_px), dtype=np.float32)
        for at, normal in zip(centre.T, curve.normal_px.T, strict=True)
    )
    height, width = gray.shape
    low_x, high_x = _span(x)
    low_y, high_y = _span(y)
    valid = (low_x >= 1.0) & (low_y >= 1.0) & (high_x <= width - 2) & (high_y <= height - 2)
    profiles = np.empty(x.shape, dtype=np.float32)
    # Only the part of the image that is looked at is turned into floats (8-bit interpolation would
    # round), a stretch of limb at a time: the box around all of it is most of the image.
    for first in range(0, len(x), _PIECE):
        piece = slice(first, first + _PIECE)
        left, top = (max(0, int(low[piece].min()) - 4) for low in (low_x, low_y))
        right, bottom = (int(high[piece].max()) + 6 for high in (high_x, high_y))
        profiles[piece] = cv2.remap(
            gray[top:bottom, left:right].astype(np.float32),
            x[piece] - np.float32(left),
            y[piece] - np.float32(top),
            cv2.INTER_LANCZOS4,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return profiles, valid


def _span(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest (N,) along straight lines of values (N, J)."""
    ends = values[:, 0], values[:, -1]
    return np.minimum(*ends), np.maximum(*ends)


def pixel_phase(curve: LimbCurve, factor: int = 1) -> np.ndarray:
    """How the limb lies in the pixels: (N, 3), one row for each profile.

    How far along the normal `sample_profiles` really samples beyond where it should, in pixels of
    the reduced image; cosine and sine of the place between two rows or columns of it, whichever run
    rather with the limb. Along a limb that runs with them all of it is the same for long stretches.
    """
    centre = curve.px if factor == 1 else (curve.px + 0.5) / factor - 0.5
    normal = curve.normal_px
    out = np.empty((len(curve), 3))
    at = np.add(centre, _NEAR_EDGE_PX[:, None, None] * normal, dtype=np.float32) * _REMAP_STEPS
    np.einsum("dni,ni,d->n", np.rint(at) - at, normal, _NEAR_EDGE_SHARES, out=out[:, 0])
    steep = np.abs(normal[:, 1]) > np.abs(normal[:, 0])
    angle = (2.0 * np.pi) * np.where(steep, centre[:, 1], centre[:, 0])
    np.cos(angle, out=out[:, 1])
    np.sin(angle, out=out[:, 2])
    return out


def bundle_profiles(
    profiles: np.ndarray, valid: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Means (M, J) of about `size` neighbouring profiles (N, J) each, and the index (M,) of the
    middle.

    Profiles that are not valid (N,) are left out; all others count in one of the means.
    """
    index = np.flatnonzero(valid)
    if size == 1:
        return profiles[valid], index
    num = max(1, round(len(index) / size))
    first = np.arange(num) * len(index) // num
    counts = np.empty_like(first)
    np.subtract(first[1:], first[:-1], out=counts[:-1])
    counts[-1] = len(index) - first[-1]
    part = profiles if len(index) == len(profiles) else profiles[index]
    sums = np.add.reduceat(part, first, axis=0)
    return sums / counts[:, None].astype(profiles.dtype), index[first + counts // 2]


def pixel_noise(profiles: np.ndarray, size: int = 1) -> float:
    """One-sigma noise in gray levels, from the outermost six samples (space) of each profile
    (N, J), each the mean of `size`.
    """
    first = profiles[:, -5:] - profiles[:, -6:-1]
    spread = robust_sigma((first[:, 1:] - first[:, :-1]).ravel())
    return max(_NOISE_FACTOR * spread / math.sqrt(6.0), _LEAST_NOISE / math.sqrt(size))


def space_level(profiles: np.ndarray) -> np.ndarray:
    """Median (N,) of the outermost three samples of each profile (N, J)."""
    a, b, c = profiles[:, -3:].T
    return np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))


def mean_profile(
    profiles: np.ndarray, d_px: np.ndarray, places: EdgePlaces
) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the profiles, each aligned at its own edge and scaled to unit step, in bins of a
    quarter pixel.

    Returns distances from the edge (K,) and the mean (K,); bins that few profiles reach are left
    out.
    """
    bins = np.rint((d_px - places.offset_px[:, None]) * 4.0).astype(np.intp)
    low = int(bins.min())
    background = space_level(profiles)[:, None]
    step = np.maximum(places.step, 1e-6)[:, None]
    # A bright profile says more, up to a point: one mirror-bright cloud is not the limb.
    weight = np.broadcast_to(np.minimum(step, np.median(step)), bins.shape).ravel()
    scaled = ((profiles - background) / step).ravel()
    count = np.bincount((bins - low).ravel(), weights=weight)
    total = np.bincount((bins - low).ravel(), weights=weight * scaled)
    use = count > 0.2 * count.max()
    return (np.flatnonzero(use) + low) / 4.0, total[use] / count[use]

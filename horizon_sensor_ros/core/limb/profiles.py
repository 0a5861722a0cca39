"""Gray-level profiles across the predicted limb, and what is measured in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb_curve import LimbCurve
from horizon_sensor_ros.core.mathematics.robust import median, robust_sigma

# Second differences along interpolated profiles show less than the pixels' own noise, and a real
# edge is never quite the model's: on frames of known noise this factor makes the residuals of a
# clean limb as large as their sigmas.
_NOISE_FACTOR = 1.3
_PIECE = 192  # profiles that are sampled at a time
_REMAP_STEPS = np.float32(32.0)  # to a pixel: cv2.remap rounds positions to these
# Samples near an edge, and what each says about its place, over the steps to a pixel.
_NEAR_EDGE_PX = np.array([-1.0, 0.0, 1.0], dtype=np.float32)
_NEAR_EDGE_SHARES = np.array([0.25, 0.5, 0.25]) / _REMAP_STEPS
_SPACE = 6  # samples at a profile's end
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

    @cached_property
    def d_px(self) -> np.ndarray:
        """Sample positions (J,) along the normal."""
        return self.first_px + np.arange(self.num)

    @cached_property
    def e_px(self) -> np.ndarray:
        """Candidate places (E,) of the edge."""
        count = round(self.reach_px / self.grid_px)
        return np.arange(-count, count + 1) * self.grid_px

    @cached_property
    def key(self) -> tuple[float, ...]:
        """All that tells it from another one."""
        return self.first_px, self.num, self.reach_px, self.grid_px

    def part(self, first_px: float, last_px: float) -> slice:
        """Samples from one distance to another."""
        d_px = self.d_px
        return slice(*np.searchsorted(d_px, (first_px, np.nextafter(last_px, np.inf))).tolist())


@dataclass(frozen=True, eq=False)
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

    def take(self, keep: np.ndarray) -> EdgePlaces:
        """Those of the profiles that a mask (N,) keeps."""
        return EdgePlaces(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def replaced(self, which: np.ndarray, by: EdgePlaces) -> EdgePlaces:
        """These, but for the profiles of a mask (N,), of which others are given."""
        columns = []
        for name in self.__dataclass_fields__:
            column = getattr(self, name).copy()
            column[which] = getattr(by, name)
            columns.append(column)
        return EdgePlaces(*columns)


def scatter_px(offset_px: np.ndarray) -> float:
    """One sigma of places (N,) from one profile to the next, robust; NaN for less than three."""
    if len(offset_px) < 3:
        return np.nan
    return robust_sigma(offset_px[1:] - offset_px[:-1]) * math.sqrt(0.5)


def _reduced(px: np.ndarray, factor: int) -> np.ndarray:
    """Pixels (N, 2) of the full image in one that is reduced by `factor`."""
    return px if factor == 1 else (px + 0.5) / factor - 0.5


def _single(curve: LimbCurve, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a curve in a reduced image, and its normals, each (2, N) in single precision."""
    px, normal_px = curve.single
    return px if factor == 1 else _reduced(curve.px, factor).T.astype(np.float32), normal_px


def sample_profiles(
    gray: np.ndarray, curve: LimbCurve, d_px: np.ndarray, factor: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Gray levels along the normals of the curve: (N, J) float32, and a mask (N,) of profiles
    inside the frame.

    gray : (H, W), already reduced by `factor`; d_px : (J,) in its pixels.
    """
    centre, normal = _single(curve, factor)
    # (2, J, N): the points of the limb run fastest.
    at = d_px.astype(np.float32)[:, None] * normal[:, None]
    at += centre[:, None]
    # Profiles are straight: they reach as far as their ends do.
    low, high = np.minimum(at[:, 0], at[:, -1]), np.maximum(at[:, 0], at[:, -1])
    inside = (low >= 1.0) & (high <= np.array([[gray.shape[1] - 2], [gray.shape[0] - 2]]))
    valid = inside[0] & inside[1]
    profiles = np.empty(at.shape[1:], dtype=np.float32)
    # Only the part of the image that is looked at is turned into floats (8-bit interpolation would
    # round), a stretch of limb at a time: the box around all of it is most of the image.
    num = len(curve)
    pieces = max(1, math.ceil(num / _PIECE))
    first = [i * num // pieces for i in range(pieces)]
    corner = np.maximum(np.minimum.reduceat(low, first, axis=1).astype(np.intp) - 4, 0)
    beyond = np.maximum.reduceat(high, first, axis=1).astype(np.intp) + 6
    for i, (left, top, right, bottom) in enumerate(np.concatenate([corner, beyond]).T.tolist()):
        piece = slice(first[i], first[i + 1] if i + 1 < pieces else num)
        profiles[:, piece] = cv2.remap(
            gray[top:bottom, left:right].astype(np.float32),
            at[0, :, piece] - np.float32(left),
            at[1, :, piece] - np.float32(top),
            cv2.INTER_LANCZOS4,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return profiles.T, valid


def pixel_rad_across(view: CameraView, px: np.ndarray, normal_px: np.ndarray) -> np.ndarray:
    """Angles (N,) of one pixel along the normals (N, 2) at pixels (N, 2)."""
    rays = view.camera.rays(np.concatenate([px, px + normal_px, px - normal_px]))
    num = len(px)
    apart = rays[num:].reshape(2, num, 3) - rays[:num]
    outwards, inwards = np.sqrt(np.einsum("kij,kij->ki", apart, apart))
    # A lens model may end inside the frame: beyond it there are no rays.
    found = np.where(np.isfinite(outwards), outwards, inwards)
    return np.where(np.isfinite(found), found, view.camera.pixel_rad)


def pixel_phase(curve: LimbCurve, factor: int = 1) -> np.ndarray:
    """How the limb lies in the pixels: (N, 3), one row for each profile.

    How far along the normal `sample_profiles` really samples beyond where it should, in pixels of
    the reduced image; cosine and sine of the place between two rows or columns of it, whichever run
    rather with the limb. Along a limb that runs with them all of it is the same for long stretches.
    """
    centre = _reduced(curve.px, factor).T
    normal = curve.normal_px.T
    out = np.empty((3, len(curve)))
    px, normal_px = _single(curve, factor)
    at = _NEAR_EDGE_PX[:, None, None] * normal_px
    at += px
    at *= _REMAP_STEPS
    off = (_NEAR_EDGE_SHARES @ (np.rint(at) - at).reshape(len(at), -1)).reshape(normal.shape)
    off *= normal
    np.add(off[0], off[1], out=out[0])
    across = np.where(np.abs(normal[1]) > np.abs(normal[0]), centre[1], centre[0])
    angle = ((2.0 * np.pi) * (across - np.rint(across))).astype(np.float32)
    np.cos(angle, out=out[1])
    np.sin(angle, out=out[2])
    return out.T


@dataclass(frozen=True, eq=False)
class Bundles:
    """About `size` neighbouring profiles each, of which only the mean is looked at.

    index : (K,) those of the profiles that are valid. first, count : (M,) of each bundle among
    these.
    """

    size: int
    index: np.ndarray
    first: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, valid: np.ndarray, size: int) -> Bundles:
        """Bundles of the profiles that are valid (N,); all of them count in one."""
        index = np.flatnonzero(valid)
        num = max(1, round(len(index) / size))
        ends = np.arange(num + 1) * len(index) // num
        return cls(size, index, ends[:-1], ends[1:] - ends[:-1])

    def __len__(self) -> int:
        return len(self.first)

    def part(self, which: slice) -> Bundles:
        """Some of them, without gaps."""
        first, count = self.first[which], self.count[which]
        index = self.index[first[0] : first[-1] + count[-1]]
        return Bundles(self.size, index, first - first[0], count)

    @cached_property
    def _kept(self) -> np.ndarray | slice:
        """`index`, as a slice where it has no gaps: as a rule only the ends of a limb are lost."""
        first, last = int(self.index[0]), int(self.index[-1])
        return slice(first, last + 1) if last - first + 1 == len(self.index) else self.index

    @cached_property
    def middle(self) -> np.ndarray:
        """Number (M,) of the profile in the middle of each."""
        return self.index[self.first + self.count // 2]

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Means (M, C) of the profiles' values (N, C)."""
        values = values.T
        if len(self.index) < values.shape[1]:
            values = values[:, self._kept]
        if len(self) == len(self.index):
            return values.T
        sums = np.add.reduceat(values, self.first, axis=1)
        return (sums / self.count.astype(values.dtype)).T


@lru_cache(maxsize=16)
def nearness(count: int, width: float) -> np.ndarray:
    """Normal law, one at its top, of the distances (count, count) of stretches from each other."""
    number = np.arange(count)
    near = np.exp(np.square(number[:, None] - number) * (-0.5 / width**2))
    near.setflags(write=False)
    return near


def pixel_noise(profiles: np.ndarray, size: int = 1) -> float:
    """One-sigma noise in gray levels, from the outermost six samples (space) of each profile
    (N, J), each the mean of `size`.
    """
    first = profiles[:, 1 - _SPACE :] - profiles[:, -_SPACE:-1]
    spread = robust_sigma((first[:, 1:] - first[:, :-1]).ravel())
    return max(_NOISE_FACTOR * spread / math.sqrt(6.0), _LEAST_NOISE / math.sqrt(size))


def space_mean(profiles: np.ndarray) -> float:
    """Mean of the outermost six samples (space) of profiles (N, J)."""
    space = profiles[:, -_SPACE:]
    return float(np.add.reduce(space, axis=None)) / space.size


def pixels_across(
    gray: np.ndarray, curve: LimbCurve, which: np.ndarray, d_px: np.ndarray, factor: int = 1
) -> np.ndarray:
    """Gray levels (K, J) of the pixels nearest to samples of the profiles `which` (K,).

    gray, d_px, factor : as of `sample_profiles`; no profile leaves the frame.
    """
    centre, normal = _reduced(curve.px[which], factor), curve.normal_px[which]
    # As in `sample_profiles`: the points of the limb run fastest.
    at = d_px[:, None] * normal.T[:, None]
    at += centre.T[:, None]
    x, y = np.rint(at, out=at).astype(np.intp)
    return np.asarray(gray[y, x]).T


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
    step = np.maximum(places.step, 1e-6)
    # A bright profile says more, up to a point: one mirror-bright cloud is not the limb.
    weight = np.minimum(step, median(step)).repeat(len(d_px))
    scaled = ((profiles - background) / step[:, None]).ravel()
    count = np.bincount((bins - low).ravel(), weights=weight)
    total = np.bincount((bins - low).ravel(), weights=weight * scaled)
    use = count > 0.2 * count.max()
    return (np.flatnonzero(use) + low) / 4.0, total[use] / count[use]

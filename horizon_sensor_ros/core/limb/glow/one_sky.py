"""What limbs under glowing air have in common: one Sun lights the air above all of them, and lenses
of one make blur alike.

A slope of the glow's brightness along a limb and a turn of the limb look nearly the same, and so do
a wider blur and a lower limb; one frame tells them apart badly. But the brightness A is a function
of the direction around nadir, as smooth as scattered sunlight is: a constant and few harmonics of
small amplitude. How large that is, is as unknown as all else: where slopes within the frames and
steps between them are small, the glow is even everywhere. Likewise the blurs of two lenses of one
make are near each other, unless they are seen not to be.

Each frame's fit of itself is a normal law of its limb, blur and log A; together with what these
are beforehand, given the amplitude and whether lenses are alike, their answer is linear. That is
averaged over amplitudes and kinds, as likely as each is.
Source: derived here; Bayesian model averaging (Hoeting et al. 1999).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.air import (
    BLUR_SIGMA_PX,
    KEPT,
    KEPT_BLUR,
    KEPT_LIMB,
    KEPT_LOG_GLOW,
    usual_bend,
)
from horizon_sensor_ros.core.limb.glow.brightness import powers
from horizon_sensor_ros.core.limb.glow.limb import GlowLimb
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis

# What a frame's fit says of itself holds to so many of its sigmas: clouds are no Gaussian process.
# As measured beside the truth of simulated limbs.
_MISJUDGED = 2.5
# Amplitudes of log A around nadir, and how its square is shared among the harmonics.
_AMPLITUDES = 0.02 * 2.0 ** np.arange(7.0)
_HARMONICS = (0.75, 0.2, 0.05)
# How much likelier a larger one is beforehand, as a power: a limb that shows is rather one that
# faces the Sun, along which glow changes little, whatever it does around nadir.
_LIKELIER = 0.2
_LEAST_IN_PART = 0.3  # amplitude where glow is too uneven for the whole of a limb
_ANY_BRIGHTNESS = 5.0  # one sigma of log A itself
# Blurs of two lenses differ by so much, one sigma: of one make, and of any.
_ALIKE_PX, _UNLIKE_PX = 0.03, math.sqrt(2.0) * BLUR_SIGMA_PX
_SAME_FOCAL = 0.1  # difference of the focal lengths up to which they may be of one make
_NUM = len(KEPT)
_ROUNDING = 1e-8  # variance
_NOTHING = 1e-9  # information, over all of it


@dataclass(frozen=True, eq=False)
class Together:
    """By what the limbs' three unknowns (N, 3) change by what all frames say, and a factor
    (3 N, K) of their covariance: it times its transpose. amplitude : of log A around nadir. step :
    by how much log A differs between frames by day, at most.
    """

    change: np.ndarray
    errors: np.ndarray
    amplitude: float
    step: float = 0.0


def under_one_sky(views: Sequence[CameraView], limbs: Sequence[GlowLimb]) -> Together:
    """Limbs of simultaneous frames, one a view, by what all of them tell of glow and blur."""
    count = len(limbs)
    first = _NUM * np.arange(count)[:, None]
    places, blurs, glows = ((first + of).ravel() for of in (KEPT_LIMB, KEPT_BLUR, KEPT_LOG_GLOW))
    alike = _alike(views, limbs)
    focus_px = alike @ [limb.air.edge_psf_px for limb in limbs] / alike.sum(axis=1)
    information = np.zeros((_NUM * count, _NUM * count))
    towards = np.zeros(_NUM * count)
    for i, limb in enumerate(limbs):
        of_limb = slice(_NUM * i, _NUM * (i + 1))
        information[of_limb, of_limb], towards[of_limb] = _seen(limb, float(focus_px[i]))
    in_part = any(limb.air.twilit for limb in limbs)
    amplitudes = _AMPLITUDES[_AMPLITUDES > _LEAST_IN_PART] if in_part else _AMPLITUDES
    of_blur, of_glow = _blur_beforehand(alike), _glow_beforehand(views, limbs, amplitudes)
    known = np.broadcast_to(information, (len(of_blur), len(of_glow), *information.shape)).copy()
    known[:, :, blurs[:, None], blurs] += np.linalg.inv(of_blur)[:, None]
    known[:, :, glows[:, None], glows] += np.linalg.inv(of_glow)
    cov = np.linalg.inv(known)
    found = cov @ towards
    # By Bayes; what is common to all laws is left out.
    log_dets = [np.linalg.slogdet(each)[1] for each in (known, of_blur, of_glow)]
    likely = 0.5 * (found @ towards - log_dets[0] - log_dets[1][:, None] - log_dets[2])
    likely += _LIKELIER * np.log(amplitudes)
    share = np.exp(likely - likely.max())
    share /= share.sum()
    # Each law's own spread, and that of their means.
    found = found[..., places]
    mean = np.tensordot(share, found, 2)
    off = (found - mean).reshape(-1, len(places))
    spread = np.tensordot(share, cov[..., places[:, None], places], 2)
    spread += (share.reshape(-1, 1) * off).T @ off
    amplitude = math.exp(share.sum(axis=0) @ np.log(amplitudes))
    variance, axes = np.linalg.eigh(spread)
    errors = axes * np.sqrt(np.maximum(variance, 0.0))
    by_day = [float(limb.air.log_glow[0]) for limb in limbs if not limb.air.twilit]
    step = max(by_day) - min(by_day) if by_day else 0.0
    return Together(mean.reshape(count, 3), errors, amplitude, step)


def _seen(limb: GlowLimb, focus_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Information (7, 7) and its pull (7,) that a frame alone gives, without what its fit took to
    be known of slope, bend and blur; the blur about a usual one, the bend about that of an even
    change.

    Of a limb towards the terminator the glow is of another law, and tells nothing of the others'.
    """
    value = limb.value.copy()
    value[KEPT_BLUR] -= focus_px
    value[KEPT_LOG_GLOW[2]] -= usual_bend(limb.air.log_glow)
    usual = np.zeros(_NUM)
    usual[KEPT_BLUR] = limb.air.edge_psf_px - focus_px
    told_of = np.r_[KEPT_LIMB, KEPT_BLUR] if limb.air.twilit else np.arange(_NUM)
    whole, known = np.linalg.inv(limb.cov[told_of[:, None], told_of]), limb.beforehand[told_of]
    towards = whole @ value[told_of] - known * usual[told_of]
    # Where the lens is in doubt less may be left than nothing: there the frame tells nothing.
    scale = np.sqrt(np.diag(whole))
    gained, axes = np.linalg.eigh((whole - np.diag(known)) / np.outer(scale, scale))
    axes = axes[:, gained > _NOTHING]
    gained = gained[gained > _NOTHING]
    to_axes = np.zeros((_NUM, len(gained)))
    to_axes[told_of] = scale[:, None] * axes
    pull = to_axes @ (axes.T @ (towards / scale))
    return (to_axes * gained) @ to_axes.T / _MISJUDGED**2, pull / _MISJUDGED**2


def _alike(views: Sequence[CameraView], limbs: Sequence[GlowLimb]) -> np.ndarray:
    """Which lenses (N, N) may be of one make, and blur these frames alike."""
    return np.array(
        [
            [_of_one_make(*one, *other) for other in zip(views, limbs, strict=True)]
            for one in zip(views, limbs, strict=True)
        ],
        dtype=float,
    )


def _of_one_make(view: CameraView, limb: GlowLimb, other: CameraView, others: GlowLimb) -> bool:
    a, b = view.camera, other.camera
    return view is other or (
        (a.model, a.width, a.height, limb.factor) == (b.model, b.width, b.height, others.factor)
        and abs(math.log(a.fx / b.fx)) < _SAME_FOCAL
        and not (limb.smeared or others.smeared)
    )


def _blur_beforehand(alike: np.ndarray) -> np.ndarray:
    """Covariances (L, N, N) of blurs about the usual ones: for lenses of one make that are alike,
    and that are not.
    """
    alone = np.eye(len(alike))
    if (alike == alone).all():
        return BLUR_SIGMA_PX**2 * alone[None]
    apart2 = 0.5 * np.square([_ALIKE_PX, _UNLIKE_PX])[:, None, None]
    return np.asarray((apart2 + _ROUNDING) * alone + (BLUR_SIGMA_PX**2 - apart2) * alike)


def _glow_beforehand(
    views: Sequence[CameraView], limbs: Sequence[GlowLimb], amplitudes: np.ndarray
) -> np.ndarray:
    """Covariances (A, 3 N, 3 N) of the polynomials of log A, for each amplitude (A,)."""
    nadir = np.sum([limb.nadir_base for limb in limbs], axis=0)
    across = tangent_basis(nadir / np.linalg.norm(nadir))
    waves = []
    for view, limb in zip(views, limbs, strict=True):
        x, y = (view.camera.rays(limb.px) @ (view.rot_base_from_cam.T @ across)).T
        turned = np.exp(1j * np.outer(np.arctan2(y, x), np.arange(1, 1 + len(_HARMONICS))))
        place = powers(limb.along)
        wave = np.concatenate([turned.real, turned.imag], axis=1)
        waves.append(np.linalg.solve(place.T @ place, place.T @ wave))
    wave = np.concatenate(waves)
    even = wave * np.concatenate([_HARMONICS, _HARMONICS]) @ wave.T
    common = np.zeros(len(even))
    common[::3] = _ANY_BRIGHTNESS
    own = np.outer(common, common) + _ROUNDING * np.eye(len(even))
    return np.asarray(np.square(amplitudes)[:, None, None] * even + own)

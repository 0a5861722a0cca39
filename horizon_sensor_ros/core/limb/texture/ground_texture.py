"""What brightness may do over the ground beside the limb: textures of two kinds, in strengths.

For the profiles of a limb taken together; for single ones there is `edge.model.Texture`. Gaussian
processes over distance along the ground, in planet radii; a texture is one of `NUM`, the
rough ones first, and among these none at all. Strengths are one sigma, over an image's noise.
Source: Rasmussen & Williams 2006, 4.2 (exponential and Matern 3/2 covariance).
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.limb.texture.depth import seen_depths, seen_slopes

NONE = 0
_ROUGH = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0])
_SMOOTH = np.array([3.0, 10.0, 30.0, 100.0])
_ROUGH_LENGTH, _SMOOTH_LENGTH = 0.06, 0.2
NUM = len(_ROUGH) + len(_SMOOTH)


def likely(strength: float) -> int:
    """The rough texture that comes nearest to a strength."""
    return int(np.abs(_ROUGH - strength).argmin())


def by_kind(rough: float, smooth: float) -> np.ndarray:
    """One value for each texture (NUM,) of a kind."""
    return np.repeat([rough, smooth], [len(_ROUGH), len(_SMOOTH)])


def variogram(apart: float) -> np.ndarray:
    """Half the mean squares (NUM,) of the textures' changes over a distance."""
    return _of_kinds(1.0 - rough_correlation(np.array(apart)), 1.0 - _smooth(np.array(apart)))


def correlation(apart: np.ndarray) -> np.ndarray:
    """Of the textures (NUM, N) over distances (N,)."""
    kinds = np.stack([rough_correlation(apart), _smooth(apart)])
    return kinds.repeat([len(_ROUGH), len(_SMOOTH)], axis=0)


def along_sight(root: np.ndarray, px_over_radius: float) -> np.ndarray:
    """Distances along the ground from the limb (M,), planet radii, to where a sight meets it.

    root : (M,) of the depths below the limb, pixels. px_over_radius : `ground_across_px`.
    """
    return np.asarray(root * np.sqrt(2.0 * px_over_radius))


def ground_across_px(pitch_rad: float, rho_rad: float) -> float:
    """Ground across one pixel along the limb, over the planet's radius.

    pitch_rad : angle of a pixel; rho_rad : of the disc's edge from nadir.
    """
    return pitch_rad / math.tan(max(rho_rad, pitch_rad))


def covariances(
    blur: np.ndarray, across: np.ndarray, along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Covariances (NUM, J, J) of the textures in a blurred profile across the limb, and of several
    profiles' together (NUM, K J, K J).

    blur : (J, M) by which a profile sees the ground at the distances across (M,) from the limb.
    along : (K,) where the profiles lie along it. The two directions are taken apart.
    """
    across, along = across[:, None] - across, along[:, None] - along
    rough, smooth = (blur @ kind(across) @ blur.T for kind in (rough_correlation, _smooth))
    together = np.kron(rough_correlation(along), rough), np.kron(_smooth(along), smooth)
    return _of_kinds(rough, smooth), _of_kinds(*together)


def seen_across(
    x_px: np.ndarray, psf_px: float, px_over_radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance (J, J) of unit rough texture in a blurred profile at distances x_px (J,) outside
    the limb; and of its derivatives (rows) by the limb's place and by the blur with it (columns).

    psf_px : the blur, one sigma. px_over_radius : `ground_across_px`.
    """
    root, blur = seen_depths(x_px, psf_px)
    across = along_sight(root, px_over_radius)
    by_x, by_psf = seen_slopes(x_px, psf_px, root, blur)
    seen = rough_correlation(across[:, None] - across) @ blur.T
    # The limb moved outwards is the profile moved inwards.
    return blur @ seen, -by_x @ seen, by_psf @ seen


def _of_kinds(rough: np.ndarray, smooth: np.ndarray) -> np.ndarray:
    """What is given for strength one, for all textures."""
    return np.concatenate(
        [np.multiply.outer(_ROUGH**2, rough), np.multiply.outer(_SMOOTH**2, smooth)]
    )


def rough_correlation(apart: np.ndarray) -> np.ndarray:
    """Correlation of texture with edges, as of clouds, at distances of any shape."""
    return np.asarray(np.exp(-np.abs(apart) / _ROUGH_LENGTH))


def _smooth(apart: np.ndarray) -> np.ndarray:
    """Correlation of texture without any."""
    scaled = np.sqrt(3.0) * np.abs(apart) / _SMOOTH_LENGTH
    return np.asarray((1.0 + scaled) * np.exp(-scaled))

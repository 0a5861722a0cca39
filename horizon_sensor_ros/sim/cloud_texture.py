"""Cloud-like brightness fixed to the planet's surface, repeatable from a seed.

A fractal is laid over the sphere as three bands of wavelengths. Each band is a periodic tile,
made once by spectral synthesis and projected along the three axes (triplanar mapping), so that
a frame costs a few cv2.remap calls and consecutive frames of a flight see the same clouds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

_REMAP_WIDTH = 2048  # remap works on images; long lists of points are folded to this width


@dataclass(frozen=True)
class _Band:
    """One periodic tile and the wavelengths it carries (in planet radii)."""

    size_texels: int
    period: float
    longest: float
    shortest: float


_BANDS = (
    _Band(256, 1.9, 0.27, 0.048),
    _Band(512, 0.37, 0.048, 0.0039),
    _Band(512, 0.029, 0.0039, 0.0004),
)
_ROUGHNESS = 0.75  # amplitude of an octave over that of the next longer one: 2 ** -_ROUGHNESS


def _band_sigma(band: _Band) -> float:
    """Standard deviation of a band's share of a unit fractal (variance ~ wavelength ** 2H)."""
    power = 2.0 * _ROUGHNESS
    whole = _BANDS[0].longest ** power - _BANDS[-1].shortest ** power
    return float(np.sqrt((band.longest**power - band.shortest**power) / whole))


def _tile(band: _Band, rng: np.random.Generator) -> np.ndarray:
    """Periodic band-limited fractal with zero mean and unit variance."""
    n = band.size_texels
    spectrum = np.fft.rfft2(rng.standard_normal((n, n)))
    kx = np.fft.rfftfreq(n, 1.0 / n)
    ky = np.fft.fftfreq(n, 1.0 / n)
    k = np.hypot(ky[:, None], kx[None, :])
    k[0, 0] = np.inf
    low, high = band.period / band.longest, band.period / band.shortest
    spectrum *= np.where((k >= low) & (k < high), k ** -(_ROUGHNESS + 1.0), 0.0)
    tile = np.fft.irfft2(spectrum, (n, n))
    return (tile / tile.std()).astype(np.float32)


@lru_cache(maxsize=8)
def _tiles(seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng([seed, 0xC10D])
    return tuple(_tile(band, rng) for band in _BANDS)


@lru_cache(maxsize=64)
def _orientation(seed: int) -> np.ndarray:
    """Random rotation of the texture, so that the tiles' axes are nowhere special."""
    q, _ = np.linalg.qr(np.random.default_rng([seed, 0x0A1E]).standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))


def _sample(tile: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear look-up in a periodic tile; `x`, `y` (N,) in periods."""
    n = tile.shape[0]
    count = x.size
    if count == 0:
        return np.empty(0, np.float32)
    width = min(count, _REMAP_WIDTH)
    rows = -(-count // width)
    flat = np.zeros((2, rows * width), np.float32)
    flat[0, :count] = (x - np.floor(x)) * n
    flat[1, :count] = (y - np.floor(y)) * n
    map_x, map_y = flat.reshape(2, rows, width)
    out = cv2.remap(tile, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(out, np.float32).reshape(-1)[:count]


def _plane_weights(points: np.ndarray) -> np.ndarray:
    """Weights (3, N) of the three projections, largest for the plane most nearly tangent."""
    squares = np.square(points.T.astype(np.float32, order="C"))
    weights = np.square(squares)
    # dividing by the root of the summed squares keeps the variance the same everywhere
    return weights / np.sqrt((weights**2).sum(axis=0))


def _triplanar(
    tile: np.ndarray, points: np.ndarray, weights: np.ndarray, shift: float
) -> np.ndarray:
    x, y, z = points.T
    return (
        weights[0] * _sample(tile, y + shift, z)
        + weights[1] * _sample(tile, z + shift, x + 0.31)
        + weights[2] * _sample(tile, x + shift, y + 0.67)
    )


def cloud_noise(points: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Fractal noise on the unit sphere.

    points : (N, 3) unit vectors fixed to the planet.
    Returns two float32 fields (N,) of zero mean and about unit variance: the fractal, and an
    independent smooth one (continents, sharp and soft regions).
    """
    turned = (_orientation(seed) @ points.T).T
    weights = _plane_weights(turned)
    tiles = _tiles(seed)
    fractal = np.zeros(len(points), np.float32)
    for band, tile in zip(_BANDS, tiles, strict=True):
        fractal += np.float32(_band_sigma(band)) * _triplanar(
            tile, turned / band.period, weights, 0.0
        )
    smooth = _triplanar(tiles[0], turned / (1.7 * _BANDS[0].period), weights, 0.43)
    return fractal, smooth


def cloud_brightness(
    points: np.ndarray, seed: int, cover: float, ground_dn: float, cloud_dn: float
) -> np.ndarray:
    """Brightness (N,) of clouds over darker ground, float32, in DN.

    points : (N, 3) unit vectors fixed to the planet; cover : share of the sky that is clouded.
    Edges are sharp in some regions and soft in others; a cloud's inside is modulated too.
    """
    fractal, smooth = cloud_noise(points, seed)
    # the logistic law's quantile is close enough to the normal one (within 0.02 in cover)
    threshold = np.float32(-np.log(cover / (1.0 - cover)) / 1.7)
    softness = np.clip(0.6 + 0.45 * smooth, 0.1, 1.4)
    depth = np.clip((fractal - threshold) / softness, 0.0, None)
    veil = np.minimum(depth, 1.0)
    veil = veil * veil * (3.0 - 2.0 * veil)
    body = np.float32(cloud_dn) * (0.35 + 0.65 * np.minimum((fractal - threshold) / 1.7, 1.0))
    ground = np.float32(ground_dn) * (1.0 + 0.25 * np.tanh(4.0 * smooth))
    return ground + veil * (body - ground)


def city_brightness(points: np.ndarray, seed: int) -> np.ndarray:
    """City lights, (N,) in 0..1: small bright grains, clustered on half of the surface.

    points : (N, 3) unit vectors fixed to the planet.
    """
    turned = (_orientation(seed + 1) @ points.T).T
    weights = _plane_weights(turned)
    tiles = _tiles(seed + 1)
    region = _triplanar(tiles[0], turned / _BANDS[0].period, weights, 0.0)
    cluster = _triplanar(tiles[1], turned / _BANDS[1].period, weights, 0.0)
    grain = _triplanar(tiles[2], turned / _BANDS[2].period, weights, 0.0)
    crowd = np.clip(0.5 * region + cluster, 0.0, 2.0) / 2.0
    return crowd * np.clip((grain - 0.6) / 1.5, 0.0, 1.0)

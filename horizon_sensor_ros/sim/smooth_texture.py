"""Brightness that changes gently over the planet's surface, repeatable from a seed."""

from __future__ import annotations

import numpy as np

_WAVES = 60
_WAVELENGTHS = (0.5, 2.0)  # planet radii
_ROUGHNESS = 0.75  # amplitude of a wave goes with this power of its length


def smooth_field(
    points: np.ndarray, seed: int, wavelengths: tuple[float, float] = _WAVELENGTHS
) -> np.ndarray:
    """Field (N,), float32, of zero mean and unit variance at points (N, 3) of the unit sphere.

    Plane waves through space, of random directions, phases and lengths (log-uniform, between two
    wavelengths in planet radii).
    """
    rng = np.random.default_rng([seed, 0x53])
    shortest, longest = np.log(wavelengths)
    length = np.exp(rng.uniform(shortest, longest, _WAVES))
    direction = rng.normal(size=(_WAVES, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    wave = (direction * (2.0 * np.pi / length)[:, None]).astype(np.float32)
    amplitude = length**_ROUGHNESS
    amplitude *= np.sqrt(2.0 / np.square(amplitude).sum())
    phase = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    at = np.asarray(points, dtype=np.float32)
    field = np.zeros(len(at), np.float32)
    for k in range(_WAVES):
        field += np.float32(amplitude[k]) * np.cos(at @ wave[k] + np.float32(phase[k]))
    return field

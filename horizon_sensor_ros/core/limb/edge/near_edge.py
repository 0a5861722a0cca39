"""How bright the planet is beside its edge, and how bright a few pixels farther in."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.profiles import ProfileGrid

# Parts of a profile, pixels outwards from the predicted edge.
BESIDE_PX = (-2.0, -1.0)  # where steps are measured
DEEP_PX = (-6.0, -4.0)


def mean_at(profiles: np.ndarray, grid: ProfileGrid, part_px: tuple[float, float]) -> np.ndarray:
    """Mean brightness (N,) of profiles (N, J) in a part of them, pixels outwards."""
    part = _part(grid, part_px)
    sums = np.add.reduce(profiles[:, part], axis=1)
    return np.asarray(sums * sums.dtype.type(1.0 / (part.stop - part.start)))


@lru_cache(maxsize=32)
def _part(grid: ProfileGrid, part_px: tuple[float, float]) -> slice:
    return grid.part(*part_px)


@lru_cache(maxsize=8)
def beside_and_deep(grid: ProfileGrid) -> np.ndarray:
    """Matrix (J, 2) by which profiles (N, J) are multiplied for their means at `BESIDE_PX` and at
    `DEEP_PX`.
    """
    return _means_at(grid, BESIDE_PX, DEEP_PX)


@lru_cache(maxsize=8)
def beside_and_deep_unblurred(grid: ProfileGrid) -> np.ndarray:
    """Matrix (J, 2) as of `beside_and_deep`, each mean with the one as far outside added: blur that
    is alike on both sides of a step takes as much from inside as it adds outside.
    """
    outside = _means_at(grid, *((-end, -start) for start, end in (BESIDE_PX, DEEP_PX)))
    return beside_and_deep(grid) + outside


def _means_at(grid: ProfileGrid, *parts_px: tuple[float, float]) -> np.ndarray:
    one = np.eye(grid.num)
    return np.stack([mean_at(one, grid, part_px) for part_px in parts_px], axis=1)

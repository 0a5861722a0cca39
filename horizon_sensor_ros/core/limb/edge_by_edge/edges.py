"""Edges of a limb, each found by itself, and which of them to believe."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.limb.profiles import EdgePlaces, scatter_px
from horizon_sensor_ros.core.limb.sample import LEAST_SIGNIFICANCE
from horizon_sensor_ros.core.limb_points import NOTHING_SHARED, CornerBlur, SharedError

_MAX_MISFIT = 6.0


@dataclass(frozen=True, eq=False)
class LimbEdges:
    """Edges of a limb, each by itself. good : (M,), which to believe. model_free : they are where
    brightness falls most steeply, not where a model of the edge lies. corner_blur : as of
    `KrigedPlaces`.
    """

    places: EdgePlaces
    good: np.ndarray
    model_free: bool = True
    shared: SharedError = NOTHING_SHARED
    corner_blur: CornerBlur | None = None

    @cached_property
    def jumps_px(self) -> float:
        """By how much those differ from one to the next, one sigma."""
        return scatter_px(self.places.offset_px[self.good])


def believable(places: EdgePlaces) -> np.ndarray:
    """Which edges (M,) are significant, not at the end of their profile, and of low misfit."""
    return there(places) & (places.misfit < _MAX_MISFIT)


def there(places: EdgePlaces) -> np.ndarray:
    """Which edges (M,) are significant, and not at the end of their profile."""
    return (places.significance > LEAST_SIGNIFICANCE) & ~places.at_border

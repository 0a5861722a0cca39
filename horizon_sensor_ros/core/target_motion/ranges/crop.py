"""The box to which clouds are cropped, so that nothing but the target is in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_NOWHERE_M = 1e6


@dataclass(frozen=True)
class Crop:
    """A box in the clouds' frame, along its axes: least_m, most_m : its corners (x, y, z), metres.

    Raises ValueError where these are not three numbers each, the former below the latter.
    """

    least_m: tuple[float, ...] = (-_NOWHERE_M,) * 3
    most_m: tuple[float, ...] = (_NOWHERE_M,) * 3

    def __post_init__(self) -> None:
        for name in ("least_m", "most_m"):
            got = getattr(self, name)
            # Written so that NaN fails.
            if len(got) != 3 or not all(abs(value) <= _NOWHERE_M for value in got):
                raise ValueError(
                    f"{name} must be three numbers from -{_NOWHERE_M:g} to {_NOWHERE_M:g};"
                    f" got {list(got)}"
                )
        if not all(least < most for least, most in zip(self.least_m, self.most_m, strict=True)):
            raise ValueError(
                f"least_m must be below most_m in x, y and z, got {list(self.least_m)} and"
                f" {list(self.most_m)}"
            )

    @property
    def everywhere(self) -> bool:
        """Whether nothing is cropped."""
        return min(self.most_m) == _NOWHERE_M and max(self.least_m) == -_NOWHERE_M

    def split(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (..., 3) with NaN for those outside, and those outside (N, 3); the array itself
        where nothing is cropped. Those that are not finite are outside.
        """
        if self.everywhere:
            return points, np.empty((0, 3))
        flat = points.reshape(-1, 3)
        outside = np.zeros(len(flat), bool)
        with np.errstate(invalid="ignore"):  # signalling NaN, of garbled messages
            for values, least, most in zip(flat.T, self.least_m, self.most_m, strict=True):
                outside |= ~((values >= least) & (values <= most))
        which = np.flatnonzero(outside)
        kept = np.array(flat, dtype=np.result_type(points, np.float32))
        kept[which] = np.nan
        return kept.reshape(points.shape), flat.take(which, axis=0)

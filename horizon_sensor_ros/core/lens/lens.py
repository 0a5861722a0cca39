"""What every lens can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Lens(ABC):
    """Takes rays of the optical frame to places on the image plane at focal length 1, and back.

    distortion : coefficients of the model; empty for none.
    Methods may divide by zero or get NaN without a guard: callers wrap them in `np.errstate`.
    """

    distortion: tuple[float, ...]

    @property
    @abstractmethod
    def max_angle_rad(self) -> float:
        """Angle off the axis up to which the model is one-to-one."""

    @abstractmethod
    def rays(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return unit rays (N, 3) of places x, y (N,); NaN outside the lens's image."""

    @abstractmethod
    def places(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return places x, y (N,) of rays (N, 3) of any length; NaN where they have no image."""

    @abstractmethod
    def project_into(self, rays: np.ndarray, places: np.ndarray, jacobian: np.ndarray) -> None:
        """Write places (N, 2) of unit rays (N, 3), and their derivatives (N, 2, 3) by the rays."""

    def project_along(self, rays: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return places (2, N) of unit rays (N, 3), and how they move (2, N) as the rays do along
        vectors (N, 3).
        """
        places, jacobian = np.empty((len(rays), 2)), np.empty((len(rays), 2, 3))
        self.project_into(rays, places, jacobian)
        return places.T, np.einsum("nij,nj->in", jacobian, along)

    def gradients(self, rays: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Return how fast (N, 3) places move along vectors (N, 2) with unit rays (N, 3)."""
        places, jacobian = np.empty((len(rays), 2)), np.empty((len(rays), 2, 3))
        self.project_into(rays, places, jacobian)
        return np.asarray(np.einsum("nij,ni->nj", jacobian, along))

    @cached_property
    def undistorted(self) -> bool:
        """Whether the model has no coefficient that does anything."""
        return not any(self.distortion)

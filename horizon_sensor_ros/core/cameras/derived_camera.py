"""A camera with the pixels of another one, and other rays."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera


@dataclass(frozen=True, eq=False)
class DerivedCamera(Camera):
    """A camera with another one's pixels; kinds of it say which rays these have: they override
    `rays`, `pixels`, `project` and `project_along`.
    """

    original: Camera = field(kw_only=True)

    # What is kept for one is not another one's, however alike the pixels.
    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __post_init__(self) -> None:
        """Nothing to check: the original is a camera."""

    def pixel_gradients(self, rays_unit: np.ndarray, along_px: np.ndarray) -> np.ndarray:
        """As of `Camera.pixel_gradients`, by the kind's own `project`."""
        return np.asarray(np.einsum("nij,ni->nj", self.pixel_jacobian(rays_unit), along_px))

    def with_focal_scale(self, scale: float) -> DerivedCamera:
        """Return the camera with the original's focal lengths multiplied."""
        original = self.original.with_focal_scale(scale)
        return replace(self, fx=original.fx, fy=original.fy, original=original)


def intrinsics(camera: Camera) -> dict[str, Any]:
    """What a camera derived from this one begins with: its fields, and itself as the original."""
    return {**{f.name: getattr(camera, f.name) for f in fields(Camera)}, "original": camera}

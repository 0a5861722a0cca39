"""The unknowns of self-calibration: where each stands in the vector, its natural size, its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

_DEG = float(np.pi / 180.0)
_AXES = "xyz"


@dataclass(frozen=True)
class Unknown:
    """One number to be found.

    kind : rotation, drift, focal or limb_height. camera : whose; empty for what all share. axis : 0
    to 2 of the base frame, -1 where there is none. scale : an error of this size is a large one;
    directions are compared in these units.
    """

    kind: str
    camera: str
    axis: int
    scale: float

    @property
    def name(self) -> str:
        """What it is, for a person."""
        if self.kind == "rotation":
            return f"{self.camera} about {_AXES[self.axis]}"
        if self.kind == "drift":
            return f"drift of {self.camera} about {_AXES[self.axis]}"
        return f"focal length of {self.camera}" if self.kind == "focal" else "limb height"


@dataclass(frozen=True)
class Unknowns:
    """All unknowns, in the vector's order: rotations, drifts, focal lengths, limb height.

    Drifts are the change of the rotation over half the recording, about its middle.
    """

    cameras: tuple[str, ...]
    drift: bool = False
    focal: bool = False

    @cached_property
    def all(self) -> tuple[Unknown, ...]:
        """Every unknown, whether or not it can be found."""
        axes = [(camera, axis) for camera in self.cameras for axis in range(3)]
        out = [Unknown("rotation", camera, axis, _DEG) for camera, axis in axes]
        if self.drift:
            out += [Unknown("drift", camera, axis, _DEG) for camera, axis in axes]
        if self.focal:
            out += [Unknown("focal", camera, -1, 0.01) for camera in self.cameras]
        return (*out, Unknown("limb_height", "", -1, 10e3))

    def __len__(self) -> int:
        return len(self.all)

    @cached_property
    def scales(self) -> np.ndarray:
        """Natural sizes (P,)."""
        return np.array([unknown.scale for unknown in self.all])

    def where(self, kind: str, camera: str = "") -> np.ndarray:
        """Indices (K,) of the unknowns of a kind (of one camera)."""
        found = [
            i
            for i, unknown in enumerate(self.all)
            if unknown.kind == kind and camera in ("", unknown.camera)
        ]
        return np.array(found, dtype=int)

    def vector(self, kind: str, cameras: Sequence[str], axis_base: np.ndarray) -> np.ndarray:
        """Direction (P,) of these cameras all turning (or drifting) about an axis (3,)."""
        out = np.zeros(len(self))
        for camera in cameras:
            out[self.where(kind, camera)] = axis_base
        return out

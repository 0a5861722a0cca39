"""Simultaneous frames in which the limb was found, with what is known besides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.planet_figure import Figure


@dataclass(frozen=True, eq=False)
class Sighting:
    """Simultaneous frames, where their limb was found, the planet's figure as it then lies, and
    what is known from elsewhere.

    moves_rad_s : how fast nadir moves, of a limb that was followed from the last set; None: it is
    not known.
    """

    frames: Sequence[Frame]
    detection: Detection
    figure: Figure
    aiding: Aiding
    moves_rad_s: float | None = None

    @cached_property
    def views(self) -> list[CameraView]:
        """Cameras as they see the figure's sphere, one per frame."""
        return [self.figure.view(frame.view) for frame in self.frames]

    @property
    def images(self) -> list[np.ndarray]:
        """Images (H, W), one per frame."""
        return [frame.gray for frame in self.frames]

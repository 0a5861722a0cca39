"""The debug image: one camera in use, the other left out with its reason."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.ros.pictures.debug_image import draw_fix
from horizon_sensor_ros.sim.hard_scenes import hard_scenes

_SCENES = (("boom", 5), ("terminator", 4))


def draw(folder: Path) -> None:
    """Write debug_image.jpg: the first camera of two scenes, one above the other."""
    rows = []
    for kind, seed in _SCENES:
        scene = next(iter(hard_scenes(1, seed, (kind,))))
        frames = tuple(Frame(v, f.image) for v, f in zip(scene.views, scene.frames, strict=True))
        rows.append(draw_fix(frames, HorizonSensor().process(frames))[:, :640])
    cv2.imwrite(str(folder / "debug_image.jpg"), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])

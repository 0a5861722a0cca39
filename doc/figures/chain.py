"""From a frame to a fix: what each step of the search leaves."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.search.candidates import (
    canny_candidates,
    space_boundary_candidates,
)
from horizon_sensor_ros.ros.pictures.debug_image import draw_fix
from horizon_sensor_ros.sim.hard_scenes import hard_scenes

_ORANGE = (0, 159, 230)  # blue, green, red; tells apart for the colour-blind as well


def draw(folder: Path) -> None:
    """Write chain.jpg."""
    scene = next(iter(hard_scenes(1, 3, ("sun",))))
    frames = [Frame(v, f.image) for v, f in zip(scene.views, scene.frames, strict=True)]
    gray = frames[0].gray
    steps = [
        titled(cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR), "1 the frame"),
        titled(dots(gray, canny_candidates(gray).px), "2 Canny: limb, clouds, Sun"),
        titled(dots(gray, space_boundary_candidates(gray).px), "3 what seems to border on space"),
    ]
    fix = HorizonSensor().process(frames)
    steps.append(titled(draw_fix(tuple(frames), fix)[:480, :640], "4 limb, fix, nadir"))
    rows = [np.hstack(steps[:2]), np.hstack(steps[2:])]
    small = cv2.resize(np.vstack(rows), None, fx=0.8, fy=0.8, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "chain.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, 88])


def dots(gray: np.ndarray, px: np.ndarray) -> np.ndarray:
    """Mark points in an image."""
    picture = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    for x, y in np.rint(px).astype(int):
        cv2.circle(picture, (int(x), int(y)), 2, _ORANGE, -1)
    return picture


def titled(picture: np.ndarray, title: str) -> np.ndarray:
    """Write a title into the lower left corner."""
    picture = picture.copy()
    cv2.rectangle(picture, (0, 444), (14 + 13 * len(title), 480), (0, 0, 0), -1)
    cv2.putText(picture, title, (10, 470), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 2)
    return picture

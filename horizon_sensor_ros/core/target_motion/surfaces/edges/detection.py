"""All edges of a range image."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.edges.creases import find_creases
from horizon_sensor_ros.core.target_motion.surfaces.edges.edges import Edges
from horizon_sensor_ros.core.target_motion.surfaces.edges.ends import find_ends
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes


def find_edges(image: RangeImage, planes: Planes) -> Edges:
    """All edges of an image with its planes."""
    parts = [find_ends(image, planes), find_creases(image, planes)]
    whole = (np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Edges))
    return Edges(*(np.ascontiguousarray(values) for values in whole))

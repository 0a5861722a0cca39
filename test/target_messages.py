"""A turning target seen by a small range camera, and the clouds made of it."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from horizon_messages import START_NS
from sensor_msgs.msg import PointCloud2, PointField

from horizon_sensor_ros.core.target.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.sim.shapes import sich_n5, winged_cylinder
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CLOUD_PERIOD_NS = 200_000_000
CAMERA = ToFCamera(width=96, height=96, pixel_pitch_m=85e-6)
MESHES = {"n5": sich_n5(), "cylinder": winged_cylinder()}
FRAME_ID = "tof_optical"
TURN_RAD_S = np.array([0.02, 0.09, -0.03])
VELOCITY_M_S = np.array([0.05, -0.03, 0.1])


def truth_at(index: int) -> np.ndarray:
    """pose_cam_from_target (4, 4), of the mesh's own frame."""
    time_s = index * CLOUD_PERIOD_NS * 1e-9
    start = rotation_from_vector(np.array([0.3, 0.6, 0.2]))
    turned = rotation_from_vector(TURN_RAD_S * time_s) @ start
    return pose_matrix(turned, np.array([0.1, -0.05, 4.0]) + VELOCITY_M_S * time_s)


@lru_cache(maxsize=64)
def scan(index: int, mesh: str = "n5") -> np.ndarray:
    """(H, W, 3) float32 points of the n-th cloud, 5 mm of noise."""
    return CAMERA.scan(MESHES[mesh], truth_at(index), np.random.default_rng(index)).points


def cloud_of(points: np.ndarray, stamp: int, **fields: Any) -> PointCloud2:
    """Message of (H, W, 3) or (N, 3) float32 points, x, y, z and 4 bytes of padding each."""
    points = points[None] if points.ndim == 2 else points
    msg = PointCloud2()
    msg.header.frame_id = FRAME_ID
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    msg.height, msg.width = points.shape[:2]
    msg.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate("xyz")
    ]
    msg.point_step, msg.row_step = 16, 16 * points.shape[1]
    padded = np.zeros((*points.shape[:2], 4), "<f4")
    padded[..., :3] = points
    msg.data.frombytes(padded.tobytes())
    for name, value in fields.items():
        setattr(msg, name, value)
    return msg


def stamp_of(index: int) -> int:
    return START_NS + index * CLOUD_PERIOD_NS


def good_cloud(index: int, mesh: str = "n5", **fields: Any) -> PointCloud2:
    return cloud_of(scan(index, mesh), stamp_of(index), **fields)


def _floats(*offsets: int, datatype: int = PointField.FLOAT32, count: int = 1) -> list[PointField]:
    return [
        PointField(name=name, offset=offset, datatype=datatype, count=count)
        for name, offset in zip("xyz", offsets, strict=False)
    ]


# Messages that are none: what is done to a good one, and the cause and words of the refusal.
BAD_MESSAGES: dict[str, tuple[dict[str, Any], str, str]] = {
    "empty": ({"width": 0, "row_step": 0}, "zero_size", "empty cloud: 0 x"),
    "no rows": ({"height": 0}, "zero_size", "empty cloud"),
    "no z": ({"fields": _floats(0, 4)}, "missing_field", "cloud has no field z"),
    "no fields": ({"fields": []}, "missing_field", "cloud has no field x, y, z"),
    "x twice": ({"fields": _floats(0, 4, 8) * 2}, "duplicate_field", "two fields x"),
    "field outside": ({"fields": _floats(0, 4, 14)}, "field_outside_point", "field z ends at"),
    "point_step 0": ({"point_step": 0}, "field_outside_point", "point_step is 0"),
    "fields overlap": ({"fields": _floats(0, 2, 8)}, "overlapping_fields", "overlap"),
    "integers": (
        {"fields": _floats(0, 4, 8, datatype=PointField.INT32)},
        "wrong_datatype",
        "field x is of datatype 5",
    ),
    "an array": ({"fields": _floats(0, 4, 8, count=2)}, "wrong_count", "field x has 2 values"),
    "row_step": ({"row_step": 17}, "wrong_step", "row_step is 17 bytes"),
    "truncated": ({"height": CAMERA.height + 1}, "truncated_data", "cloud data has"),
}

_PLANE = np.stack(
    [*np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60)), np.full((60, 60), 3.0)], axis=-1
)
# Clouds that can be read but say nothing, and a word of the status.
BAD_CLOUDS: dict[str, tuple[np.ndarray, str]] = {
    "few points": (np.random.default_rng(0).normal([0, 0, 5], size=(20, 3)), "too_few_points"),
    "NaN only": (np.full((40, 40, 3), np.nan), "too_few_points"),
    "infinite": (np.full((40, 40, 3), np.inf), "too_few_points"),
    "zeros": (np.zeros((40, 40, 3)), "too_few_points"),
    "one point many times": (np.full((5000, 3), [0.1, 0.2, 3.0]), "too_few_points"),
    "a plane": (_PLANE, "ill_conditioned"),
    "a line": (np.linspace([-1, 0.3, 2], [1, 0.3, 2], 5000), "too_few_points"),
    "huge": (np.random.default_rng(1).normal(size=(5000, 3)) * 1e30, "too_few_points"),
}

"""A turning target seen by a small range camera, and the clouds made of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from horizon_messages import START_NS
from sensor_msgs.msg import PointCloud2, PointField

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.sim.shapes import sich_n5, winged_cylinder
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CLOUD_PERIOD_NS = 200_000_000
CAMERA = ToFCamera(width=96, height=96, pixel_pitch_m=85e-6)
MESHES = {"n5": sich_n5(), "cylinder": winged_cylinder()}
FRAME_ID = "tof_optical"
TIME_KINDS = {
    "<u2": PointField.UINT16,
    "<i4": PointField.INT32,
    "<u4": PointField.UINT32,
    "<f4": PointField.FLOAT32,
    "<f8": PointField.FLOAT64,
}
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


def timed_cloud(
    points: np.ndarray, stamp: int, name: str, values: np.ndarray, kind: str
) -> PointCloud2:
    """Message of (H, W, 3) points with one more field, of values (H, W), before the coordinates."""
    layout = np.dtype([(name, kind), ("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    data = np.empty(points.shape[:2], layout)
    data[name] = values
    for axis in range(3):
        data["xyz"[axis]] = points[..., axis]
    msg = cloud_of(points, stamp)
    offset = layout[name].itemsize
    msg.fields = [
        PointField(name=name, offset=0, datatype=TIME_KINDS[kind], count=1),
        *_floats(offset, offset + 4, offset + 8),
    ]
    msg.point_step, msg.row_step = layout.itemsize, layout.itemsize * msg.width
    del msg.data[:]
    msg.data.frombytes(data.tobytes())
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
    "no x": ({"fields": _floats(0, 4, 8)[1:]}, "missing_field", "cloud has no field x"),
    "no y": ({"fields": _floats(0, 4, 8)[::2]}, "missing_field", "cloud has no field y"),
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


def _with_strays(points: np.ndarray) -> np.ndarray:
    """Nonsense in pixels that saw nothing."""
    out = points.copy()
    empty = np.argwhere(~np.isfinite(points[..., 2]))
    places = empty[np.random.default_rng(0).permutation(len(empty))[:30]]
    out[tuple(places.T)] = np.tile([[0, 0, 0], [1e30, -1e30, 1e30], [np.inf, 0, 1]], (10, 1))
    return out


def _plain(points: np.ndarray) -> np.ndarray:
    return points[np.isfinite(points[..., 2])]


# What is done to the points of a good cloud without changing what they say.
SAME_POINTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "zeros where nothing came back": np.nan_to_num,
    "stray points": _with_strays,
    "plain": _plain,
    "plain, every point twice": lambda points: np.repeat(_plain(points), 2, axis=0),
    "plain, shuffled": lambda points: np.random.default_rng(0).permutation(_plain(points)),
}


def rewritten(cloud: PointCloud2, order: str, offsets: tuple[int, ...], step: int) -> PointCloud2:
    """The cloud's points as float64 at other places, in another byte order, among other bytes."""
    points = np.frombuffer(cloud.data, "<f4").reshape(cloud.height, cloud.width, 4)[..., :3]
    kind = np.dtype({
        "names": ["x", "y", "z", "intensity"], "formats": [f"{order}f8"] * 3 + ["u2"],
        "offsets": [*offsets, step - 2], "itemsize": step,
    })  # fmt: skip
    data = np.zeros(points.shape[:2], kind)
    for i, name in enumerate("xyz"):
        data[name] = points[..., i]
    data["intensity"] = 7
    msg = PointCloud2()
    msg.header, msg.height, msg.width = cloud.header, cloud.height, cloud.width
    msg.is_bigendian = order == ">"
    msg.fields = _floats(*offsets, datatype=PointField.FLOAT64)
    msg.fields.append(
        PointField(name="intensity", offset=step - 2, datatype=PointField.UINT16, count=1)
    )
    msg.point_step, msg.row_step = step, step * cloud.width
    msg.data.frombytes(data.tobytes())
    return msg

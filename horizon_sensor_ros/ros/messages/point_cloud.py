"""PointCloud2 messages to arrays of points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from horizon_sensor_ros.ros.messages.data_bytes import bytes_of
from horizon_sensor_ros.ros.messages.refusal import Refusal

_AXES = ("x", "y", "z")
# sensor_msgs/PointField: FLOAT32 and FLOAT64.
_FLOATS = {7: "f4", 8: "f8"}


@dataclass(frozen=True)
class _Column:
    """Where a coordinate lies in a point, and its numpy type."""

    offset: int
    dtype: np.dtype

    @property
    def end(self) -> int:
        return self.offset + self.dtype.itemsize


def points_from_cloud(msg: Any) -> np.ndarray | Refusal:
    """Points of a `sensor_msgs/PointCloud2`, native float32 or float64 (the wider of its fields').

    (height, width, 3) of an organised cloud, (N, 3) of one that has but one row or column. Where
    x, y and z follow each other in the machine's byte order the result is a view of the message's
    data, not a copy. Points are as they are: NaN, zero or duplicated ones are for the reader to
    judge.
    """
    width, height = int(msg.width), int(msg.height)
    point_step, row_step = int(msg.point_step), int(msg.row_step)
    if width <= 0 or height <= 0:
        return Refusal("zero_size", f"empty cloud: {width} x {height} points")
    columns = _columns(msg, point_step)
    if isinstance(columns, Refusal):
        return columns
    if row_step < width * point_step:
        return Refusal(
            "wrong_step",
            f"row_step is {row_step} bytes, a row of {width} points has {width * point_step}",
        )
    data = bytes_of(msg, "cloud", "row_step", row_step * height)
    if isinstance(data, Refusal):
        return data
    points = _read(data, columns, (height, width), (row_step, point_step))
    return points if min(width, height) > 1 else points.reshape(-1, 3)


def _columns(msg: Any, point_step: int) -> tuple[_Column, ...] | Refusal:
    """Columns of x, y and z; all else that is in a point is passed over."""
    fields: dict[str, Any] = {}
    for field in msg.fields:
        name = str(field.name)
        if name in _AXES and name in fields:
            return Refusal("duplicate_field", f"cloud has two fields {name}")
        fields[name] = field
    missing = [axis for axis in _AXES if axis not in fields]
    if missing:
        return Refusal("missing_field", f"cloud has no field {', '.join(missing)}")
    order = ">" if msg.is_bigendian else "<"
    columns = []
    for axis in _AXES:
        column = _column(fields, axis, order)
        if isinstance(column, Refusal):
            return column
        if column.end > point_step:
            return Refusal(
                "field_outside_point",
                f"field {axis} ends at byte {column.end} of a point, point_step is {point_step}",
            )
        columns.append(column)
    placed = sorted(columns, key=lambda column: column.offset)
    if any(one.end > other.offset for one, other in pairwise(placed)):
        return Refusal("overlapping_fields", "fields x, y and z overlap")
    return tuple(columns)


def _column(fields: Mapping[str, Any], axis: str, order: str) -> _Column | Refusal:
    field = fields[axis]
    kind, count = int(field.datatype), int(field.count)
    if kind not in _FLOATS:
        return Refusal("wrong_datatype", f"field {axis} is of datatype {kind}, not float32 or 64")
    if count != 1:
        return Refusal("wrong_count", f"field {axis} has {count} values, not one")
    return _Column(int(field.offset), np.dtype(order + _FLOATS[kind]))


def _read(
    data: np.ndarray,
    columns: tuple[_Column, ...],
    shape: tuple[int, int],
    strides: tuple[int, int],
) -> np.ndarray:
    first, second, third = columns
    kind = np.result_type(*(column.dtype for column in columns)).newbyteorder("=")
    size = first.dtype.itemsize
    in_a_row = (second.offset, third.offset) == (first.offset + size, first.offset + 2 * size)
    if in_a_row and all(column.dtype == kind for column in columns):
        return np.ndarray((*shape, 3), kind, data, first.offset, (*strides, size))
    points = np.empty((*shape, 3), kind)
    # A signalling NaN is a NaN like the others.
    with np.errstate(invalid="ignore"):
        for axis, column in enumerate(columns):
            points[..., axis] = np.ndarray(shape, column.dtype, data, column.offset, strides)
    return points

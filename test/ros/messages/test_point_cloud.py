"""PointCloud2 to points: every layout there may be, against a reader that takes point by point."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2, PointField
from target_messages import BAD_MESSAGES, cloud_of, good_cloud, scan

from horizon_sensor_ros.ros.messages.point_cloud import points_from_cloud
from horizon_sensor_ros.ros.messages.refusal import Refusal

# PointField datatypes, and the struct module's letter.
KINDS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


@st.composite
def clouds(draw: st.DrawFn) -> PointCloud2:
    """Any well-formed cloud: fields in any order with gaps between, random bytes for data."""
    names = draw(st.permutations(["x", "y", "z", *draw(st.sets(st.sampled_from(["i", "rgb"])))]))
    offset = 0
    fields = []
    for name in names:
        kind = draw(st.sampled_from([7, 8] if name in "xyz" else list(KINDS)))
        count = 1 if name in "xyz" else draw(st.integers(1, 3))
        offset += draw(st.integers(0, 3))
        fields.append(PointField(name=name, offset=offset, datatype=kind, count=count))
        offset += count * struct.calcsize(KINDS[kind])
    width, height = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    point_step = offset + draw(st.integers(0, 5))
    row_step = width * point_step + draw(st.integers(0, 7))
    seed = draw(st.integers(0, 2**32 - 1))
    extra = draw(st.integers(0, 5))
    data = np.random.default_rng(seed).bytes(row_step * height + extra)
    msg = PointCloud2(
        fields=draw(st.permutations(fields)),
        width=width,
        height=height,
        point_step=point_step,
        row_step=row_step,
        is_bigendian=draw(st.booleans()),
    )
    msg.data.frombytes(data)
    return msg


def one_by_one(msg: PointCloud2) -> np.ndarray:
    """(height, width, 3) float64, each value unpacked on its own."""
    order = ">" if msg.is_bigendian else "<"
    fields = {field.name: field for field in msg.fields}
    values = [
        struct.unpack_from(
            order + KINDS[fields[axis].datatype],
            msg.data,
            row * msg.row_step + column * msg.point_step + fields[axis].offset,
        )[0]
        for row in range(msg.height)
        for column in range(msg.width)
        for axis in "xyz"
    ]
    return np.array(values).reshape(msg.height, msg.width, 3)


@given(clouds())
def test_any_layout_is_read(msg: PointCloud2) -> None:
    points = points_from_cloud(msg)
    assert isinstance(points, np.ndarray)
    expected = one_by_one(msg)
    organised = msg.height > 1 and msg.width > 1
    assert points.shape == (expected.shape if organised else (msg.width * msg.height, 3))
    wide = any(field.datatype == 8 for field in msg.fields if field.name in "xyz")
    assert points.dtype == (np.float64 if wide else np.float32)
    assert points.dtype.isnative
    np.testing.assert_array_equal(points, expected.reshape(points.shape))


@given(
    clouds(),
    st.dictionaries(
        st.sampled_from(["width", "height", "point_step", "row_step"]), st.integers(0, 2**32 - 1)
    ),
    st.lists(
        st.builds(
            PointField,
            name=st.sampled_from(["x", "y", "z", "", "w"]),
            offset=st.integers(0, 2**32 - 1) | st.integers(0, 40),
            datatype=st.integers(0, 255) | st.just(7),
            count=st.integers(0, 2**32 - 1) | st.just(1),
        ),
        max_size=5,
    )
    | st.none(),
)
def test_no_message_raises(
    msg: PointCloud2, sizes: dict[str, int], fields: list[PointField] | None
) -> None:
    for name, value in sizes.items():
        setattr(msg, name, value)
    if fields is not None:
        msg.fields = fields
    points = points_from_cloud(msg)
    if isinstance(points, Refusal):
        assert points.cause
        assert len(points.reason.splitlines()) == 1
    else:
        assert points.shape[-1] == 3


@pytest.mark.parametrize("name", BAD_MESSAGES)
def test_refused_with_cause_and_reason(name: str) -> None:
    fields, cause, words = BAD_MESSAGES[name]
    refusal = points_from_cloud(good_cloud(0, **fields))
    assert isinstance(refusal, Refusal)
    assert refusal.cause == cause
    assert words in refusal.reason


def test_data_that_is_no_bytes() -> None:
    msg = good_cloud(0)
    names = msg.get_fields_and_field_types()
    stranger = SimpleNamespace(**{name: getattr(msg, name) for name in names})
    stranger.data = "text"
    refusal = points_from_cloud(stranger)
    assert isinstance(refusal, Refusal)
    assert refusal.cause == "bad_data"


def test_points_that_follow_each_other_are_not_copied() -> None:
    msg = good_cloud(0)
    points = points_from_cloud(msg)
    assert isinstance(points, np.ndarray)
    np.testing.assert_array_equal(points, scan(0))
    assert np.shares_memory(points, np.frombuffer(msg.data, np.uint8))


@pytest.mark.parametrize("shape", [(1, 9), (9, 1)])
def test_one_row_or_column_is_a_plain_cloud(shape: tuple[int, int]) -> None:
    points = np.arange(27, dtype=np.float32).reshape(*shape, 3)
    found: Any = points_from_cloud(cloud_of(points, 0))
    np.testing.assert_array_equal(found, points.reshape(9, 3))

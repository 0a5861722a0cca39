"""Times of points, as the drivers of lidars tell them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from horizon_messages import START_NS
from sensor_msgs.msg import PointCloud2
from target_messages import cloud_of, scan, stamp_of, timed_cloud

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.target_diagnostics import TargetMonitor
from horizon_sensor_ros.ros.messages.point_cloud import points_from_cloud
from horizon_sensor_ros.ros.messages.point_times import PointTimes, point_times
from horizon_sensor_ros.ros.parameters.target_settings import target_settings
from horizon_sensor_ros.ros.pipelines.target_pipeline import TargetPipeline

# A tenth of a second from the first row to the last.
SWEEP_S = np.linspace(0.0, 0.1, 96)[:, None] * np.ones(96)


def timed(index: int, name: str, values: np.ndarray, kind: str) -> PointCloud2:
    return timed_cloud(scan(index), stamp_of(index), name, values, kind)


def times_of(msg: PointCloud2) -> PointTimes:
    points = points_from_cloud(msg)
    assert isinstance(points, np.ndarray)
    return point_times(msg, points, START_NS)


@pytest.mark.parametrize(
    ("name", "values", "kind", "off_s"),
    [
        ("t", SWEEP_S * 1e9, "<u4", 1e-8),  # Ouster
        ("time", SWEEP_S - 0.1, "<f4", 1e-8),  # Velodyne: up to the stamp
        ("offset_time", SWEEP_S * 1e9, "<u4", 1e-8),
        ("timestamp", START_NS * 1e-9 + SWEEP_S, "<f8", 1e-6),  # Hesai, RoboSense
        ("timestamp", START_NS + SWEEP_S * 1e9, "<f8", 1e-6),  # Livox
        ("time_offset", -SWEEP_S * 1e9, "<i4", 1e-8),
    ],
)
def test_what_drivers_tell_is_read(name: str, values: np.ndarray, kind: str, off_s: float) -> None:
    found = times_of(timed(0, name, values, kind))
    assert found.told == f"field {name}"
    assert found.times_s is not None
    expected = -SWEEP_S if name == "time_offset" else SWEEP_S - 0.1 * (name == "time")
    np.testing.assert_allclose(found.times_s, expected, atol=off_s)


def test_a_cloud_without_times() -> None:
    found = times_of(cloud_of(scan(0), START_NS))
    assert found == PointTimes(None, "points do not tell theirs")


@pytest.mark.parametrize(
    ("values", "kind", "why"),
    [
        (SWEEP_S * 1e6 + 100.0, "<f4", "is no time within 2 s of the stamp"),  # microseconds
        (np.full((96, 96), np.nan), "<f8", "is no time within 2 s of the stamp"),
        (np.zeros((96, 96)), "<u2", "field timestamp is of datatype 4: not used"),
    ],
)
def test_times_that_make_no_sense_are_not_used(values: np.ndarray, kind: str, why: str) -> None:
    found = times_of(timed(0, "timestamp", values, kind))
    assert found.times_s is None
    assert why in found.told


def test_a_field_that_leaves_its_point_is_not_used() -> None:
    msg = timed(0, "t", SWEEP_S, "<f4")
    msg.fields[0].offset = 14
    assert times_of(msg) == PointTimes(None, "field t is not one value in a point: not used")


def test_times_of_what_did_not_return_do_not_count() -> None:
    values = START_NS * 1e-9 + SWEEP_S
    values[~np.isfinite(scan(0)[..., 2])] = 0.0
    found = times_of(timed(0, "timestamp", values, "<f8"))
    assert found.told == "field timestamp"
    assert found.times_s is not None
    assert np.isnan(found.times_s[0, 0])


def fixes_of(values: np.ndarray, **parameters: Any) -> tuple[list[Any], TargetPipeline]:
    pipeline = TargetPipeline(target_settings(parameters).pipeline)
    steps = [pipeline.on_cloud(timed(i, "t", values, "<u4")) for i in range(3)]
    return [step.fix for step in steps], pipeline


def test_the_pipeline_takes_the_sweep_out_unless_it_is_told_not_to() -> None:
    told, pipeline = fixes_of(SWEEP_S * 1e9)
    at_once, _ = fixes_of(SWEEP_S * 0.0)
    off, silent = fixes_of(SWEEP_S * 1e9, point_times=False)
    for fixes in (told, at_once, off):
        assert all(fix.status is Status.OK for fix in fixes)
    last = [fixes[-1].pose_sensor_from_target for fixes in (told, at_once, off)]
    assert np.array_equal(last[1], last[2])
    assert not np.array_equal(last[0], last[1])
    assert pipeline.times_told == "field t"
    assert silent.times_told == ""


def test_diagnostics_say_which_field_tells() -> None:
    _, pipeline = fixes_of(SWEEP_S * 1e9)
    monitor = TargetMonitor("target", 10**9, live=False)
    step = pipeline.on_cloud(timed(3, "t", SWEEP_S * 1e9, "<u4"))
    monitor.on_step(step, START_NS)
    values = {each.key: each.value for each in monitor.message(START_NS, pipeline).status[0].values}
    assert values["point_times"] == "field t"

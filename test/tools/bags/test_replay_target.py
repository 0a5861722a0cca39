"""horizon_replay's part of the target, from the command line on."""

from __future__ import annotations

import filecmp
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from commands import called
from diagnostic_msgs.msg import DiagnosticArray
from horizon_messages import PERIOD_NS, START_NS, recording, write_bag, write_parameters
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader
from target_messages import BAD_CLOUDS, BAD_MESSAGES, cloud_of, good_cloud, stamp_of

from horizon_sensor_ros.ros.parameters.target_settings import target_settings
from horizon_sensor_ros.ros.pipelines.target_pipeline import TARGET_TOPICS, TargetPipeline
from horizon_sensor_ros.tools.bags.replay import main

KINDS = {f"/{topic}": kind for topic, kind in TARGET_TOPICS.items()}
KINDS["/diagnostics"] = DiagnosticArray
DELAY_NS = 3_000_000


def clouds(count: int) -> list[tuple[str, int, Any]]:
    """Topic, time and message of good clouds, recorded a little later than they were taken."""
    return [("/target/points", stamp_of(i) + DELAY_NS, good_cloud(i)) for i in range(count)]


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of five clouds."""
    return write_bag(tmp_path_factory.mktemp("flight") / "bag", clouds(5))


def read(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """Record time and message of every topic."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with Reader(bag) as reader:
        for connection in reader.connections:
            found[connection.topic] = []
        for connection, time, raw in reader.messages():
            if connection.topic in KINDS:
                msg = deserialize_message(raw, KINDS[connection.topic])
                found[connection.topic].append((time, msg))
    return found


run = partial(called, main)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_estimates_with_the_inputs_stamps_and_no_parameters_needed(
    tmp_path: Path, flight: Path, storage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = flight if storage == "mcap" else write_bag(tmp_path / "in", clouds(5), storage)
    assert run(bag, tmp_path / "out") == 0
    out = read(tmp_path / "out")
    assert set(out) == set(KINDS)
    pipeline = TargetPipeline(target_settings({}).pipeline)
    for topic in KINDS.keys() - {"/diagnostics"}:
        first = 0 if topic == "/target/pose" else 1
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in out[topic]]
        assert stamps == [stamp_of(i) for i in range(first, 5)]
        assert [t for t, _ in out[topic]] == [s + DELAY_NS for s in stamps]
    for index in range(5):
        for topic, msg in pipeline.on_cloud(good_cloud(index)).outputs:
            assert (stamp_of(index) + DELAY_NS, msg) in out[f"/{topic}"]
    errors = capsys.readouterr().err
    assert "target_pose_node: 5 clouds, 5 fixes" in errors
    assert "has no /camera_1/image_raw" in errors


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_the_same_bytes_every_time(tmp_path: Path, flight: Path, storage: str) -> None:
    for name in ("one", "another"):
        assert run(flight, tmp_path / name, "--storage", storage) == 0
    names = sorted(p.name for p in (tmp_path / "one").iterdir())
    same, different, missing = filecmp.cmpfiles(
        tmp_path / "one", tmp_path / "another", names, shallow=False
    )
    assert (sorted(same), different, missing) == (names, [], [])


def test_horizon_and_target_of_one_bag(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "in", sorted(recording(3) + clouds(3), key=lambda m: m[1]))
    params = write_parameters(tmp_path / "params.yaml", target_frame="debris")
    assert run(bag, tmp_path / "out", "--params", params) == 0
    out = read(tmp_path / "out")
    assert set(out) == {*KINDS, "/local_vertical", "/attitude"}
    for _, delta in out["/target/pose_delta"]:
        assert delta.header.frame_id == "debris_previous"
    nodes = {msg.status[0].name.split(":")[0] for _, msg in out["/diagnostics"]}
    assert nodes == {"local_vertical_node", "attitude_node", "target_pose_node"}
    alone = write_bag(tmp_path / "alone", clouds(3))
    assert run(alone, tmp_path / "out_alone", "--params", params) == 0
    for topic in TARGET_TOPICS:
        assert read(tmp_path / "out_alone")[f"/{topic}"] == out[f"/{topic}"]


def test_bad_clouds_are_counted_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = clouds(6)
    for index, msg in (
        (1, good_cloud(1, **BAD_MESSAGES["no z"][0])),
        (2, cloud_of(BAD_CLOUDS["NaN only"][0], stamp_of(2))),
        (3, ("sensor_msgs/msg/PointCloud2", serialize_message(good_cloud(3))[:200])),
    ):
        messages[index] = (*messages[index][:2], msg)
    bag = write_bag(tmp_path / "in", messages)
    assert run(bag, tmp_path / "out") == 0
    out = read(tmp_path / "out")
    counts = [len(out[f"/{topic}"]) for topic in TARGET_TOPICS]
    assert counts == [3, 2, 2]
    errors = capsys.readouterr().err
    assert "rejected, missing_field: 1" in errors
    assert "rejected, too_few_points: 1" in errors
    assert "unreadable messages skipped on /target/points: 1" in errors


def test_no_estimate_is_a_valid_bag(tmp_path: Path) -> None:
    points, _ = BAD_CLOUDS["a plane"]
    messages = [("/target/points", stamp_of(i), cloud_of(points, stamp_of(i))) for i in range(3)]
    assert run(write_bag(tmp_path / "in", messages), tmp_path / "out") == 0
    out = read(tmp_path / "out")
    assert not any(out[f"/{topic}"] for topic in TARGET_TOPICS)
    last = out["/diagnostics"][-1][1].status[0]
    assert last.values[0].value == "no_fix"
    assert "plane" in last.message


def test_diagnostics_in_bag_time(tmp_path: Path) -> None:
    year = 365 * 24 * 3600 * 10**9
    messages = clouds(3)
    late = good_cloud(3)
    late.header.stamp.sec += year // 10**9
    messages.append(("/target/points", stamp_of(3) + year, late))
    assert run(write_bag(tmp_path / "in", messages), tmp_path / "out") == 0
    diagnostics = read(tmp_path / "out")["/diagnostics"]
    states = [msg.status[0].values[0].value for _, msg in diagnostics]
    assert states[:3] == ["waiting", "new_target_frame", "ok"]
    assert "stale" in states
    assert states[-1] == "new_target_frame"
    assert len(states) < 30
    for time, msg in diagnostics:
        assert msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec == time
        assert not {p.key for p in msg.status[0].values} & {"latency_ms", "rate_hz"}


def test_namespace_and_remapping(tmp_path: Path) -> None:
    messages = [("/craft/tof/points", t, msg) for _, t, msg in clouds(2)]
    bag = write_bag(tmp_path / "in", messages)
    remap = ["--remap", "target/points:=tof/points", "--remap", "target/twist:=/spin"]
    assert run(bag, tmp_path / "out", "--namespace", "craft", *remap) == 0
    found = set(read(tmp_path / "out"))
    assert found == {"/craft/target/pose", "/craft/target/pose_delta", "/spin", "/diagnostics"}


def test_wrong_parameters_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "in", clouds(1))
    params = write_parameters(tmp_path / "params.yaml", max_gap=-1.0)
    assert run(bag, tmp_path / "out", "--params", params) == 1
    assert "target_pose_node: max_gap" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_images_still_need_their_extrinsics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = clouds(1) + recording(1, START_NS + PERIOD_NS)
    assert run(write_bag(tmp_path / "in", messages), tmp_path / "out") == 1
    assert "camera_1.rotation is not set" in capsys.readouterr().err

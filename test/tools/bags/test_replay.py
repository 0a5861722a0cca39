"""horizon_replay, from the command line on."""

from __future__ import annotations

import errno
import filecmp
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import called, refusal
from compressed_frames import compressed_recording, encoded
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from horizon_messages import (
    ALTITUDE_M,
    PERIOD_NS,
    QUATERNIONS,
    START_NS,
    attitude_at,
    coarse_pose_of,
    image_of,
    imu_of,
    nadir_of,
    recording,
    write_bag,
    write_parameters,
)
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.interfaces import QosReliability
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CompressedImage, Image, Imu
from std_msgs.msg import String

from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.tools.bags.replay import main
from horizon_sensor_ros.tools.command_errors import in_one_line

KINDS = {
    "/local_vertical": Vector3Stamped,
    "/attitude": PoseWithCovarianceStamped,
    "/diagnostics": DiagnosticArray,
}


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of five pairs."""
    return write_bag(tmp_path_factory.mktemp("flight") / "bag", recording(5))


@pytest.fixture
def params(tmp_path: Path) -> Path:
    return write_parameters(tmp_path / "params.yaml")


def read(bag: Path, prefix: str = "") -> dict[str, list[tuple[int, Any]]]:
    """Record time and message of every topic."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with Reader(bag) as reader:
        for connection in reader.connections:
            found[connection.topic.removeprefix(prefix)] = []
        for connection, stamp, raw in reader.messages():
            topic = connection.topic.removeprefix(prefix)
            kind = next(k for k in KINDS.values() if k.__name__ in connection.msgtype)
            found[topic].append((stamp, deserialize_message(raw, kind)))
    return found


run = partial(called, main)
refused = partial(refusal, main)


def states(bag: Path) -> list[str]:
    messages = [msg.status[0] for _, msg in read(bag)["/diagnostics"]]
    return [m.values[0].value for m in messages if m.name.startswith("attitude_node")]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_estimates_with_the_inputs_stamps(tmp_path: Path, params: Path, storage: str) -> None:
    bag = write_bag(tmp_path / "in", recording(3), storage)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    out = read(tmp_path / "out")
    assert set(out) == set(KINDS)
    for topic in ("/local_vertical", "/attitude"):
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in out[topic]]
        assert stamps == [START_NS + i * PERIOD_NS for i in range(3)]
        # Recorded when the pair's second image was.
        assert [t for t, _ in out[topic]] == [s + 1_500_000 for s in stamps]
    for index, (_, msg) in enumerate(out["/local_vertical"]):
        vertical = [msg.vector.x, msg.vector.y, msg.vector.z]
        np.testing.assert_allclose(vertical, nadir_of(*attitude_at(index)), atol=1e-3)
    kind = "*.mcap" if storage == "mcap" else "*.db3"
    assert len(list((tmp_path / "out").glob(kind))) == 1


def test_the_bag_says_how_its_topics_are_published(
    tmp_path: Path, flight: Path, params: Path
) -> None:
    assert run(flight, tmp_path / "out", "--params", params) == 0
    with Reader(tmp_path / "out") as reader:
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles
            assert qos.reliability == QosReliability.RELIABLE
            assert qos.depth == 10


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_the_same_bytes_every_time(
    tmp_path: Path, flight: Path, params: Path, storage: str
) -> None:
    for name in ("one", "another"):
        assert run(flight, tmp_path / name, "--params", params, "--storage", storage) == 0
    names = sorted(p.name for p in (tmp_path / "one").iterdir())
    same, different, missing = filecmp.cmpfiles(
        tmp_path / "one", tmp_path / "another", names, shallow=False
    )
    assert (sorted(same), different, missing) == (names, [], [])
    assert len(names) == 2


def test_the_pose_and_the_rates_in_a_bag_are_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    planet = Planet.wgs84()
    position = planet.ecef_from_geodetic(np.radians(45.0), 0.3, ALTITUDE_M)
    down = planet.nadir_ecef(position)
    rot, _ = Rotation.align_vectors(down[None], nadir_of(*attitude_at(0))[None])
    messages = recording(3)
    with_pose = [
        ("/coarse_pose", START_NS - 1, coarse_pose_of(START_NS, position, rot.as_matrix()))
    ]
    with_pose += [
        ("/imu", START_NS + i * PERIOD_NS // 4, imu_of(START_NS + i * PERIOD_NS // 4, (0, 0.01, 0)))
        for i in range(-1, 9)
    ]
    together = sorted([*messages, *with_pose], key=lambda message: message[1])
    found = {}
    for vertical in ("geocentric", "geodetic"):
        params = write_parameters(
            tmp_path / f"{vertical}.yaml",
            planet="wgs84",
            vertical=vertical,
            diagnostics_period=0.05,
        )
        for name, recorded in (("without", messages), ("with", together)):
            bag = tmp_path / f"{name}_{vertical}"
            assert run(write_bag(bag, recorded), f"{bag}_out", "--params", params) == 0
            out = read(Path(f"{bag}_out"))
            _, vector = out["/local_vertical"][-1]
            found[name, vertical] = np.array([vector.vector.x, vector.vector.y, vector.vector.z])
            values = {v.key: v.value for v in out["/diagnostics"][-1][1].status[0].values}
            used = "used" if name == "with" else "none"
            assert (values["coarse_pose"], values["imu"]) == (used, used)
            # The drawn limbs are a sphere's: of an ellipsoid the cameras say that they disagree.
            assert ("fitted as a sphere" in values["reason"]) == (name == "without")
            assert ("each by itself" in values["reason"]) == (name == "with")
    # Optional: nobody misses them.
    said = capsys.readouterr().err
    assert "has no /coarse_pose" not in said
    assert "has no /imu" not in said
    np.testing.assert_array_equal(found["without", "geocentric"], found["without", "geodetic"])
    between = np.degrees(np.arccos(found["with", "geocentric"] @ found["with", "geodetic"]))
    # The flattening times sin(2 latitude), less at altitude.
    expected = np.degrees(planet.flattening) * planet.radius_m / (planet.radius_m + ALTITUDE_M)
    assert between == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bare_file_is_a_bag_too(tmp_path: Path, params: Path, storage: str) -> None:
    bag = write_bag(tmp_path / "in", recording(2), storage)
    (file,) = [f for f in bag.iterdir() if f.suffix in (".mcap", ".db3")]
    lone = Path(shutil.move(file, tmp_path / file.name))
    assert run(lone, tmp_path / "out", "--params", params) == 0
    assert len(read(tmp_path / "out")["/attitude"]) == 2


def test_namespace_and_remapping(tmp_path: Path) -> None:
    other = {"/camera_1/image_raw": "/craft/left/image", "/camera_2/image_raw": "/right"}
    messages = [
        (other.get(topic, f"/craft{topic}"), stamp, msg) for topic, stamp, msg in recording(2)
    ]
    bag = write_bag(tmp_path / "in", messages)
    params = tmp_path / "params.yaml"
    params.write_text(
        "/craft/attitude_node:\n  ros__parameters:\n    cameras: [camera_1]\n"
        f"    camera_1.rotation: {QUATERNIONS['camera_1']}\n"
        "/**/local_vertical_node:\n  ros__parameters:\n    cameras: [camera_2]\n"
        f"    camera_2: {{rotation: {QUATERNIONS['camera_2']}}}\n"
    )
    remap = ["--remap", "camera_1/image_raw:=left/image", "--remap", "camera_2/image_raw:=/right"]
    # Of two rules for one name the first one counts, as live.
    remap += ["--remap", "attitude:=/att", "--remap", "attitude:=/other"]
    arguments = [bag, tmp_path / "out", "--params", params, "--namespace", "craft"]
    assert run(*arguments, *remap) == 0
    out = read(tmp_path / "out")
    assert set(out) == {"/craft/local_vertical", "/att", "/diagnostics"}
    assert all(len(out[topic]) == 2 for topic in ("/craft/local_vertical", "/att"))
    reporting = {msg.status[0].hardware_id for _, msg in out["/diagnostics"]}
    assert reporting == {"/craft/local_vertical_node", "/craft/attitude_node"}


def test_a_summary_and_a_progress_bar(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(flight, tmp_path / "out", "--params", params) == 0
    errors = capsys.readouterr().err
    assert "20/20" in errors
    assert "10 frames, 5 sets, 5 fixes" in errors
    assert "at the end" not in errors


def test_beside_fixes_too_the_reasons_of_the_others_are_said(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two sets are dark in both frames, and in the fourth one camera's alone is."""
    dark = {("1", 1), ("2", 1), ("1", 2), ("2", 2), ("2", 3)}
    flight = recording(5)
    for at, (topic, t, msg) in enumerate(flight):
        camera, index = topic[len("/camera_")], (t - START_NS) // PERIOD_NS
        if isinstance(msg, Image) and (camera, index) in dark:
            black = image_of(np.zeros((240, 320), np.uint8), START_NS + index * PERIOD_NS)
            flight[at] = (topic, t, black)
    bag = write_bag(tmp_path / "in", flight)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    _, _, told = capsys.readouterr().err.partition("local_vertical_node, ")
    # The reasons are those on /diagnostics.
    said = [msg.status[0].message for _, msg in read(tmp_path / "out")["/diagnostics"]]
    no_limb = next(m.removeprefix("no_limb: ") for m in said if m.startswith("no_limb: "))
    left_out = next(m for m in said if m.startswith("camera_2 left out: "))
    assert told.splitlines() == [
        "attitude_node: 10 frames, 5 sets, 3 fixes (1 degraded, 1 from one camera)",
        "  rejected, no_limb: 2",
        f"    2: {no_limb}",
        "  degraded: 1",
        f"    1: {left_out}",
    ]


def test_a_gyro_in_a_frame_of_its_own_is_said_to_be_refused(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All else is well, and nobody would know."""
    gyro = imu_of(START_NS, (0, 0.01, 0))
    gyro.header.frame_id = "imu_link"
    bag = write_bag(tmp_path / "in", [("/imu", START_NS - 1, gyro), *recording(2)])
    assert run(bag, tmp_path / "out", "--params", params) == 0
    errors = capsys.readouterr().err
    assert "2 fixes" in errors
    assert "  ignored, imu_wrong_frame: 1\n" in errors
    assert "  imu refused: header frame is 'imu_link', not 'base_link'" in errors


def test_what_the_summary_sends_to_the_tuning_guide_for_is_there(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    guide = (Path(__file__).parents[3] / "doc" / "tuning.md").read_text()
    flight = recording(3)
    for lost, words in (("/camera_2/", "no frames from"), ("/camera_info", "no camera_info yet")):
        kept = [each for each in flight if lost not in each[0]]
        bag = write_bag(tmp_path / lost.strip("/"), kept)
        assert run(bag, tmp_path / f"{bag.name}_out", "--params", params) == 0
        errors = capsys.readouterr().err
        assert "(doc/tuning.md: what to do)" in errors
        assert words in errors.partition("at the end: ")[2]
        assert f"| {words} " in guide


def test_topics_that_help_by_another_clock_are_said(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = START_NS - 10**12
    pose = coarse_pose_of(late, np.array([7e6, 0.0, 0.0]), np.eye(3))
    gyro = imu_of(late, (0, 0.01, 0))
    aids = [("/imu", START_NS - 2, gyro), ("/coarse_pose", START_NS - 1, pose)]
    bag = write_bag(tmp_path / "in", [*aids, *recording(2)])
    assert run(bag, tmp_path / "out", "--params", params) == 0
    errors = capsys.readouterr().err
    assert "  coarse_pose too old: 1000.1 s\n" in errors
    assert "  imu of another time: its nearest stamp is 1000.1 s before the frames'\n" in errors


def test_unreadable_messages_are_skipped_and_counted(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = recording(4)
    topic, stamp, msg = messages[5]
    messages[5] = (topic, stamp, ("sensor_msgs/msg/Image", serialize_message(msg)[:100]))
    topic, stamp, msg = messages[10]
    messages[10] = (topic, stamp, ("sensor_msgs/msg/CameraInfo", b"\x00\x01\x00\x00\xff"))
    bag = write_bag(tmp_path / "in", messages)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    out = read(tmp_path / "out")
    assert len(out["/attitude"]) == 3
    errors = capsys.readouterr().err
    assert "unreadable messages skipped on /camera_1/image_raw: 1" in errors
    assert "unreadable messages skipped on /camera_2/camera_info: 1" in errors
    assert "rejected, unpaired: 1" in errors


def test_no_estimate_is_a_valid_bag(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dark = [
        (topic, t, image_of(np.zeros((240, 320), np.uint8), t) if "image" in topic else msg)
        for topic, t, msg in recording(3)
    ]
    bag = write_bag(tmp_path / "in", dark)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    out = read(tmp_path / "out")
    assert out["/attitude"] == out["/local_vertical"] == []
    assert "no_fix" in states(tmp_path / "out")
    errors = capsys.readouterr().err
    assert "3 sets, 0 fixes" in errors
    assert "at the end: no_fix: no_limb: " in errors


def test_one_camera_missing_is_said_and_no_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """After camera_timeout, here two seconds, the fixes come from the other one."""
    params = write_parameters(tmp_path / "params.yaml", camera_timeout=2.0)
    alone = [m for m in recording(40) if "camera_1" in m[0]]
    bag = write_bag(tmp_path / "in", alone)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    assert "has no /camera_2/image_raw" in capsys.readouterr().err
    out = read(tmp_path / "out")
    stamps = [
        msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec for _, msg in out["/attitude"]
    ]
    assert stamps == [START_NS + i * PERIOD_NS for i in range(21, 40)]
    messages = [msg.status[0].message for _, msg in out["/diagnostics"]]
    assert "no frames from camera_2 yet" in messages
    assert messages[-1] == (
        "camera_2 left out: no usable frames for longer than camera_timeout; "
        "no frames from camera_2 yet"
    )


def test_cameras_that_wait_for_each_other(tmp_path: Path) -> None:
    alone = [m for m in recording(40) if "camera_1" in m[0]]
    bag = write_bag(tmp_path / "in", alone)
    waiting = write_parameters(tmp_path / "waiting.yaml", camera_timeout=0.0)
    assert run(bag, tmp_path / "out", "--params", waiting) == 0
    out = read(tmp_path / "out")
    assert out["/attitude"] == []
    assert out["/diagnostics"][-1][1].status[0].message == "no frames from camera_2 yet"


def test_the_last_counts_are_in_the_bag(tmp_path: Path, flight: Path, params: Path) -> None:
    assert run(flight, tmp_path / "out", "--params", params) == 0
    last = {msg.status[0].name: (t, msg) for t, msg in read(tmp_path / "out")["/diagnostics"]}
    assert len(last) == 2
    for time_ns, msg in last.values():
        values = {pair.key: pair.value for pair in msg.status[0].values}
        assert (values["frames"], values["fixes"]) == ("10", "5")
        # That of the last message, not of any clock.
        assert time_ns == START_NS + 4 * PERIOD_NS + 1_500_000


def test_diagnostics_in_bag_time(tmp_path: Path, params: Path) -> None:
    # Five pairs, a long silence, and two more.
    year = 365 * 24 * 3600 * 10**9
    messages = recording(5) + recording(2, START_NS + year)
    bag = write_bag(tmp_path / "in", messages)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    out = read(tmp_path / "out")
    times = [t for t, _ in out["/diagnostics"]]
    assert times == sorted(times)
    assert 6 < len(times) < 30
    seen = states(tmp_path / "out")
    assert seen[:3] == ["waiting", "waiting", "ok"]
    assert "stale" in seen
    assert seen[-1] == "ok"
    for stamp, msg in out["/diagnostics"]:
        assert msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec == stamp
        keys = {pair.key for pair in msg.status[0].values}
        assert not keys & {"latency_ms", "latency_max_ms", "rate_hz"}


def test_parameters_that_cannot_be(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert "camera_1.rotation is not set" in refused(capsys, flight, out)
    assert "No such file" in refused(capsys, flight, out, "--params", tmp_path / "none.yaml")
    bad = write_parameters(tmp_path / "bad.yaml", planet_radius=-1.0)
    assert "planet_radius" in refused(capsys, flight, out, "--params", bad)
    tf = write_parameters(tmp_path / "tf.yaml", extrinsics_source="tf")
    assert "tf" in refused(capsys, flight, out, "--params", tf)
    arguments = ["--params", params, "--remap", "nonsense"]
    assert "FROM:=TO" in refused(capsys, flight, out, *arguments, code=2)
    assert not out.exists()


def test_parameters_are_those_of_a_live_node(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As ROS takes them: of a name that is there twice the last value, and null as a word; but no
    list of whole numbers and decimals.
    """
    params, out = tmp_path / "params.yaml", tmp_path / "out"
    head = "/**:\n  ros__parameters:\n"
    rotations = "".join(f"    {name}.rotation: {q}\n" for name, q in QUATERNIONS.items())
    params.write_text(f"{head}    base_frame: a\n{rotations}{head}    base_frame: null\n")
    assert run(flight, out, "--params", params) == 0
    assert {msg.header.frame_id for _, msg in read(out)["/local_vertical"]} == {"null"}
    params.write_text(f"{head}    camera_1.rotation: [0, 0.6, 0.8, 0.0]\n")
    told = refused(capsys, flight, tmp_path / "none", "--params", params)
    assert f"{params}: camera_1.rotation (of /**) mixes whole numbers and decimals" in told


def test_a_node_that_cannot_be_is_said_and_left_out(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "params.yaml"
    one = f"    cameras: [camera_1]\n    camera_1.rotation: {QUATERNIONS['camera_1']}\n"
    params.write_text(f"attitude_node:\n  ros__parameters:\n{one}")
    assert run(flight, tmp_path / "out", "--params", params) == 0
    assert set(read(tmp_path / "out")) == {"/attitude", "/diagnostics"}
    said = capsys.readouterr().err.splitlines()
    assert sum("left out, local_vertical_node: camera_1.rotation is not" in s for s in said) == 1
    # Cameras that cannot be are known before the bag is looked into.
    nameless = "local_vertical_node:\n  ros__parameters:\n    cameras: ['']\n"
    params.write_text(f"attitude_node:\n  ros__parameters:\n{one}{nameless}")
    assert run(flight, tmp_path / "again", "--params", params) == 0
    assert "left out, local_vertical_node: cameras has ''" in capsys.readouterr().err
    assert (tmp_path / "again").is_dir()


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        ("attitude_node:camera_1/image_raw:=/left", "leave out what names a node (NODE:, ~ or __)"),
        ("~/debug_image:=/picture", "leave out what names a node"),
        ("imu:=~/imu", "leave out what names a node"),
        ("__ns:=/flight", "leave out what names a node"),
        ("camera_1/image_raw:=/left image", "'/left image' is no name of a topic"),
        ("camera_1//image_raw:=/left", "'camera_1//image_raw' is no name of a topic"),
        ("imu:=/2nd/imu", "'/2nd/imu' is no name of a topic"),
        ("imu:=imu/", "'imu/' is no name of a topic"),
        ("imu:=/", "'/' is no name of a topic"),
    ],
)
def test_remappings_that_cannot_be(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str], rule: str, words: str
) -> None:
    told = refused(capsys, flight, tmp_path / "out", "--remap", rule, code=2)
    assert told.startswith(f"horizon_replay: --remap {rule}: ")
    assert words in told
    assert told.count("\n") == 1


def test_a_remapping_that_does_nothing_is_said(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rules = ["--remap", "camera_1/image:=/left", "--remap", "camera_2/image_raw:=/right"]
    assert run(flight, tmp_path / "out", "--params", params, *rules) == 0
    told = capsys.readouterr().err
    assert "--remap /camera_1/image:=/left does nothing" in told
    assert "/right does nothing" not in told


def test_remappings_of_two_topics_onto_one_are_said(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rule = ["--remap", "camera_2/image_raw:=camera_1/image_raw"]
    assert run(flight, tmp_path / "out", "--params", params, *rule) == 0
    told = "--remap: /camera_1/image_raw and /camera_2/image_raw are all /camera_1/image_raw\n"
    assert told in capsys.readouterr().err
    swapped = [*rule, "--remap", "camera_1/image_raw:=camera_2/image_raw"]
    assert run(flight, tmp_path / "other", "--params", params, *swapped) == 0
    assert " are all " not in capsys.readouterr().err


def test_a_namespace_that_cannot_be(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = refused(capsys, flight, tmp_path / "out", "--namespace", "my craft", code=2)
    assert told == "horizon_replay: --namespace 'my craft' is no namespace\n"


def test_the_nodes_of_the_one_process_are_those_that_are_replayed(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = write_parameters(tmp_path / "params.yaml", nodes=["attitude_node"])
    assert run(flight, tmp_path / "out", "--params", params) == 0
    assert set(read(tmp_path / "out")) == {"/attitude", "/diagnostics"}
    params = write_parameters(tmp_path / "params.yaml", nodes=["altitude_node"])
    told = refused(capsys, flight, tmp_path / "none", "--params", params)
    assert "params.yaml: nodes must be some of local_vertical_node" in told


def test_unknown_parameters_are_said(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = write_parameters(
        tmp_path / "params.yaml", planet_raduis=1.0, camera1={"gamma": 2.2}, zzz=1
    )
    assert run(flight, tmp_path / "out", "--params", params) == 0
    errors = capsys.readouterr().err
    for told in (
        "planet_raduis is ignored; did you mean planet_radius?",
        "camera1.gamma is ignored; did you mean camera_1.gamma?",
        f"zzz is ignored ({params})",
    ):
        assert errors.count(f"unknown parameter {told}") == 1


def test_a_misspelt_node_is_said(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sections of other nodes, a camera's driver, are not."""
    params = write_parameters(tmp_path / "params.yaml")
    sections = "atitude_node: {ros__parameters: {level_z: down}}\n"
    params.write_text(params.read_text() + sections + sections.replace("atitude_node", "driver"))
    assert run(flight, tmp_path / "out", "--params", params) == 0
    told = capsys.readouterr().err
    assert "section atitude_node is for no node: attitude_node?" in told
    assert "driver" not in told


def test_a_recording_that_was_cut_off_is_told_how_to_save(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    (file,) = flight.glob("*.mcap")
    cut = tmp_path / "cut"
    cut.mkdir()
    shutil.copy(file, cut)
    told = refused(capsys, cut, out, "--params", params)
    assert f"give {file.name} itself, or make one with `ros2 bag reindex`" in told
    assert run(cut / file.name, out, "--params", params) == 0
    (cut / file.name).write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    told = refused(capsys, cut / file.name, tmp_path / "none", "--params", params)
    assert "`mcap recover`" in told
    # Of what never was one nothing can be saved.
    (cut / file.name).write_bytes(b"noise" * 100)
    told = refused(capsys, cut / file.name, tmp_path / "none", "--params", params)
    assert "recover" not in told


def test_bags_that_are_none(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"

    def said(path: Path) -> str:
        message = refused(capsys, path, out, "--params", params)
        assert str(path) in message
        assert not out.exists()
        return message

    assert "there is no bag" in said(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    told = said(tmp_path / "empty")
    assert "cannot be read as a rosbag2" in told
    assert "neither a metadata.yaml nor an .mcap or .db3" in told
    shutil.copytree(flight, tmp_path / "flights" / "monday")
    assert f"give {tmp_path / 'flights' / 'monday'}" in said(tmp_path / "flights")
    text = tmp_path / "notes.txt"
    text.write_text("not a bag")
    assert "cannot be read as a rosbag2" in said(text)
    for suffix in (".mcap", ".db3"):
        for content in (b"", b"not a bag" * 100):
            file = tmp_path / f"file{suffix}"
            file.write_bytes(content)
            assert "cannot be read as a rosbag2" in said(file) or "none of the topics" in said(file)
    broken = tmp_path / "broken"
    shutil.copytree(flight, broken)
    (broken / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    assert "cannot be read as a rosbag2" in said(broken)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("", "its metadata.yaml is empty"),
        ("rosbag2_bagfile_information: [", "its metadata.yaml is not valid YAML"),
        ("\0" * 512, "its metadata.yaml is not valid YAML"),
        ("noise", "has no rosbag2_bagfile_information"),
        ("rosbag2_bagfile_information: {version: 9}", "metadata"),
    ],
)
def test_a_bag_whose_metadata_is_spoilt_is_told_how_to_make_it_anew(
    tmp_path: Path,
    params: Path,
    capsys: pytest.CaptureFixture[str],
    storage: str,
    content: str,
    fault: str,
) -> None:
    bag = write_bag(tmp_path / "in", recording(1), storage)
    (bag / "metadata.yaml").write_text(content)
    told = refused(capsys, bag, tmp_path / "out", "--params", params)
    assert fault in told
    (file,) = {*bag.iterdir()} - {bag / "metadata.yaml"}
    again = f"; `ros2 bag reindex {bag}` makes metadata.yaml anew, or give {file.name} itself\n"
    assert told.endswith(again)
    assert "recover" not in told
    assert run(file, tmp_path / "out", "--params", params) == 0


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.999])
def test_a_bag_cut_short(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str], storage: str, share: float
) -> None:
    bag = write_bag(tmp_path / "in", recording(3), storage)
    (file,) = [f for f in bag.iterdir() if f.suffix in (".mcap", ".db3")]
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    message = refused(capsys, bag, tmp_path / "out", "--params", params)
    assert "horizon_replay: " in message
    assert not (tmp_path / "out").exists()


def test_a_bag_that_lists_more_than_it_has_is_said(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, longer = (write_bag(tmp_path / str(n), recording(n)) for n in (2, 5))
    metadata = (longer / "metadata.yaml").read_text().replace("5.mcap", "2.mcap")
    (bag / "metadata.yaml").write_text(metadata)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    assert f"{bag} lists 12 messages more than it has" in capsys.readouterr().err
    # rosbags takes topics of another quality of service than in the file for others.
    profile = "history: keep_last, depth: 5, reliability: best_effort, durability: volatile"
    times = "deadline: {}, lifespan: {}, liveliness_lease_duration: {}".format(
        *["{sec: 0, nsec: 0}"] * 3
    )
    rest = "liveliness: automatic, avoid_ros_namespace_conventions: false"
    profiles = f"offered_qos_profiles: [{{{profile}, {times}, {rest}}}]"
    (longer / "metadata.yaml").write_text(
        (longer / "metadata.yaml").read_text().replace("offered_qos_profiles: []", profiles)
    )
    assert run(longer, tmp_path / "nothing", "--params", params) == 0
    assert f"{longer} lists 20 messages more than it has" in capsys.readouterr().err
    assert run(longer / "5.mcap", tmp_path / "all", "--params", params) == 0
    assert "more than it has" not in capsys.readouterr().err


def test_an_error_without_words_is_named() -> None:
    # As of a damaged bag that says that terabytes follow.
    assert in_one_line(MemoryError()) == "MemoryError"
    assert in_one_line(ValueError("two\n lines")) == "two lines"


def test_a_bag_without_the_topics_is_told_what_it_has(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "in", [("/chatter", 5, String(data="hello"))])
    message = refused(capsys, bag, tmp_path / "out", "--params", params)
    assert "/chatter (std_msgs/msg/String)" in message
    assert "/camera_2/camera_info (sensor_msgs/msg/CameraInfo)" in message


def test_what_would_help_where_topics_are_missing_is_said(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a remapped image the camera_info was forgotten; compressed images have their own."""
    elsewhere = [(f"/left{topic}", t, msg) for topic, t, msg in recording(1)]
    bag = write_bag(tmp_path / "elsewhere", elsewhere)
    remap = ["--remap", "camera_1/image_raw:=/left/camera_1/image_raw"]
    assert run(bag, tmp_path / "out", "--params", params, *remap) == 0
    errors = capsys.readouterr().err
    assert "has no /camera_1/camera_info" in errors
    assert "--remap FROM:=TO for each topic, or the cameras' names" in errors

    name = "/camera_1/squeezed"
    squeezed = [
        (name, t, CompressedImage(format="jpeg"))
        if topic == "/camera_1/image_raw"
        else (topic, t, msg)
        for topic, t, msg in recording(1)
    ]
    bag = write_bag(tmp_path / "squeezed", squeezed)
    assert run(bag, tmp_path / "out2", "--params", params) == 0
    errors = capsys.readouterr().err
    assert f"NAME/compressed, as by image_transport: not {name}." in errors
    assert "--remap" not in errors


def test_a_topic_that_is_there_as_something_else_is_said(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = [
        (topic, t, CompressedImage() if topic == "/camera_1/image_raw" else msg)
        for topic, t, msg in recording(1)
    ]
    # Of what may be missing too.
    messages.append(("/coarse_pose", messages[0][1], PoseWithCovarianceStamped()))
    bag = write_bag(tmp_path / "bag", messages)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    told = capsys.readouterr().err
    for topic, wanted, there in (
        ("/camera_1/image_raw", "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
        (
            "/coarse_pose",
            "geometry_msgs/msg/PoseStamped",
            "geometry_msgs/msg/PoseWithCovarianceStamped",
        ),
    ):
        assert f"has no {topic} ({wanted}), but {topic} ({there})\n" in told
    assert "/imu" not in told


@pytest.mark.parametrize("encoding", ["mono8", "mono16", "bayer_rggb8", "bgr8", "rgb8"])
def test_compressed_images_are_read_as_what_they_were_made_of(
    tmp_path: Path, params: Path, encoding: str
) -> None:
    flight = [(topic, t, encoded(msg, encoding)) for topic, t, msg in recording(3)]
    plain = write_bag(tmp_path / "plain", flight)
    squeezed = write_bag(tmp_path / "squeezed", compressed_recording(flight))
    for bag in (plain, squeezed):
        assert run(bag, tmp_path / f"{bag.name}_out", "--params", params) == 0
    told, found = (read(tmp_path / f"{bag.name}_out")["/attitude"] for bag in (plain, squeezed))
    assert len(found) == 3
    for (_, one), (_, other) in zip(told, found, strict=True):
        assert one.pose.pose == other.pose.pose
        assert (one.pose.covariance == other.pose.covariance).all()


def test_a_jpeg_and_what_is_none(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As drivers record: a lossy one is near to the plain one; a broken one is counted."""
    flight = recording(4)
    squeezed = compressed_recording(flight, ".jpg")
    broken = next(msg for topic, _, msg in squeezed if topic == "/camera_1/image_raw/compressed")
    broken.data = broken.data[:40]
    bag = write_bag(tmp_path / "squeezed", squeezed)
    assert run(bag, tmp_path / "out", "--params", params) == 0
    told = "skipped on /camera_1/image_raw/compressed: 1\n  1: no image that can be decoded\n"
    assert told in capsys.readouterr().err
    plain = write_bag(tmp_path / "plain", flight)
    assert run(plain, tmp_path / "plain_out", "--params", params) == 0
    told, found = (read(tmp_path / name)["/local_vertical"] for name in ("plain_out", "out"))
    assert len(found) == 3
    for (_, one), (_, other) in zip(told[1:], found, strict=True):
        apart = [getattr(one.vector, axis) - getattr(other.vector, axis) for axis in "xyz"]
        assert np.degrees(np.linalg.norm(apart)) < 0.05


def test_where_a_bag_has_both_the_plain_images_are_read(tmp_path: Path, params: Path) -> None:
    flight = recording(2)
    broken = [
        (f"{topic}/compressed", t, CompressedImage())
        for topic, t, msg in flight
        if isinstance(msg, Image)
    ]
    bag = write_bag(tmp_path / "both", [*flight, *broken])
    assert run(bag, tmp_path / "out", "--params", params) == 0
    assert len(read(tmp_path / "out")["/attitude"]) == 2


def test_nothing_is_overwritten_but_by_force(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(flight, out, "--params", params) == 0
    assert "exists" in refused(capsys, flight, out, "--params", params)
    assert run(flight, out, "--params", params, "--force") == 0
    assert len(read(out)["/attitude"]) == 5
    home = tmp_path / "home"
    home.mkdir()
    (home / "letter.txt").write_text("dear")
    assert "only another bag" in refused(capsys, flight, home, "--params", params, "--force")
    assert "only another bag" in refused(capsys, flight, flight, "--params", params, "--force")
    assert (home / "letter.txt").exists()
    # Before the work: a directory cannot take a link's place.
    link = tmp_path / "link"
    for link_to in (out, tmp_path / "nowhere"):
        link.unlink(missing_ok=True)
        link.symlink_to(link_to)
        told = refused(capsys, flight, link, "--params", params, "--force")
        assert "it is a link" in told
        assert "msg/s" not in told
    assert len(read(out)["/attitude"]) == 5


def test_the_folder_one_is_in_is_not_replaced(
    tmp_path: Path,
    flight: Path,
    params: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """An older bag was removed, and then a bag cannot take the place of the current folder."""
    out = tmp_path / "out"
    assert run(flight, out, "--params", params) == 0
    monkeypatch.chdir(out)
    for here in (".", out, "../out"):
        told = refused(capsys, flight, here, "--params", params, "--force")
        assert "the current folder is in it" in told
    assert len(read(out)["/attitude"]) == 5


def test_no_bag_is_written_into_the_input(
    flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(flight.iterdir())
    told = refused(capsys, flight, flight / "out", "--params", params)
    assert f"would lie in the input, {flight}; choose a place beside it" in told
    assert sorted(flight.iterdir()) == before


def test_an_older_bag_stays_where_the_new_one_cannot_take_its_place(
    tmp_path: Path,
    flight: Path,
    params: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    assert run(flight, out, "--params", params) == 0
    before, rename = sorted(tmp_path.iterdir()), Path.rename

    def failing(self: Path, target: Path) -> Path:
        if self.name == "horizon":
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    told = refused(capsys, flight, out, "--params", params, "--force")
    assert "Input/output error" in told
    assert sorted(tmp_path.iterdir()) == before
    assert len(read(out)["/attitude"]) == 5


def test_where_nothing_can_be_written(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.touch()
    assert "cannot write" in refused(capsys, flight, file / "out", "--params", params)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A directory on a file system with next to no room; needs the right to mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(place)]
    if (
        shutil.which("mount") is None
        or subprocess.run(mount, capture_output=True, check=False).returncode
    ):
        pytest.skip("cannot mount a small file system here")
    yield place
    # Lazily: a storage library may hold its file for a while after failing.
    subprocess.run(["umount", "--lazy", str(place)], check=True)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_full_disk_is_said_and_nothing_left(
    small_disk: Path,
    flight: Path,
    params: Path,
    capsys: pytest.CaptureFixture[str],
    storage: str,
) -> None:
    arguments = ["--params", params, "--storage", storage]
    message = refused(capsys, flight, small_disk / "out", *arguments)
    assert "cannot write" in message
    assert list(small_disk.iterdir()) == []


def test_a_bag_of_aiding_alone_is_no_error(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "in", [("/imu", START_NS, Imu())])
    assert run(bag, tmp_path / "out", "--params", params) == 0
    assert read(tmp_path / "out")["/attitude"] == []
    assert "camera_1/image_raw" in capsys.readouterr().err


def test_a_folder_that_is_gone_is_no_place_that_a_bag_is_in(
    tmp_path: Path, flight: Path, params: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(flight, tmp_path / "out", "--params", params) == 0
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert run(flight, tmp_path / "out", "--params", params, "--force") == 0
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("redirected", ["2>&-", "2>/dev/full", "2>&1 | head -c 1"])
def test_what_cannot_be_printed_costs_no_result(
    tmp_path: Path, flight: Path, params: Path, redirected: str
) -> None:
    script = f'set -o pipefail; "$0" -m "$@" {redirected}'
    module = "horizon_sensor_ros.tools.bags.replay"
    arguments = [sys.executable, module, flight, tmp_path / "out", "--params", params]
    ended = subprocess.run(["bash", "-c", script, *arguments], capture_output=True, check=False)
    assert ended.returncode == 0
    assert len(read(tmp_path / "out")["/attitude"]) == 5


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_leaves_nothing_behind(tmp_path: Path, params: Path, how: int) -> None:
    bag = write_bag(tmp_path / "in", recording(4) * 30)
    out = tmp_path / "new" / "folder" / "out"
    arguments = [str(bag), str(out), "--params", str(params)]
    process = subprocess.Popen(
        [sys.executable, "-m", "horizon_sensor_ros.tools.bags.replay", *arguments],
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    )
    deadline = time.monotonic() + 20
    while not list(out.parent.glob(".out-*")):
        assert time.monotonic() < deadline
        assert process.poll() is None
    process.send_signal(how)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "interrupted, nothing written" in errors
    assert "Traceback" not in errors
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "params.yaml"]


def test_help_names_the_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run("--help")
    assert caught.value.code == 0
    assert "OUT_BAG" in capsys.readouterr().out

"""Results of a bag as tables, from the command line on."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import called, refusal
from csv_tables import table
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped, QuaternionStamped, TwistStamped
from horizon_messages import START_NS, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu
from std_msgs.msg import String

from horizon_sensor_ros.core.mathematics.attitude import level_from_base, quaternion_from_rotation
from horizon_sensor_ros.tools.bags.bag_to_csv import main
from horizon_sensor_ros.tools.bags.message_tables import TABLES

run = partial(called, main)


def refused(capsys: pytest.CaptureFixture[str], *arguments: Any) -> str:
    said = refusal(main, capsys, *arguments)
    assert "horizon_bag_to_csv: " in said
    return said


def pose() -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 34
    message.header.frame_id = "local_level"
    message.pose.pose.position.z = 0.1 + 0.2
    q = Rotation.from_euler("ZYX", [30, -20, 10], degrees=True).as_quat()
    o = message.pose.pose.orientation
    o.x, o.y, o.z, o.w = (float(v) for v in q)
    half = np.arange(36.0).reshape(6, 6)
    message.pose.covariance = (half + half.T).ravel()
    return message


def status(level: bytes, **values: str) -> DiagnosticArray:
    message = DiagnosticArray()
    message.header.stamp.sec = 5
    one = DiagnosticStatus(name="attitude_node: horizon", level=level, message="a, b")
    one.values = [KeyValue(key=k, value=v) for k, v in values.items()]
    message.status = [one]
    return message


def test_a_pose_with_its_covariance(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [("/craft/attitude", START_NS, pose())])
    assert run(bag, tmp_path / "out") == 0
    (row,) = table(tmp_path / "out" / "craft__attitude.csv")
    assert row["stamp_s"] == "12.000000034"
    assert row["frame_id"] == "local_level"
    # Exactly what the message has, to the last bit.
    assert float(row["z_m"]) == 0.1 + 0.2
    assert [float(row[f"{name}_deg"]) for name in ("roll", "pitch", "yaw")] == pytest.approx(
        [10, -20, 30]
    )
    half = np.arange(36.0).reshape(6, 6)
    full = half + half.T
    assert float(row["cov_x_x_m2"]) == full[0, 0]
    assert float(row["cov_z_rot_x_m_rad"]) == full[2, 3]
    assert float(row["cov_rot_y_rot_z_rad2"]) == full[4, 5]
    assert sum(name.startswith("cov_") for name in row) == 21


pitches = st.one_of(
    st.floats(-90, 90),
    st.tuples(st.sampled_from([1.0, -1.0]), st.floats(-16, 0)).map(
        lambda t: t[0] * (90 - 10 ** t[1])
    ),
)


@settings(max_examples=200)
@given(angles=st.tuples(st.floats(-180, 180), pitches, st.floats(-180, 180)))
def test_angles_are_those_of_the_quaternion(angles: tuple[float, float, float]) -> None:
    yaw, pitch, roll = angles[0], angles[1], angles[2]
    rotation = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)
    message = QuaternionStamped()
    q = message.quaternion
    q.x, q.y, q.z, q.w = (float(v) for v in rotation.as_quat())
    (row,) = TABLES["geometry_msgs/msg/QuaternionStamped"].rows(message)
    again = Rotation.from_euler("ZYX", row[-1:-4:-1], degrees=True)
    assert (again * rotation.inv()).magnitude() < 1e-7


@pytest.mark.parametrize("nose", [1.0, -1.0])
@pytest.mark.parametrize("level_z", ["up", "down"])
def test_nose_straight_up_or_down_roll_is_0(nose: float, level_z: str) -> None:
    """As the conventions have it, and as the node says; it was 180 deg, and so was yaw."""
    message = QuaternionStamped()
    q = message.quaternion
    rot = level_from_base(np.array([nose, 0.0, 0.0]), level_z)
    q.x, q.y, q.z, q.w = (float(v) for v in quaternion_from_rotation(rot))
    (row,) = TABLES["geometry_msgs/msg/QuaternionStamped"].rows(message)
    roll, pitch, yaw = row[-3:]
    assert (roll, abs(pitch), yaw) == (0.0, 90.0, 0.0)


def test_a_quaternion_that_is_none_gives_no_angles() -> None:
    # As an IMU without orientation has it.
    (row,) = TABLES["sensor_msgs/msg/Imu"].rows(imu := Imu())
    columns = TABLES["sensor_msgs/msg/Imu"].columns
    assert np.isnan(row[columns.index("pitch_deg")]) == (imu.orientation.w == 0)
    assert len(row) == len(columns) == len(set(columns))


def test_every_table_has_a_value_a_column() -> None:
    message = TwistStamped()
    (row,) = TABLES["geometry_msgs/msg/TwistStamped"].rows(message)
    assert len(row) == len(TABLES["geometry_msgs/msg/TwistStamped"].columns)


def test_diagnostics_have_a_column_a_key(tmp_path: Path) -> None:
    bag = write_bag(
        tmp_path / "bag",
        [
            ("/diagnostics", 1, status(b"\x00", state="ok", fixes="3")),
            ("/diagnostics", 2, status(b"\x02", state="no_fix", reason="too dark")),
        ],
    )
    assert run(bag, tmp_path / "out") == 0
    good, bad = table(tmp_path / "out" / "diagnostics.csv")
    assert (good["level"], good["state"], good["fixes"], good["reason"]) == ("ok", "ok", "3", "")
    assert (bad["level"], bad["reason"], bad["message"]) == ("error", "too dark", "a, b")


def test_diagnostics_tell_two_craft_apart(tmp_path: Path) -> None:
    nodes = ["/craft_a/attitude_node", "/craft_b/attitude_node"]
    messages = [status(b"\x00", state="ok") for _ in nodes]
    for message, node in zip(messages, nodes, strict=True):
        message.status[0].hardware_id = node
    bag = write_bag(tmp_path / "bag", [("/diagnostics", 1, message) for message in messages])
    assert run(bag, tmp_path / "out") == 0
    assert [row["hardware_id"] for row in table(tmp_path / "out" / "diagnostics.csv")] == nodes


def test_only_the_topics_asked_for(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [("/attitude", 1, pose()), ("/truth", 1, pose())])
    assert run(bag, tmp_path / "out", "--topics", "truth") == 0
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["truth.csv"]


def test_unreadable_messages_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    broken = (kind, serialize_message(pose())[:40])
    bag = write_bag(tmp_path / "bag", [("/attitude", 1, pose()), ("/attitude", 2, broken)])
    assert run(bag, tmp_path / "out") == 0
    assert len(table(tmp_path / "out" / "attitude.csv")) == 1
    assert "unreadable messages skipped on /attitude: 1" in capsys.readouterr().err


def test_messages_of_another_type_than_their_topics_table_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", [("/attitude", 1, TwistStamped()), ("/attitude", 2, pose())])
    assert run(bag, tmp_path / "out") == 0
    assert len(table(tmp_path / "out" / "attitude.csv")) == 1
    told = capsys.readouterr().err
    assert "unreadable messages skipped on /attitude: 1" in told
    assert "\n  1: " in told


def test_errors_are_for_a_person(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert "there is no bag" in refused(capsys, tmp_path / "nowhere", out)
    chatter = write_bag(tmp_path / "chatter", [("/chatter", 5, String(data="hello"))])
    said = refused(capsys, chatter, out)
    assert "/chatter (std_msgs/msg/String)" in said
    assert "horizon_replay" in said
    said = refused(capsys, chatter, out, "--topics", "chatter")
    assert "is a std_msgs/msg/String, of which there is no table" in said
    said = refused(capsys, chatter, out, "--topics", "/attitude")
    assert "/attitude is not there" in said
    bag = write_bag(tmp_path / "bag", [("/attitude", 1, pose())])
    assert run(bag, out) == 0
    assert "attitude.csv exists" in refused(capsys, bag, out)
    assert run(bag, out, "--force") == 0
    (tmp_path / "file").touch()
    assert "cannot write" in refused(capsys, bag, tmp_path / "file")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag", "chatter", "file", "out"]

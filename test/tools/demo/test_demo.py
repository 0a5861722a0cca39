"""The demo: its sums against closed forms, its processes, and a short flight as a whole."""

from __future__ import annotations

import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
import uuid
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader

from horizon_sensor_ros.core.mathematics.attitude import (
    nadir_from_roll_pitch,
    rotation_from_quaternion,
)
from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.ros.messages.estimates import pose_message, twist_message
from horizon_sensor_ros.tools.bags.replay import main as replay
from horizon_sensor_ros.tools.command_errors import CommandError
from horizon_sensor_ros.tools.demo import processes as demo_processes
from horizon_sensor_ros.tools.demo.failures import NodeFailedError
from horizon_sensor_ros.tools.demo.flight_past_nodes import slower_than
from horizon_sensor_ros.tools.demo.processes import running_nodes
from horizon_sensor_ros.tools.demo.recording import DemoBag
from horizon_sensor_ros.tools.private_domain import private_domain
from horizon_sensor_ros.tools.report.attitude import attitudes
from horizon_sensor_ros.tools.report.recorded import Recorded
from horizon_sensor_ros.tools.truth.horizon_errors import (
    Truth,
    error_table,
    flight_errors,
)
from horizon_sensor_ros.tools.truth.nees import within_95
from horizon_sensor_ros.tools.truth.target_errors import (
    DELTA_TOPIC,
    POSE_TOPIC,
    TWIST_TOPIC,
    target_errors,
    target_table,
)
from horizon_sensor_ros.tools.truth.topics import (
    TRUTH_TOPICS,
    true_attitude_message,
    true_vertical_message,
)

SIGMA_Z_M, SIGMA_X_RAD, SIGMA_Y_RAD = 400.0, 1e-3, 2e-3


def attitude(roll: float, pitch: float, altitude: float, level_z: str) -> PoseWithCovarianceStamped:
    """Message as a node would send it, written with half angles: Ry(pitch) Rx(roll)."""
    message = PoseWithCovarianceStamped()
    q = message.pose.pose.orientation
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    q.w, q.x, q.y, q.z = cp * cr, cp * sr, sp * cr, -sp * sr
    message.pose.pose.position.z = altitude if level_z == "up" else -altitude
    variances = [1e14, 1e14, SIGMA_Z_M**2, SIGMA_X_RAD**2, SIGMA_Y_RAD**2, 39.0]
    message.pose.covariance = np.diag(variances).ravel()
    return message


@pytest.mark.parametrize("level_z", ["up", "down"])
def test_errors_are_those_put_in(level_z: str) -> None:
    roll, pitch, altitude = 0.3, -0.2, 500e3
    d_roll, d_pitch, d_altitude = 2e-4, -3e-4, 150.0
    truth = Truth(7, 1.5, nadir_from_roll_pitch(roll, pitch, level_z), altitude)
    message = attitude(roll + d_roll, pitch + d_pitch, altitude + d_altitude, level_z)
    vertical = Vector3Stamped()
    vertical.vector.x, vertical.vector.y, vertical.vector.z = truth.nadir_base

    errors = flight_errors([truth], {7: vertical}, {7: message}, level_z)

    assert errors.time_s == pytest.approx([1.5])
    assert errors.vertical_rad == pytest.approx([0.0], abs=1e-12)
    assert errors.roll_rad == pytest.approx([d_roll], abs=1e-9)
    assert errors.pitch_rad == pytest.approx([d_pitch], abs=1e-9)
    assert errors.altitude_m == pytest.approx([d_altitude], abs=1e-6)
    # On the sphere of directions, roll counts with the cosine of pitch.
    across = np.hypot(d_roll * np.cos(pitch), d_pitch)
    assert errors.nadir_rad == pytest.approx([across], rel=1e-3)
    expected = (
        (d_altitude / SIGMA_Z_M) ** 2
        + (d_roll * np.cos(pitch) / SIGMA_X_RAD) ** 2
        + (d_pitch / SIGMA_Y_RAD) ** 2
    )
    assert errors.nees == pytest.approx([expected], rel=1e-2)
    assert errors.roll_sigma_rad == pytest.approx([SIGMA_X_RAD / np.cos(pitch)], rel=1e-2)
    assert errors.pitch_sigma_rad == pytest.approx([SIGMA_Y_RAD])
    assert errors.altitude_sigma_m == pytest.approx([SIGMA_Z_M])


@pytest.mark.parametrize("pitch_deg", [0.0, 60.0, 89.0, 90.0])
def test_nadirs_sigma_does_not_hang_on_how_roll_is_defined(pitch_deg: float) -> None:
    """In the report as in the table of errors; roll's own is large there, but a number."""
    pitch = np.radians(pitch_deg)
    message = attitude(0.0, pitch, 500e3, "up")
    truth = Truth(7, 0.0, nadir_from_roll_pitch(0.0, pitch, "up"), 500e3)
    table = flight_errors([truth], {}, {7: message}, "up")
    report = attitudes(Recorded((), answers={"attitude": {7: message}}))
    assert report is not None
    nadir = pytest.approx([np.hypot(SIGMA_X_RAD, SIGMA_Y_RAD)], rel=1e-9)
    for found in (table, report):
        assert found.nadir_sigma_rad == nadir
        assert found.pitch_sigma_rad == pytest.approx([SIGMA_Y_RAD])
        assert SIGMA_X_RAD <= found.roll_sigma_rad[0] <= 1000 * SIGMA_X_RAD * (1 + 1e-9)
    assert table.roll_sigma_rad == pytest.approx(report.roll_sigma_rad)


def test_table_counts_moments_without_an_answer() -> None:
    nadir = nadir_from_roll_pitch(0.0, 0.0, "down")
    truths = [Truth(stamp, float(stamp), nadir, 500e3) for stamp in range(4)]
    answers = {1: attitude(0.0, 0.0, 501e3, "down")}

    errors = flight_errors(truths, {}, answers, "down")
    table = error_table(errors, np.array([0.05]))

    assert np.isfinite(errors.nadir_rad).tolist() == [False, True, False, False]
    assert "local_vertical 0 of 4 (0%), attitude 1 of 4 (25%)" in table
    assert re.search(r"attitude: altitude +km +1\.0000 +1\.0000 +1\.0000 +0\.4000", table)
    # A mean of one flight is no proof, and the table says so.
    assert "100% of the errors within the 95 % ellipsoid" in table
    assert "errors hang together" in table


def test_share_within_the_ellipsoid_is_that_of_chi_squared() -> None:
    for freedom in (3, 6):
        errors = np.random.default_rng(0).normal(size=(20_000, freedom))
        assert within_95(np.sum(errors**2, axis=1), freedom) == pytest.approx(0.95, abs=0.005)


# ------------------------------------------------------------------------------------ the target

S = 1_000_000_000
# Of (rotation, position), rad and m.
COVARIANCE = np.diag([1e-6, 4e-6, 9e-6, 1e-8, 4e-8, 9e-8])


def motion(turn: list[float], shift: list[float]) -> np.ndarray:
    return pose_matrix(rotation_from_vector(np.array(turn)), np.array(shift))


def flown_target(turn: list[float], shift: list[float]) -> tuple[dict, dict]:
    """Truths and messages of four clouds; the third pose, and what follows from it, is off by a
    small motion about the sensor's axes, and the fourth sets a frame of its own.
    """
    bodies = {k * S: motion([0.1 * k, 0.3, -0.2 * k], [0.1 * k, 0.0, 5.0]) for k in range(4)}
    fixed = motion([0.5, -0.4, 0.2], [0.05, 0.1, -0.2])
    poses = {stamp: body @ fixed for stamp, body in bodies.items()}
    truth = poses[2 * S]
    wrong = truth.copy()
    wrong[:3, :3] = rotation_from_vector(np.array(turn)) @ truth[:3, :3]
    wrong[:3, 3] += shift
    poses[2 * S] = wrong
    poses[3 * S] = bodies[3 * S] @ motion([0.0, 0.0, 1.0], [0.0, 0.0, 0.0])
    messages: dict[str, dict[int, Any]] = {
        POSE_TOPIC: {t: pose_message(p, COVARIANCE, t, "tof") for t, p in poses.items()},
        DELTA_TOPIC: {},
        TWIST_TOPIC: {},
    }
    for k in (1, 2):
        delta = inverse_pose(poses[(k - 1) * S]) @ poses[k * S]
        messages[DELTA_TOPIC][k * S] = pose_message(delta, COVARIANCE, k * S, "p")
    # One second: the true delta in another form, with a known error.
    step = inverse_pose(bodies[0] @ fixed) @ bodies[S] @ fixed
    rate = np.concatenate([vector_from_rotation(step[:3, :3]), step[:3, 3]])
    rate += [0.0, 0.0, 0.01, 0.02, 0.0, 0.0]
    messages[TWIST_TOPIC][S] = twist_message(rate, COVARIANCE, S, "p")
    return bodies, messages


def test_errors_of_the_target_are_those_put_in() -> None:
    turn, shift = [2e-3, 0.0, 0.0], [0.0, 0.0, 3e-4]
    bodies, messages = flown_target(turn, shift)
    errors = target_errors([0.0, 1.0, 2.0, 3.0], bodies, messages)
    assert errors.frames == 2
    assert errors.pose.rotation == pytest.approx([0, 0, 2e-3, 0], abs=1e-9)
    assert errors.pose.shift == pytest.approx([0, 0, 3e-4, 0], abs=1e-12)
    assert errors.pose.nees == pytest.approx([0, 0, 4.0 + 1.0, 0], abs=1e-6)
    assert errors.pose.rotation_sigma == pytest.approx([np.sqrt(14e-6)] * 4)
    assert errors.pose.shift_sigma == pytest.approx([np.sqrt(14e-8)] * 4)
    assert errors.delta.rotation == pytest.approx([np.nan, 0, 2e-3, np.nan], abs=1e-9, nan_ok=True)
    assert errors.twist.rotation[1] == pytest.approx(0.01)
    assert errors.twist.shift[1] == pytest.approx(0.02)
    assert np.isfinite(errors.twist.nees).tolist() == [False, True, False, False]
    table = target_table(errors, np.array([0.02]))
    assert "target/pose 4 of 4 (100%), target frames set: 2" in table
    assert "within the 95 % ellipsoid" in table


@pytest.mark.parametrize(
    ("missing", "poses", "steps"),
    [
        ((), [0, 0, 2e-3, 0], [None, 0, 2e-3, None]),
        # The pose that sets the frame: the next two are in it too.
        ((0,), [None, None, None, 0], [None] * 4),
        # One in the middle: the next step is from there.
        ((1,), [0, None, 2e-3, 0], [None] * 4),
        # The one that sets the second frame.
        ((3,), [0, 0, 2e-3, None], [None, 0, 2e-3, None]),
    ],
)
def test_errors_of_the_target_where_truth_is_missing(
    missing: tuple[int, ...], poses: list[float | None], steps: list[float | None]
) -> None:
    bodies, messages = flown_target([2e-3, 0.0, 0.0], [0.0, 0.0, 0.0])
    known = {stamp: body for stamp, body in bodies.items() if stamp // S not in missing}
    errors = target_errors([stamp / S for stamp in known], known, messages)
    assert errors.frames == 2

    def expected(values: list[float | None]) -> Any:
        kept = [v for k, v in enumerate(values) if k not in missing]
        found = [np.nan if v is None else v for v in kept]
        return pytest.approx(found, abs=1e-9, nan_ok=True)

    assert errors.pose.rotation == expected(poses)
    assert errors.delta.rotation == expected(steps)


def test_a_target_that_was_never_found_still_has_a_table() -> None:
    bodies, _ = flown_target([0.0] * 3, [0.0] * 3)
    nothing: dict[str, dict[int, Any]] = {POSE_TOPIC: {}, DELTA_TOPIC: {}, TWIST_TOPIC: {}}
    errors = target_errors([0.0] * 4, bodies, nothing)
    assert "target/pose 0 of 4 (0%)" in target_table(errors, np.empty(0))


@pytest.mark.parametrize("level_z", ["up", "down"])
def test_the_recorded_truth_is_in_the_convention_of_the_estimates(level_z: str) -> None:
    nadir = nadir_from_roll_pitch(0.3, -0.2, level_z)
    found = attitude(0.3, -0.2, 500e3, level_z)
    truth = true_attitude_message(nadir, 500e3, 7, level_z)
    assert truth.pose.position.z == pytest.approx(found.pose.pose.position.z)
    turns = [
        rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
        for q in (truth.pose.orientation, found.pose.pose.orientation)
    ]
    np.testing.assert_allclose(turns[0], turns[1], atol=1e-12)
    vertical = true_vertical_message(nadir, 7, "base_link").vector
    np.testing.assert_allclose([vertical.x, vertical.y, vertical.z], nadir)


# --------------------------------------------------------------------------------- the processes


def executable(directory: Path, body: str) -> None:
    path = directory / "fake_node"
    path.write_text(f"#!{sys.executable} -S\nimport signal, sys, time\n{body}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


@pytest.fixture
def fake_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(demo_processes, "executable_path", lambda name: tmp_path / name)
    monkeypatch.setattr(demo_processes, "_PATIENCE_S", 1.0)
    return tmp_path


def test_node_that_ends_at_once_is_reported_with_its_last_words(fake_nodes: Path) -> None:
    executable(fake_nodes, "print('no rotation for camera_1', file=sys.stderr); sys.exit(3)")
    said = pytest.raises(NodeFailedError, match=r"(?s)exit code 3.*no rotation for camera_1")
    with said, running_nodes(["fake_node"], [], os.environ, fake_nodes) as nodes:
        nodes[0].process.wait(10)


def test_node_that_does_not_end_is_reported_with_where_it_is(fake_nodes: Path) -> None:
    executable(
        fake_nodes,
        "import faulthandler; faulthandler.enable()\n"
        "def stuck():\n    time.sleep(100)\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN); print('ready', file=sys.stderr); stuck()",
    )
    said = pytest.raises(NodeFailedError, match=r"(?s)fake_node still ran 1 s.*in stuck")
    with said, running_nodes(["fake_node"], [], os.environ, fake_nodes) as nodes:
        deadline = time.monotonic() + 10.0
        while not nodes[0].log.read_bytes() and time.monotonic() < deadline:
            time.sleep(0.01)


@pytest.mark.parametrize(
    "body",
    ["time.sleep(100)", "signal.signal(signal.SIGINT, signal.SIG_IGN); time.sleep(100)"],
    ids=["obedient", "stubborn"],
)
def test_no_process_is_left_when_the_block_raises(fake_nodes: Path, body: str) -> None:
    executable(fake_nodes, body)
    started = []

    def interrupted() -> None:
        with running_nodes(["fake_node", "fake_node"], [], os.environ, fake_nodes) as nodes:
            started.extend(nodes)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(started) == 2
    assert all(node.process.poll() is not None for node in started)


def test_node_that_is_interrupted_while_it_starts_is_not_forgotten(
    fake_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    executable(fake_nodes, "time.sleep(100)")
    started = []

    class InterruptedPopen(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(subprocess, "Popen", InterruptedPopen)

    def interrupted() -> None:
        with running_nodes(["fake_node"], [], os.environ, fake_nodes):
            pytest.fail("the signal was lost")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [process.poll() is not None for process in started] == [True]


def test_domains_are_held_by_one_at_a_time() -> None:
    with private_domain() as first, private_domain() as second, private_domain() as third:
        assert len({first, second, third}) == 3


def processes_with(token: str) -> list[str]:
    """Command lines of the processes whose environment has the token, defunct ones left out."""
    found = []
    for directory in Path("/proc").glob("[0-9]*"):
        try:
            if token.encode() in (directory / "environ").read_bytes():
                found.append((directory / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue  # gone, or somebody else's
    return [line for line in found if line]


def left_over(token: str, patience_s: float = 10.0) -> list[str]:
    """Processes that stay; multiprocessing's own helper goes a moment after its parent."""
    deadline = time.monotonic() + patience_s
    while (found := processes_with(token)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return found


def command(output: Path, *arguments: str) -> list[str]:
    script = "import sys; from horizon_sensor_ros.tools.demo.demo import main; sys.exit(main())"
    return [sys.executable, "-c", script, "--output", str(output), *arguments]


def messages_of(bag: Path, topic: str) -> list[bytes]:
    with Reader(bag) as reader:
        return [bytes(raw) for c, _, raw in reader.messages() if c.topic == topic]


def test_short_flight_prints_errors_and_leaves_a_report_and_a_bag(tmp_path: Path) -> None:
    token = uuid.uuid4().hex
    done = subprocess.run(
        command(tmp_path, "--seconds", "4"),
        env={**os.environ, "DEMO_TEST_TOKEN": token},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert left_over(token) == []
    found = re.search(r"local_vertical \d+ of 20 \((\d+)%\), attitude \d+ of 20", done.stdout)
    assert found is not None, done.stdout
    assert int(found[1]) >= 50
    median_deg = float(re.search(r"attitude: nadir +deg +([\d.]+)", done.stdout)[1])  # type: ignore[index]
    assert median_deg < 0.1
    page = (tmp_path / "report.html").read_text()
    assert str(tmp_path / "report.html") in done.stdout
    assert "Simulated flight of 4 s" in page
    for title in (
        *("Errors against the truth", "What the cameras saw", "Agreement of the cameras"),
        *("Target", "Errors of the target against the truth", "Latency"),
    ):
        assert f"<h2>{title}</h2>" in page
    assert "Two clouds from the front and from above" in page
    assert page.count('alt="frame of camera_1') >= 4
    assert 'src="http' not in page
    found = re.search(r"target/pose (\d+) of 20", done.stdout)
    assert found is not None, done.stdout
    assert int(found[1]) >= 10
    shift_cm = float(re.search(r"target/pose: shift +cm +([\d.]+)", done.stdout)[1])  # type: ignore[index]
    assert shift_cm < 0.2

    bag = tmp_path / "demo"
    for topic, kind in TRUTH_TOPICS.items():
        truths = [deserialize_message(raw, kind) for raw in messages_of(bag, f"/{topic}")]
        assert len({(t.header.stamp.sec, t.header.stamp.nanosec) for t in truths}) == 20
    assert len(messages_of(bag, "/target/points")) == len(messages_of(bag, "/camera_1/image_raw"))
    if int(found[1]) == 20:
        # No cloud was lost on the way: the replay sees what the node saw.
        params = str(tmp_path / "params.yaml")
        assert replay([str(bag), str(tmp_path / "again"), "--params", params]) == 0
        for topic in (POSE_TOPIC, DELTA_TOPIC, TWIST_TOPIC):
            assert messages_of(tmp_path / "again", f"/{topic}") == messages_of(bag, f"/{topic}")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--seed", "-1"], "argument --seed: must be a whole number, not negative, got -1"),
        (["--seed", "x"], "argument --seed: must be a whole number, not negative, got x"),
        (["--rate", "fast"], "argument --rate: must be a positive number, got fast"),
        (["--seconds", "1e12"], "more than 100000 image pairs"),
        (["--seconds", "1", "--rate", "1e9"], "more than 100000 image pairs"),
    ],
)
def test_arguments_that_cannot_be_are_refused(
    tmp_path: Path, arguments: list[str], said: str
) -> None:
    done = subprocess.run(
        command(tmp_path / "out", *arguments), capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert said in done.stderr.splitlines()[-1]
    assert not (tmp_path / "out").exists()


def test_a_rate_that_is_not_kept_is_said() -> None:
    assert slower_than(5.0, 21, 4.0) == slower_than(5.0, 21, 4.1) == ""
    assert slower_than(1000.0, 2, 1.0) == "", "too few to tell"
    assert slower_than(1000.0, 21, 2.0) == (
        "in flight at 10.0 a second, not at --rate 1000: drawing takes longer"
    )


def test_a_place_that_cannot_be_written_to_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = subprocess.run(
        command(tmp_path / "file" / "inside"), capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "cannot write to" in done.stderr
    assert "Errno" not in done.stderr
    assert "--output" in done.stderr
    assert "Traceback" not in done.stderr


def test_only_the_bag_of_an_earlier_flight_is_overwritten(tmp_path: Path) -> None:
    place = tmp_path / "demo"
    place.mkdir()
    (place / "thesis.txt").write_text("mine")
    done = subprocess.run(command(tmp_path), capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"{place} is not replaced: only another bag is" in done.stderr
    (place / "metadata.yaml").write_text("of somebody's bag")
    with pytest.raises(
        CommandError, match=r"thesis\.txt in it is no part of a bag of this package"
    ):
        DemoBag(place, [], "up")
    assert [each.name for each in tmp_path.iterdir()] == ["demo"]
    shutil.rmtree(place)
    for _ in range(2):
        with DemoBag(place, [], "up"):
            pass
    assert sorted(each.name for each in place.iterdir()) == ["horizon.mcap", "metadata.yaml"]


def test_what_came_to_the_bag_s_place_during_the_flight_stays(tmp_path: Path) -> None:
    place = tmp_path / "demo"
    said = pytest.raises(CommandError, match="only another bag")
    with said, DemoBag(place, [], "up"):
        place.mkdir()
        (place / "thesis.txt").write_text("mine")
    assert (place / "thesis.txt").read_text() == "mine"
    assert [each.name for each in tmp_path.iterdir()] == ["demo"]


def test_interrupt_while_it_is_loaded_is_no_traceback(tmp_path: Path) -> None:
    """Sent by what is loaded first of all that takes time."""
    (tmp_path / "numpy.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(30)\n"
    )
    done = subprocess.run(
        command(tmp_path / "output"),
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 130
    assert done.stderr == "horizon_demo: interrupted\n"


def test_interrupt_leaves_no_process(tmp_path: Path) -> None:
    token = uuid.uuid4().hex
    with subprocess.Popen(
        command(tmp_path),
        env={**os.environ, "DEMO_TEST_TOKEN": token},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            deadline = time.monotonic() + 60
            while len([p for p in processes_with(token) if "_node" in p]) < 2:
                assert process.poll() is None
                assert time.monotonic() < deadline
                time.sleep(0.05)
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=30)
        finally:
            process.kill()
    assert process.returncode == 130
    assert said.endswith("horizon_demo: interrupted\n")
    assert "Traceback" not in said
    assert left_over(token) == []


def test_node_that_refuses_its_parameters_fails_the_demo(tmp_path: Path) -> None:
    script = (
        "import sys; from horizon_sensor_ros.tools.demo import demo, flight_past_nodes\n"
        "flight_past_nodes._node_arguments = lambda params: []\n"
        "sys.exit(demo.main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "--output", str(tmp_path), "--seconds", "2"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 1
    assert "camera_1.rotation" in done.stderr
    assert "Traceback" not in done.stderr

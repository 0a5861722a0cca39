"""horizon_self_calibration, from the command line on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from horizon_messages import (
    ALTITUDE_M,
    CAMERAS,
    PARAMETERS,
    PERIOD_NS,
    ROTATIONS,
    START_NS,
    camera_info_of,
    horizon_gray,
    image_of,
    nadir_of,
    write_bag,
)

from horizon_sensor_ros.core.attitude import quaternion_from_rotation, rotation_from_quaternion
from horizon_sensor_ros.core.rigid import rotation_from_vector, vector_from_rotation
from horizon_sensor_ros.ros.parameters.file import read_parameter_file
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.tools.calibration.recording import Horizons
from horizon_sensor_ros.tools.calibration.self_calibration import main

SETS = 16
MISALIGNMENT_DEG = np.array([0.3, -0.2, 0.25])


def stamped(msg: Any, stamp: int, frame_id: str) -> Any:
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    return msg


def nadir_at(index: int) -> np.ndarray:
    return nadir_of(11.0 * np.sin(0.9 * index), 10.0 * np.cos(1.7 * index))


def flight_messages() -> list[tuple[str, int, Any]]:
    """Both cameras, a nadir from another instrument and poses in the frame earth."""
    messages: list[tuple[str, int, Any]] = []
    for index in range(SETS):
        # Far enough apart that each set counts by itself.
        stamp = START_NS + 400 * index * PERIOD_NS
        nadir = nadir_at(index)
        for delay, camera in enumerate(CAMERAS):
            gray = horizon_gray(camera, nadir, seed=2 * index + delay)
            messages.append((f"/{camera}/camera_info", stamp, camera_info_of(stamp, camera)))
            messages.append((f"/{camera}/image_raw", stamp, image_of(gray, stamp, camera)))
        vertical = stamped(Vector3Stamped(), stamp, "base_link")
        vertical.vector.x, vertical.vector.y, vertical.vector.z = map(float, nadir)
        messages.append(("/star_tracker/vertical", stamp, vertical))
        pose = stamped(PoseStamped(), stamp, "earth")
        pose.pose.position.y = 6371000.0 + ALTITUDE_M
        messages.append(("/coarse_pose", stamp, pose))
    return messages


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("flight") / "bag", flight_messages())


@pytest.fixture
def params(tmp_path: Path) -> Path:
    """Parameters that have camera_2 wrong, and more in them than rotations."""
    wrong = rotation_from_vector(-np.radians(MISALIGNMENT_DEG)) @ ROTATIONS["camera_2"]
    first, second = (
        [float(v) for v in quaternion_from_rotation(rot)] for rot in (ROTATIONS["camera_1"], wrong)
    )
    path = tmp_path / "params.yaml"
    content = {
        "/**": {"ros__parameters": {"camera_1.rotation": first, "slop": 0.01}},
        "attitude_node": {"ros__parameters": {"level_z": "down", "camera_2": {"rotation": second}}},
    }
    path.write_text(yaml.safe_dump(content))
    return path


def run(*arguments: Any) -> int:
    return main([str(a) for a in arguments])


def refused(capsys: pytest.CaptureFixture[str], *arguments: Any) -> str:
    assert run(*arguments) == 1
    errors = capsys.readouterr().err
    assert "Traceback" not in errors
    return errors.split("\r")[-1]


def corrected(path: Path, node: str, camera: str) -> np.ndarray:
    settings = horizon_settings(read_parameter_file(path, node)).pipeline
    quaternion = settings.rotations[settings.cameras.index(camera)]
    return rotation_from_quaternion(np.array(quaternion))


def test_a_wrong_rotation_is_found_and_corrected(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "corrected.yaml", tmp_path / "fit.png"
    assert run(flight, "--params", params, "--out", out, "--picture", picture) == 0
    told = capsys.readouterr()
    assert f"written: {out}" in told.err
    rows = {line[:34].strip(): line.split() for line in told.out.splitlines()}
    for axis, truth in zip("xyz", MISALIGNMENT_DEG, strict=True):
        value, sigma, unit, observed = rows[f"camera_2 about {axis}"][-4:]
        assert (unit, observed) == ("deg", "yes")
        assert float(sigma) < 0.02
        assert abs(float(value) - truth) < max(4 * float(sigma), 0.001)
        assert rows[f"camera_1 about {axis}"][-1] == "no"
    assert "how all cameras together sit in the base frame" in told.out
    assert "limb height: it needs the altitude" in told.out
    # Every node gets the same rotations from the file, and keeps what else it had.
    for node in ("attitude_node", "local_vertical_node"):
        turn = corrected(out, node, "camera_2") @ ROTATIONS["camera_2"].T
        assert np.degrees(np.linalg.norm(vector_from_rotation(turn))) < 0.03
        np.testing.assert_allclose(
            corrected(out, node, "camera_1"), ROTATIONS["camera_1"], atol=1e-12
        )
    assert read_parameter_file(out, "attitude_node")["level_z"] == "down"
    assert read_parameter_file(out, "attitude_node")["slop"] == 0.01
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_as_many_frames_wait_for_the_other_cameras_as_the_parameters_say() -> None:
    settings = horizon_settings({**PARAMETERS, "queue_size": 20}).pipeline
    horizons = Horizons(settings, 0, focal=False)
    dark = np.zeros((4, 4), np.uint8)
    for camera in CAMERAS:
        for index in range(13):
            horizons.on_image(camera, image_of(dark, START_NS + index * PERIOD_NS, camera))
    assert len(horizons.sets) == 13


def test_known_altitude_and_attitude_tell_the_rest(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "corrected.yaml"
    options = ("--altitude", "coarse_pose", "--reference", "star_tracker/vertical")
    sure = ("--reference-sigma", "0.01", "--altitude-sigma", "10")
    assert run(flight, "--params", params, "--out", out, *options, *sure) == 0
    told = capsys.readouterr().out
    assert "  - nothing" in told
    assert "camera_1 against the reference" in told
    (height,) = [line.split() for line in told.splitlines() if line.startswith("limb height")]
    assert abs(float(height[-4])) < 4 * float(height[-3])
    assert abs(read_parameter_file(out, "attitude_node")["limb_height"]) < 2000.0


def test_a_fixed_altitude_will_do(
    flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(flight, "--params", params, "--altitude", ALTITUDE_M) == 0
    assert "limb height" in capsys.readouterr().out.split("Not observed")[0]


def test_what_is_wrong_is_said(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "camera_1.rotation is not set" in refused(capsys, flight)
    assert "--params FILE" in refused(capsys, flight)
    assert "there is no bag" in refused(capsys, tmp_path / "none", "--params", params)
    told = refused(capsys, flight, "--params", params, "--out", params)
    assert "params.yaml exists" in told
    told = refused(capsys, flight, "--params", params, "--altitude", "gnss")
    assert "/gnss" in told
    assert "/coarse_pose (geometry_msgs/msg/PoseStamped)" in told
    told = refused(capsys, flight, "--params", params, "--reference", "coarse_pose")
    assert "'earth', not in 'local_level'" in told
    told = refused(capsys, flight, "--params", params, "--max-sigma", "-1")
    assert "max_sigma must be positive" in told
    told = refused(capsys, flight, "--params", params, "--altitude-sigma", "0")
    assert "--altitude-sigma must be positive" in told
    told = refused(capsys, flight, "--params", params, "--interval", "inf")
    assert "--interval must be 0 to" in told


@pytest.mark.parametrize("altitude", ["nan", "inf", "1e30", "-5"])
def test_a_number_that_is_no_altitude_is_refused(
    flight: Path, params: Path, capsys: pytest.CaptureFixture[str], altitude: str
) -> None:
    with pytest.raises(SystemExit) as caught:
        run(flight, "--params", params, "--altitude", altitude)
    assert caught.value.code == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.endswith(f"argument --altitude: must be 0 to 1e+12 m, got {altitude}")


def test_too_few_frames_are_no_calibration(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = write_bag(tmp_path / "short", flight_messages()[:18])
    out = tmp_path / "corrected.yaml"
    told = refused(capsys, short, "--params", params, "--out", out)
    assert "3 of 3 frame sets" in told
    assert "record longer" in told
    assert not out.exists()


def test_one_camera_needs_a_reference(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = rotation_from_vector(-np.radians(MISALIGNMENT_DEG)) @ ROTATIONS["camera_1"]
    quaternion = [float(v) for v in quaternion_from_rotation(wrong)]
    params = tmp_path / "one.yaml"
    content = {"cameras": ["camera_1"], "camera_1.rotation": quaternion}
    params.write_text(yaml.safe_dump({"/**": {"ros__parameters": content}}))
    assert "give --reference TOPIC" in refused(capsys, flight, "--params", params)
    out = tmp_path / "corrected.yaml"
    reference = ("--reference", "star_tracker/vertical", "--reference-sigma", "0.01")
    assert run(flight, "--params", params, "--out", out, *reference) == 0
    turn = corrected(out, "attitude_node", "camera_1") @ ROTATIONS["camera_1"].T
    assert np.degrees(np.linalg.norm(vector_from_rotation(turn))) < 0.1

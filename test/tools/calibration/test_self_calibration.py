"""horizon_self_calibration, from the command line on."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import called, refusal
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from horizon_messages import (
    ALTITUDE_M,
    CAMERAS,
    HEIGHT,
    PARAMETERS,
    PERIOD_NS,
    QUATERNIONS,
    ROTATIONS,
    START_NS,
    WIDTH,
    camera_info_of,
    horizon_gray,
    image_of,
    imu_of,
    nadir_of,
    write_bag,
    write_parameters,
)
from rclpy.serialization import serialize_message

from horizon_sensor_ros.core.mathematics.attitude import (
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, vector_from_rotation
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.corner_blur import LensBlur
from horizon_sensor_ros.core.self_calibration.result import Calibration
from horizon_sensor_ros.core.self_calibration.unknowns import Unknowns
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.parameters.file import read_parameter_file
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.tools.calibration.recording import Horizons, read_recording
from horizon_sensor_ros.tools.calibration.self_calibration import main, parsed
from horizon_sensor_ros.tools.calibration.text import corrected_parameters, lenses_text, untold

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


run = partial(called, main)


def refused(capsys: pytest.CaptureFixture[str], *arguments: Any, code: int = 1) -> str:
    return refusal(main, capsys, *arguments, code=code).split("\r")[-1]


def corrected(path: Path, node: str, camera: str) -> np.ndarray:
    settings = horizon_settings(read_parameter_file(path, node)).pipeline
    quaternion = settings.rotations[settings.cameras.index(camera)]
    return rotation_from_quaternion(np.array(quaternion))


def test_what_is_not_read_is_said(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = flight_messages()
    index = next(i for i, (topic, *_) in enumerate(messages) if topic == "/camera_1/image_raw")
    topic, stamp, msg = messages[index]
    messages[index] = topic, stamp, ("sensor_msgs/msg/Image", serialize_message(msg)[:100])
    messages.append(("/imu", stamp, Vector3Stamped()))
    bag = write_bag(tmp_path / "bag", messages)
    assert run(bag, "--params", params) == 0
    told = capsys.readouterr().err
    assert "unreadable messages skipped on /camera_1/image_raw: 1" in told
    assert "has no /imu (sensor_msgs/msg/Imu), but /imu (geometry_msgs/msg/Vector3Stamped)" in told


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
    assert "No misalignment" not in told.out
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


def test_the_files_are_written_where_the_table_cannot_be_printed(
    tmp_path: Path,
    flight: Path,
    params: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "corrected.yaml"
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        told = refused(capsys, flight, "--params", params, "--out", out)
    assert "cannot write to the standard output: No space left" in told
    assert "ros__parameters" in out.read_text()


def test_both_files_are_written_or_neither(
    tmp_path: Path,
    flight: Path,
    params: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out, picture = tmp_path / "corrected.yaml", tmp_path / "fit.png"
    out.write_text("older")
    both = ("--params", params, "--out", out, "--picture", picture, "--force")

    def cannot(*_: Any, **__: Any) -> None:
        raise ValueError("too large")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", cannot)
    assert "cannot draw fit.png: too large" in refused(capsys, flight, *both)
    assert out.read_text() == "older"
    assert {each.name for each in tmp_path.iterdir()} == {params.name, out.name}


def test_one_file_for_both_is_refused(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for other in ("fit.png", "here/../fit.png"):
        with pytest.raises(SystemExit) as caught:
            run(flight, "--out", tmp_path / "fit.png", "--picture", tmp_path / other)
        assert caught.value.code == 2
        assert "--out and --picture are the same file" in capsys.readouterr().err


def test_swapped_cameras_are_no_misalignment(
    tmp_path: Path, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "swapped.yaml"
    swapped = {
        f"{name}.rotation": QUATERNIONS[other]
        for name, other in zip(CAMERAS, CAMERAS[::-1], strict=True)
    }
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": swapped}}))
    assert run(flight, "--params", path) == 0
    told = capsys.readouterr().out.split("No misalignment: ")[1]
    turn = vector_from_rotation(
        ROTATIONS["camera_2"]
        @ ROTATIONS["camera_1"].T
        @ ROTATIONS["camera_2"]
        @ ROTATIONS["camera_1"].T
    )
    assert told.startswith(
        f"camera_2 would be turned by {np.degrees(np.linalg.norm(turn)):.0f} deg"
    )


def test_what_else_is_told_of_a_camera_stays(tmp_path: Path) -> None:
    told = {"mask": "/m.png", "readout": 0.02, "gamma": 2.2, "corner_blur": 0.3}
    dotted = {f"camera_2.{name}": value for name, value in told.items()}
    content = {
        "/**": {"ros__parameters": {"camera_1": {"rotation": [0.0, 0.0, 1.0, 0.0], **told}}},
        "attitude_node": {
            "ros__parameters": {
                **dotted,
                "camera_2.rotation": [0.0, 0.0, 1.0, 0.0],
                "camera_1": {"rotation": [0.0, 0.0, 1.0, 0.0], "gamma": 1.8},
            }
        },
    }
    source, out = tmp_path / "params.yaml", tmp_path / "corrected.yaml"
    source.write_text(yaml.safe_dump(content))
    unknowns = Unknowns(CAMERAS)
    nothing = np.zeros(len(unknowns))
    calibration = Calibration(
        Status.OK, "", unknowns, nothing, np.diag(nothing), nothing, (), ROTATIONS, ()
    )
    out.write_text(corrected_parameters(source, calibration, Planet()))
    values = read_parameter_file(out, "attitude_node")
    expected = {f"{camera}.{name}": v for camera in CAMERAS for name, v in told.items()}
    expected["camera_1.gamma"] = 1.8
    assert {name: values[name] for name in expected} == expected
    for camera in CAMERAS:
        assert values[f"{camera}.rotation"] == pytest.approx(QUATERNIONS[camera])
    assert read_parameter_file(out, "local_vertical_node")["camera_1.gamma"] == 2.2
    for empty in ("/**:", "/**: {ros__parameters: }"):
        source.write_text(f"{empty}\nattitude_node: {{ros__parameters: {{slop: 0.01}}}}\n")
        out.write_text(corrected_parameters(source, calibration, Planet()))
        values = read_parameter_file(out, "attitude_node")
        assert values["slop"] == 0.01
        assert values["camera_2.rotation"] == pytest.approx(QUATERNIONS["camera_2"])


def test_parameters_of_one_node_will_do(tmp_path: Path, flight: Path, params: Path) -> None:
    for node in ("attitude_node", "local_vertical_node"):
        rotations = {f"{camera}.rotation": QUATERNIONS[camera] for camera in CAMERAS}
        params.write_text(yaml.safe_dump({node: {"ros__parameters": rotations}}))
        arguments = parsed([str(flight), "--params", str(params)])
        assert len(read_recording(arguments, bool).sets) == SETS


def test_as_many_frames_wait_for_the_other_cameras_as_the_parameters_say() -> None:
    settings = horizon_settings({**PARAMETERS, "queue_size": 20}).pipeline
    horizons = Horizons(settings, 0, focal=False)
    dark = np.zeros((4, 4), np.uint8)
    for camera in CAMERAS:
        for index in range(13):
            horizons.on_image(camera, image_of(dark, START_NS + index * PERIOD_NS, camera))
    assert len(horizons.sets) == 13


@pytest.mark.parametrize(("interval", "taken"), [(0.0, 12), (1.0, 12), (2.0, 6), (2.5, 4)])
def test_one_set_in_so_long_is_used(interval: float, taken: int) -> None:
    """At intervals of whole periods, the set that comes when the next one is due."""
    settings = horizon_settings(PARAMETERS).pipeline
    horizons = Horizons(settings, round(interval * PERIOD_NS), focal=False)
    dark = np.zeros((4, 4), np.uint8)
    for index in range(12):
        for camera in CAMERAS:
            horizons.on_image(camera, image_of(dark, START_NS + index * PERIOD_NS, camera))
    assert len(horizons.sets) == taken


def rolling_gray(camera: str, nadir: np.ndarray, rate: np.ndarray, readout_s: float) -> np.ndarray:
    """Frame of a craft that turns while it is read out; nadir (3,) at the first row's time."""
    gray = np.empty((HEIGHT, WIDTH), np.uint8)
    for rows in np.array_split(np.arange(HEIGHT), 24):
        after_s = readout_s * rows.mean() / (HEIGHT - 1)
        # What stands still turns backwards in the craft's axes.
        now = rotation_from_vector(-after_s * rate) @ nadir
        gray[rows] = horizon_gray(camera, now)[rows]
    return gray


@pytest.mark.parametrize("gyro", [True, False])
def test_rows_that_are_read_out_in_turn_are_told_apart_by_the_gyro(
    tmp_path: Path, gyro: bool
) -> None:
    rate, readout_s = np.array([0.2, 0.3, 0.0]), 0.02
    nadir = nadir_of(3.0, -2.0)
    messages: list[tuple[str, int, Any]] = []
    if gyro:
        stamps = range(START_NS - 20_000_000, START_NS + 1, 5_000_000)
        messages += [("/imu", stamp, imu_of(stamp, rate)) for stamp in stamps]
    for camera in CAMERAS:
        image = image_of(rolling_gray(camera, nadir, rate, readout_s), START_NS, camera)
        info = camera_info_of(START_NS, camera)
        messages.append((f"/{camera}/camera_info", START_NS + 1, info))
        messages.append((f"/{camera}/image_raw", START_NS + 2, image))
    bag = write_bag(tmp_path / "bag", messages)
    readouts = {f"{camera}.readout": readout_s for camera in CAMERAS}
    params = write_parameters(tmp_path / "params.yaml", **readouts)
    arguments = parsed([str(bag), "--params", str(params)])
    (found,) = read_recording(arguments, bool).sets
    errors = [
        np.degrees(np.linalg.norm(ROTATIONS[each.camera] @ each.nadir_cam - nadir))
        for each in found.horizons
    ]
    assert len(errors) == 2
    assert (max(errors) < 0.05) == gyro, errors


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
    # Before the work, not after it.
    told = refused(capsys, flight, "--params", params, "--picture", tmp_path / "fit.xyz", code=2)
    assert "fit.xyz must end in one of" in told
    told = refused(capsys, flight, "--params", params, "--out", params / "corrected.yaml")
    assert "--out: cannot write" in told
    told = refused(capsys, flight, "--params", params, "--altitude", "gnss")
    assert "/gnss" in told
    assert "/coarse_pose (geometry_msgs/msg/PoseStamped)" in told
    told = refused(capsys, flight, "--params", params, "--reference", "coarse_pose")
    assert "'earth', not in 'local_level'" in told
    told = refused(capsys, flight, "--params", params, "--max-sigma", "-1", code=2)
    assert "max_sigma must be positive" in told
    uncertain = ("--altitude", "5e5", "--altitude-sigma", "0")
    told = refused(capsys, flight, "--params", params, *uncertain, code=2)
    assert "--altitude-sigma must be positive" in told
    told = refused(capsys, flight, "--params", params, "--interval", "inf", code=2)
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


@pytest.mark.parametrize("name", ["altitude", "reference"])
def test_a_sigma_of_what_is_not_given_is_refused(
    flight: Path, params: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    with pytest.raises(SystemExit) as caught:
        run(flight, "--params", params, f"--{name}-sigma", "1")
    assert caught.value.code == 2
    assert f"--{name}-sigma has no effect without --{name}" in capsys.readouterr().err


@pytest.mark.parametrize("frame_id", ["imu_link", ""])
@pytest.mark.parametrize("kind", ["vector", "imu"])
def test_a_reference_in_another_frame_is_named(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str], kind: str, frame_id: str
) -> None:
    """As if it were of the base frame it would turn all cameras by the instrument's mounting."""
    vertical = stamped(Vector3Stamped(), START_NS, frame_id)
    msg = vertical if kind == "vector" else imu_of(START_NS, np.zeros(3), frame_id)
    bag = write_bag(tmp_path / "bag", [*flight_messages()[:4], ("/other", START_NS, msg)])
    told = refused(capsys, bag, "--params", params, "--reference", "other")
    assert f"/other: its {'vectors' if kind == 'vector' else 'measurements'} are in" in told
    assert f"{frame_id!r}, not in 'base_link'" in told


def test_too_few_frames_are_no_calibration(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = write_bag(tmp_path / "short", flight_messages()[:18])
    out = tmp_path / "corrected.yaml"
    told = refused(capsys, short, "--params", params, "--out", out)
    assert "3 of 3 frame sets" in told
    assert "record longer" in told
    assert not out.exists()


def test_what_is_told_of_mountings_is_what_is_to_be_found(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Until they are calibrated `mounting_sigma` is set: the calibration is the same with it."""
    content = yaml.safe_load(params.read_text())
    content["/**"]["ros__parameters"] |= {"mounting_sigma": 0.005, "limb_height_sigma": 3e3}
    uncertain = tmp_path / "uncertain.yaml"
    uncertain.write_text(yaml.safe_dump(content))
    told = []
    for path in (params, uncertain):
        assert run(flight, "--params", path) == 0
        told.append([x for x in capsys.readouterr().out.splitlines() if x.startswith("camera_")])
    assert told[0] == told[1]


def test_a_topic_that_tells_nothing_is_named(
    tmp_path: Path, flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # It is in the bag, and even read, but as something else.
    told = refused(capsys, flight, "--params", params, "--reference", "camera_1/image_raw")
    assert "lacks:\n  /camera_1/image_raw (" in told
    late = stamped(Vector3Stamped(), START_NS + 10**13, "base_link")
    late.vector.z = 1.0
    bag = write_bag(tmp_path / "bag", [*flight_messages()[:12], ("/other", START_NS, late)])
    told = refused(capsys, bag, "--params", params, "--reference", "other")
    assert "/other tells nothing within 2 s of any frame" in told
    told = refused(capsys, flight, "--params", params, "--altitude", "500")
    assert "is it in metres above the surface" in told


def test_stamps_that_are_apart_are_said(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = []
    for topic, stamp, msg in flight_messages():
        late = 50_000_000 if "camera_2" in topic else 0
        if late:
            stamped(msg, stamp + late, msg.header.frame_id)
        messages.append((topic, stamp + late, msg))
    bag = write_bag(tmp_path / "apart", messages)
    told = refused(capsys, bag, "--params", params)
    assert "stamps lie farther apart than slop" in told
    assert "images without a partner within slop: " in told


def test_what_the_sigmas_do_not_hold_is_said(
    flight: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(flight, "--params", params) == 0
    told = capsys.readouterr().out
    assert "The planet was a sphere. The Earth is flattened" in told
    assert "Lenses are taken as exact" in told
    assert "have no say, between" not in told
    assert run(flight, "--params", params, "--focal") == 0
    assert "belongs into camera_info" in capsys.readouterr().out


def test_a_wrong_focal_length_in_camera_info_is_named(
    tmp_path: Path, params: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Held fixed it would go into the mountings; --focal finds both."""
    messages = flight_messages()
    for topic, _, msg in messages:
        if topic == "/camera_2/camera_info":
            for at in (0, 4):
                msg.k[at] *= 1.01
                msg.p[at + at // 4] *= 1.01
    bag = write_bag(tmp_path / "bag", messages)
    out = tmp_path / "corrected.yaml"
    told = refused(capsys, bag, "--params", params, "--out", out)
    assert "show camera_2's focal length " in told
    assert " % shorter than it is told to be" in told
    assert "set their camera_info right, or give --focal" in told
    assert not out.exists()
    assert run(bag, "--params", params, "--out", out, "--focal", "--max-sigma", "0.5") == 0
    (focal,) = (
        line.split()
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("focal length of camera_2")
    )
    value, sigma = float(focal[4]), float(focal[5])
    assert abs(value - 100.0 * (1.0 / 1.01 - 1.0)) < 4.0 * sigma
    turn = corrected(out, "attitude_node", "camera_2") @ ROTATIONS["camera_2"].T
    assert np.degrees(np.linalg.norm(vector_from_rotation(turn))) < 0.1


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


@pytest.fixture
def one_camera(tmp_path: Path) -> Path:
    path = tmp_path / "one.yaml"
    content = {
        "cameras": ["camera_1"],
        "camera_1.rotation": QUATERNIONS["camera_1"],
        # Its pixels are too large for air, if there were any, to be told from blur.
        "planet_air": False,
    }
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": content}}))
    return path


def test_of_one_camera_its_lens_is_told(
    tmp_path: Path, flight: Path, one_camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """That of the simulated frames blurs evenly."""
    assert "--lenses for its lens alone" in refused(capsys, flight, "--params", one_camera)
    out = tmp_path / "told.yaml"
    assert run(flight, "--params", one_camera, "--lenses", "--out", out) == 0
    told = capsys.readouterr().out
    (row,) = (line.split() for line in told.splitlines() if line.startswith("camera_1 blur"))
    value, sigma, unit, observed = row[-4:]
    assert (unit, observed) == ("px", "yes")
    assert abs(float(value)) < 3.0 * float(sigma) < 0.1
    assert "camera_1 about x" not in told
    values = read_parameter_file(out, "attitude_node")
    assert values["camera_1.corner_blur"] == pytest.approx(max(float(value), 0.0), abs=1e-9)
    assert values["camera_1.rotation"] == QUATERNIONS["camera_1"]


def test_where_no_limb_shows_a_lens_nothing_is_written(
    tmp_path: Path, flight: Path, one_camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "told.yaml"
    options = ("--lenses", "--interval", "200", "--out", out)
    told = refused(capsys, flight, "--params", one_camera, *options)
    assert "no lens is told. camera_1: " in told
    assert "limbs beside different clouds show it, 8 are needed" in told
    assert not out.exists()


@pytest.mark.parametrize(
    "option",
    [
        ("--drift",),
        ("--focal",),
        ("--altitude", "5e5"),
        ("--max-sigma", "0.2"),
        ("--picture", "fit.png"),
    ],
)
def test_what_tells_nothing_of_lenses_is_refused(
    flight: Path, option: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        run(flight, "--lenses", *option)
    assert stopped.value.code == 2
    assert f"{option[0]} has no effect with --lenses" in capsys.readouterr().err


def lens(camera: str, blur_px: float, sigma_px: float = 0.04) -> LensBlur:
    return LensBlur(camera, blur_px, sigma_px, 30)


def test_a_lens_is_told_only_where_nothing_is_told_of_it(
    tmp_path: Path, flight: Path, params: Path
) -> None:
    recording = read_recording(parsed([str(flight), "--params", str(params)]), bool)
    told = {"camera_1": 0.2, "camera_2": None, "camera_3": None}
    lenses = [lens("camera_1", 0.3), lens("camera_2", 0.25), lens("camera_3", 0.3, 0.2)]
    assert untold(lenses, replace(recording, corner_blur_px=told)) == [lenses[1]]
    source, out = tmp_path / "before.yaml", tmp_path / "told.yaml"
    content = {
        "/**": {"ros__parameters": {"camera_1.corner_blur": 0.2}},
        "attitude_node": {"ros__parameters": {"camera_2": {"corner_blur": -1.0}}},
        # Of another program, whose parameters are its own.
        "viewer": {"ros__parameters": {"camera_2.corner_blur": "soft"}},
    }
    source.write_text(yaml.safe_dump(content))
    out.write_text(corrected_parameters(source, None, Planet(), [lenses[1]]))
    values = read_parameter_file(out, "attitude_node")
    assert values["camera_1.corner_blur"] == 0.2
    assert values["camera_2.corner_blur"] == 0.25
    assert read_parameter_file(out, "viewer")["camera_2.corner_blur"] == "soft"
    # Sharper corners no parameter tells.
    out.write_text(corrected_parameters(None, None, Planet(), [lens("camera_1", -0.2)]))
    assert read_parameter_file(out, "attitude_node")["camera_1.corner_blur"] == 0.0


def test_lenses_that_are_not_as_told_are_named(flight: Path, params: Path) -> None:
    recording = read_recording(parsed([str(flight), "--params", str(params)]), bool)

    def said(blur_px: float, told_px: float | None) -> str:
        told = replace(recording, corner_blur_px={"camera_1": told_px})
        return lenses_text([lens("camera_1", blur_px)], told)

    assert "camera_1's lens blurs 0.30 px more in its corners" in said(0.3, None)
    assert "camera_1's lens blurs 0.30 px less in its corners" in said(-0.3, None)
    assert "is told as 0.10 px, and its limbs show 0.30 +- 0.04 px" in said(0.3, 0.1)
    for blur_px, told_px in ((0.1, None), (0.3, 0.25), (0.01, 0.0)):
        text = said(blur_px, told_px)
        assert "corners, which" not in text
        assert "is told as" not in text

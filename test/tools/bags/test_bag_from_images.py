"""Frames in folders to a bag, from the command line on, and on to estimates and their tables."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from commands import called, refusal
from csv_tables import table
from horizon_messages import (
    ALTITUDE_M,
    CAMERAS,
    FOCAL_PX,
    HEIGHT,
    QUATERNIONS,
    WIDTH,
    attitude_at,
    horizon_gray,
    nadir_of,
)
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from target_messages import scan

from horizon_sensor_ros.ros.messages.images import gray_from_image
from horizon_sensor_ros.ros.messages.point_cloud import points_from_cloud
from horizon_sensor_ros.tools.bags import bag_from_images, bag_to_csv, replay
from horizon_sensor_ros.tools.bags.frame_files import stamp_text
from horizon_sensor_ros.tools.bags.output_bag import OutputBag
from horizon_sensor_ros.tools.command_errors import CommandError

PAIRS = 3
TYPESTORE = get_typestore(Stores.ROS2_JAZZY)


def camera_file(path: Path, *names: str, **others: Any) -> Path:
    camera = {"width": WIDTH, "height": HEIGHT, "fx": FOCAL_PX}
    cameras = {name: camera | {"rotation": QUATERNIONS[name]} for name in names or CAMERAS}
    path.write_text(yaml.safe_dump({"cameras": cameras} | others))
    return path


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder a camera, and the camera file: frames 9, 10, 11."""
    place = tmp_path_factory.mktemp("frames")
    for seed, name in enumerate(CAMERAS):
        (place / name).mkdir()
        for index in range(PAIRS):
            gray = horizon_gray(name, nadir_of(*attitude_at(index)), seed=2 * index + seed)
            cv2.imwrite(str(place / name / f"frame{9 + index}.png"), gray)
        (place / name / "notes.txt").write_text("not a frame")
    camera_file(place / "rig.yaml")
    return place


def arguments(folders: Path, *names: str) -> list[str]:
    images = [f"--images={name}={folders / name}" for name in names or CAMERAS]
    return [f"--camera-file={folders / 'rig.yaml'}", *images]


run = partial(called, bag_from_images.main)
Refused = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Refused:
    """Run what has to fail; what it says."""

    def run_it(*given: Any) -> str:
        before = sorted(tmp_path.iterdir())
        said = refusal(bag_from_images.main, capsys, *given)
        assert "horizon_bag_from_images: " in said
        assert sorted(tmp_path.iterdir()) == before, "nothing is left behind"
        return said

    return run_it


def read(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    found: dict[str, list[tuple[int, Any]]] = {}
    with Reader(bag) as reader:
        for connection, time, raw in reader.messages():
            message = TYPESTORE.deserialize_cdr(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((time, message))
    return found


def stamps(messages: list[tuple[int, Any]]) -> list[float]:
    return [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for _, m in messages]


def test_frames_to_estimates_to_tables(tmp_path: Path, folders: Path) -> None:
    bag, out, tables = tmp_path / "flight", tmp_path / "out", tmp_path / "tables"
    assert run(bag, *arguments(folders), "--rate", 5, "--start", 100) == 0
    assert replay.main([str(bag), str(out), "--params", f"{bag}.params.yaml"]) == 0
    assert bag_to_csv.main([str(out), str(tables)]) == 0
    assert sorted(p.name for p in tables.iterdir()) == [
        "attitude.csv",
        "diagnostics.csv",
        "local_vertical.csv",
    ]
    attitudes = table(tables / "attitude.csv")
    assert [row["stamp_s"] for row in attitudes] == [
        "100.000000000",
        "100.200000000",
        "100.400000000",
    ]
    for index, row in enumerate(attitudes):
        roll_deg, pitch_deg = attitude_at(index)
        assert float(row["roll_deg"]) == pytest.approx(roll_deg, abs=0.05)
        assert float(row["pitch_deg"]) == pytest.approx(pitch_deg, abs=0.05)
        assert float(row["z_m"]) == pytest.approx(ALTITUDE_M, rel=0.01)
        sigma_deg = math.degrees(math.sqrt(float(row["cov_rot_x_rot_x_rad2"])))
        assert 0 < sigma_deg < 0.1
        assert row["frame_id"] == "local_level"
    for row in table(tables / "diagnostics.csv"):
        assert row["level"] in ("ok", "warn", "error", "stale")
    for index, row in enumerate(table(tables / "local_vertical.csv")):
        vertical = [float(row[axis]) for axis in "xyz"]
        np.testing.assert_allclose(vertical, nadir_of(*attitude_at(index)), atol=1e-3)


def test_images_come_out_as_they_went_in(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    kinds = {
        "mono8": rng.integers(0, 256, (HEIGHT, WIDTH), np.uint8),
        "bgr8": rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8),
        "mono16": rng.integers(0, 65536, (HEIGHT, WIDTH), np.uint16),
        "bgra8": rng.integers(0, 256, (HEIGHT, WIDTH, 4), np.uint8),
    }
    (tmp_path / "frames").mkdir()
    for index, pixels in enumerate(kinds.values()):
        cv2.imwrite(str(tmp_path / "frames" / f"{index}.png"), pixels)
    file = camera_file(tmp_path / "rig.yaml", "camera_1")
    # One camera in the file: the folder alone says enough.
    assert run(tmp_path / "bag", "--camera-file", file, "--images", tmp_path / "frames") == 0
    messages = [m for _, m in read(tmp_path / "bag")["/camera_1/image_raw"]]
    assert [m.encoding for m in messages] == list(kinds)
    for message, pixels in zip(messages, kinds.values(), strict=True):
        data = np.frombuffer(message.data, pixels.dtype).reshape(pixels.shape)
        np.testing.assert_array_equal(data, pixels)
        assert isinstance(gray_from_image(message), np.ndarray)


def test_the_cameras_calibration_comes_first(tmp_path: Path, folders: Path) -> None:
    assert run(tmp_path / "bag", *arguments(folders)) == 0
    found = read(tmp_path / "bag")
    info = found["/camera_2/camera_info"][0][1]
    assert (info.width, info.height, info.k[0]) == (WIDTH, HEIGHT, FOCAL_PX)
    for (before, _), (after, _) in zip(
        found["/camera_2/camera_info"], found["/camera_2/image_raw"], strict=True
    ):
        assert before < after


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_the_same_bytes_every_time(tmp_path: Path, folders: Path, storage: str) -> None:
    for name in ("one", "other"):
        assert run(tmp_path / name, *arguments(folders), "--storage", storage) == 0
    one, other = (
        [p.read_bytes() for p in sorted((tmp_path / n).iterdir())] for n in ("one", "other")
    )
    assert one == other


def test_stamps_from_a_file_with_names(tmp_path: Path, folders: Path) -> None:
    # As visual-inertial data sets have them, in no order.
    lines = ["#timestamp [ns],filename"]
    lines += [f"{1_403_636_579_763_555_584 + i},frame{9 + i}.png" for i in (2, 0, 1)]
    (tmp_path / "data.csv").write_text("\n".join(lines))
    given = ["--stamps", tmp_path / "data.csv", "--stamp-unit", "ns"]
    assert run(tmp_path / "bag", *arguments(folders), *given) == 0
    for _, message in read(tmp_path / "bag")["/camera_1/image_raw"]:
        assert message.header.stamp.sec == 1_403_636_579
    nanoseconds = [m.header.stamp.nanosec for _, m in read(tmp_path / "bag")["/camera_1/image_raw"]]
    assert nanoseconds == [763_555_584, 763_555_585, 763_555_586]


def test_names_in_a_file_of_stamps_may_have_spaces_and_more(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    names = ["img 0.png", "a#1.png", "b, c; 2.png", "plain.png"]
    for name in names:
        cv2.imwrite(str(tmp_path / "frames" / name), np.zeros((HEIGHT, WIDTH), np.uint8))
    lines = [f"{index}.5,{name}" for index, name in enumerate(names[:3])]
    lines += ['# "plain.png" last', "3.5 sub/plain.png  # comment"]
    (tmp_path / "stamps.csv").write_text("\n".join(lines))
    file = camera_file(tmp_path / "rig.yaml", "camera_1")
    given = ["--camera-file", file, "--images", tmp_path / "frames"]
    assert run(tmp_path / "bag", *given, "--stamps", tmp_path / "stamps.csv") == 0
    assert stamps(read(tmp_path / "bag")["/camera_1/image_raw"]) == [0.5, 1.5, 2.5, 3.5]


@pytest.mark.parametrize(
    ("stamp", "text"),
    [
        (1_500_000_000, "1.500000000"),
        (-500_000_000, "-0.500000000"),
        (-1_000_000_001, "-1.000000001"),
        (0, "0.000000000"),
    ],
)
def test_a_stamp_in_words(stamp: int, text: str) -> None:
    """Messages may have negative ones, as tables show them."""
    assert stamp_text(stamp) == text


def test_stamps_from_a_file_without_names_and_from_names(tmp_path: Path, folders: Path) -> None:
    (tmp_path / "stamps.txt").write_text("5.0\n5.1\n\n5.25\n")
    given = arguments(folders, "camera_1")
    assert run(tmp_path / "a", *given, "--stamps", tmp_path / "stamps.txt") == 0
    assert stamps(read(tmp_path / "a")["/camera_1/image_raw"]) == [5.0, 5.1, 5.25]
    assert run(tmp_path / "b", *given, "--stamps-in-names") == 0
    assert stamps(read(tmp_path / "b")["/camera_1/image_raw"]) == [9.0, 10.0, 11.0]


def test_folders_of_clouds_become_a_bag_that_replays(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    for index in range(3):
        np.save(tmp_path / "scans" / f"{index}.npy", scan(index))
    assert run(tmp_path / "bag", "--clouds", tmp_path / "scans", "--rate", 5) == 0
    assert not (tmp_path / "bag.params.yaml").exists()
    clouds = [m for _, m in read(tmp_path / "bag")["/target/points"]]
    for index, cloud in enumerate(clouds):
        np.testing.assert_array_equal(points_from_cloud(cloud), scan(index))
        assert cloud.header.frame_id == "tof"
    assert replay.main([str(tmp_path / "bag"), str(tmp_path / "out")]) == 0
    assert bag_to_csv.main([str(tmp_path / "out"), str(tmp_path / "tables")]) == 0
    names = {p.name for p in (tmp_path / "tables").iterdir()}
    assert names >= {"target__pose.csv", "target__pose_delta.csv", "target__twist.csv"}
    twist = table(tmp_path / "tables" / "target__twist.csv")
    assert len(twist) == 2
    assert "cov_vx_vx_m_s2" in twist[0]


def test_the_parameter_file_says_what_the_camera_file_says(tmp_path: Path, folders: Path) -> None:
    file = camera_file(
        tmp_path / "moon.yaml",
        planet={"radius_km": 1737.4, "limb_height_km": 2.0},
        nadir_at_zero=[0.0, 0.0, 1.0],
    )
    images = f"--images=camera_2={folders / 'camera_2'}"
    assert run(tmp_path / "bag", "--camera-file", file, images) == 0
    content = yaml.safe_load((tmp_path / "bag.params.yaml").read_text())["/**"]["ros__parameters"]
    assert content.pop("camera_2")["rotation"] == pytest.approx(QUATERNIONS["camera_2"])
    assert content == {
        "cameras": ["camera_2"],
        "level_z": "down",
        "planet": "sphere",
        "planet_radius": 1737400.0,
        "limb_height": 2000.0,
    }


# ---------------------------------------------------------------------------- errors for a person


def test_what_is_wrong_with_the_images(tmp_path: Path, folders: Path, refused: Refused) -> None:
    out, rig = tmp_path / "bag", folders / "rig.yaml"

    def said(folder: Path) -> str:
        return refused(out, "--camera-file", rig, f"--images=camera_1={folder}")

    assert "cannot be read: No such file" in said(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    assert "has no file that ends in" in said(tmp_path / "empty")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    assert "a.png: is no image that OpenCV can read" in said(tmp_path / "broken")
    (tmp_path / "void").mkdir()
    (tmp_path / "void" / "a.png").touch()
    assert "a.png: is no image" in said(tmp_path / "void")
    (tmp_path / "vast").mkdir()
    (tmp_path / "vast" / "a.pgm").write_text("P5 100000 100000 255\n")
    assert "a.pgm: is no image" in said(tmp_path / "vast")
    (tmp_path / "small").mkdir()
    cv2.imwrite(str(tmp_path / "small" / "a.png"), np.zeros((10, 20), np.uint8))
    message = said(tmp_path / "small")
    assert "has 20 x 10 pixels" in message
    assert f"{WIDTH} x {HEIGHT} for camera_1" in message
    (tmp_path / "float").mkdir()
    cv2.imwrite(str(tmp_path / "float" / "a.tif"), np.zeros((HEIGHT, WIDTH), np.float32))
    assert "pixels of float32" in said(tmp_path / "float")


def test_what_is_wrong_with_the_cameras(tmp_path: Path, folders: Path, refused: Refused) -> None:
    out, rig = tmp_path / "bag", folders / "rig.yaml"
    images = folders / "camera_1"
    assert "no camera 'left'" in refused(out, "--camera-file", rig, f"--images=left={images}")
    assert "more than one camera" in refused(out, "--camera-file", rig, f"--images={images}")
    twice = [f"--images=camera_1={images}"] * 2
    assert "its folder already" in refused(out, "--camera-file", rig, *twice)
    copied = [f"--images=camera_1={images}", f"--images=camera_2={images / '.'}"]
    assert "the folder of camera_1 already" in refused(out, "--camera-file", rig, *copied)
    assert "none.yaml: cannot be read" in refused(
        out, "--camera-file", tmp_path / "none.yaml", f"--images=camera_1={images}"
    )
    odd = tmp_path / "odd.yaml"
    odd.write_text(rig.read_text().replace("camera_1", "1st camera"))
    assert "1st camera" in refused(out, "--camera-file", odd, f"--images=1st camera={images}")
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "a.png").write_bytes((images / "frame9.png").read_bytes())
    message = refused(
        out,
        *arguments(folders, "camera_1"),
        f"--images=camera_2={tmp_path / 'one'}",
    )
    assert "camera_1: 3, camera_2: 1" in message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no stamps"),
        ("1\n2\n", "has 2 stamps, and"),
        ("1\ntwo\n3\n", "line 2: 'two' is not a stamp"),
        ("1\nnan\n3\n", "line 2: 'nan' is not a"),
        ("1 frame9.png\n2\n3 frame11.png\n", "line 2: has no frame's name"),
        ("1 frame9.png\n2 frame10.png\n3 other.png", "has no line for"),
        ("1\n1\n2\n", "have the same stamp, 1.000000000 s"),
        ("1403636579763555584\n2\n3", "--stamp-unit says"),
        ("-1\n2\n3", "not a time that a ROS stamp can hold"),
        # To the nanosecond it is 2^31 s.
        ("1\n2\n2147483647.9999999999", "not a time that a ROS stamp can hold"),
        ("1e999999999\n2\n3", "line 1"),
    ],
)
def test_what_is_wrong_with_the_stamps(
    tmp_path: Path, folders: Path, refused: Refused, text: str, said: str
) -> None:
    (tmp_path / "stamps.txt").write_text(text)
    given = [*arguments(folders), "--stamps", tmp_path / "stamps.txt"]
    assert said in refused(tmp_path / "bag", *given)


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_the_folder_one_is_in_becomes_no_bag(
    tmp_path: Path,
    folders: Path,
    refused: Refused,
    monkeypatch: pytest.MonkeyPatch,
    force: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    said = refused(".", *arguments(folders), *force)
    assert ("the current folder is in it" if force else ". exists") in said


def test_no_stamp_is_later_than_one_can_be(tmp_path: Path, folders: Path, refused: Refused) -> None:
    given = [*arguments(folders), "--start", "2147483646", "--rate", "1"]
    assert "an earlier start" in refused(tmp_path / "bag", *given)


def test_what_is_wrong_with_names_as_stamps(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "first.xyz").write_text("1 2 3\n")
    given = ["--clouds", tmp_path / "scans", "--stamps-in-names"]
    assert "has no number in its name" in refused(tmp_path / "bag", *given)
    (tmp_path / "scans" / "first.xyz").rename(tmp_path / "scans" / "1.xyz")
    (tmp_path / "scans" / "1.xyz").write_text("1 2 three\n")
    assert "1.xyz: is no cloud that can be read" in refused(tmp_path / "bag", *given)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "give --images CAMERA=FOLDER, or --clouds"),
        (["--images", "a=b"], "--images needs --camera-file"),
        (["--clouds", "x", "--rate", "0"], "--rate must be"),
        (["--clouds", "x", "--start", "-1"], "--start must be"),
        (["--clouds", "x", "--rate", "1", "--stamps", "y"], "not allowed with"),
        (
            ["--clouds", "x", "--rate", "5", "--stamp-unit", "ns"],
            "--stamp-unit has no effect without --stamps or --stamps-in-names",
        ),
        (["--clouds", "x", "--stamps", "y", "--start", "1"], "--start has no effect with --stamps"),
        (["--clouds", "x", "--camera-file", "y"], "--camera-file has no effect without --images"),
        (
            ["--images", "a", "--camera-file", "y", "--cloud-frame", "tof"],
            "--cloud-frame has no effect without --clouds",
        ),
    ],
)
def test_wrong_arguments(
    given: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with pytest.raises(SystemExit) as caught:
        run(tmp_path / "bag", *given)
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


def test_nothing_is_overwritten_but_by_force(
    tmp_path: Path, folders: Path, refused: Refused
) -> None:
    given = arguments(folders, "camera_1")
    assert run(tmp_path / "bag", *given) == 0
    assert "bag exists" in refused(tmp_path / "bag", *given)
    assert run(tmp_path / "bag", *given, "--force") == 0
    (tmp_path / "other.params.yaml").write_text("mine")
    assert "other.params.yaml exists" in refused(tmp_path / "other", *given)
    # Never the input.
    assert "only another bag" in refused(folders, *given, "--force")


def test_without_a_bag_there_are_no_other_parameters(
    tmp_path: Path, folders: Path, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: OutputBag) -> None:
        raise CommandError("the disk is full")

    monkeypatch.setattr(OutputBag, "finish", fail)
    given = arguments(folders, "camera_1")
    assert "disk is full" in refused(tmp_path / "bag", *given)
    (tmp_path / "bag.params.yaml").write_text("mine")
    assert "disk is full" in refused(tmp_path / "bag", *given, "--force")
    assert (tmp_path / "bag.params.yaml").read_text() == "mine"


def test_what_cannot_be_printed_costs_no_result(
    tmp_path: Path, folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", None)  # as where it was closed
    assert run(tmp_path / "bag", *arguments(folders, "camera_1")) == 0
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    assert (tmp_path / "bag.params.yaml").exists()

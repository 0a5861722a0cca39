"""horizon_report: from the command line to what a reader sees in a browser."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import called, refusal
from compressed_frames import compressed_recording
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped, QuaternionStamped
from horizon_messages import (
    ALTITUDE_M,
    CAMERAS,
    HEIGHT,
    PERIOD_NS,
    START_NS,
    WIDTH,
    attitude_at,
    camera_info_of,
    horizon_gray,
    image_of,
    nadir_of,
    recording,
    write_bag,
    write_parameters,
)
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from sensor_msgs.msg import Imu
from small_files import no_larger_files
from target_messages import FRAME_ID, cloud_of, scan, stamp_of, truth_at

from horizon_sensor_ros.ros.messages.estimates import pose_message
from horizon_sensor_ros.ros.pipelines.aiding_sources import AidingSources
from horizon_sensor_ros.tools.bags.output_bag import OutputBag
from horizon_sensor_ros.tools.bags.replay import main as replay
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.report import clouds
from horizon_sensor_ros.tools.report.bags import read_bags
from horizon_sensor_ros.tools.report.recorded import ImuSample
from horizon_sensor_ros.tools.report.report import main, write_report
from horizon_sensor_ros.tools.truth.topics import (
    true_attitude_message,
    true_pose_message,
    true_vertical_message,
)

PAIRS = 24
FLOODED = range(9, 13)
CLOUDS = 10
GRAVITY = 9.81

run = partial(called, main)
refused = partial(refusal, main)


def imu_of(nadir_base: np.ndarray, stamp: int) -> Imu:
    """What an accelerometer at rest feels: the ground that pushes it up."""
    msg = Imu()
    msg.header.frame_id = "base_link"
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    felt = -GRAVITY * nadir_base
    msg.linear_acceleration.x, msg.linear_acceleration.y, msg.linear_acceleration.z = map(
        float, felt
    )
    return msg


def flight_messages() -> list[tuple[str, int, Any]]:
    """Both cameras, flooded for a while, an IMU, a target, and the truth of everything."""
    messages: list[tuple[str, int, Any]] = []
    for index in range(PAIRS):
        stamp = START_NS + index * PERIOD_NS
        nadir = nadir_of(*attitude_at(index))
        for delay, camera in enumerate(CAMERAS):
            gray = horizon_gray(camera, nadir, seed=2 * index + delay)
            if index in FLOODED:
                gray = np.full_like(gray, 250)
            messages.append((f"/{camera}/camera_info", stamp, camera_info_of(stamp, camera)))
            messages.append((f"/{camera}/image_raw", stamp, image_of(gray, stamp, camera)))
        vertical = true_vertical_message(nadir, stamp, "base_link")
        attitude = true_attitude_message(nadir, ALTITUDE_M, stamp, "up")
        messages.append(("/truth/local_vertical", stamp, vertical))
        messages.append(("/truth/attitude", stamp, attitude))
        messages.append(("/imu", stamp, imu_of(nadir, stamp)))
    for index in range(CLOUDS):
        stamp = stamp_of(index)
        messages.append(("/target/points", stamp, cloud_of(scan(index), stamp)))
        pose = true_pose_message(truth_at(index), stamp, FRAME_ID)
        messages.append(("/truth/target/pose", stamp, pose))
    return sorted(messages, key=lambda each: each[1])


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Replayed bag, input bag and parameters."""
    directory = tmp_path_factory.mktemp("report")
    source = write_bag(directory / "flight", flight_messages())
    params = write_parameters(directory / "params.yaml")
    assert replay([str(source), str(directory / "out"), "--params", str(params)]) == 0
    return directory / "out", source, params


Row = tuple[str, int, tuple[str, bytes]]


def rows_of(bag: Path) -> list[Row]:
    with AnyReader([bag]) as reader:
        return [(c.topic, time, (c.msgtype, raw)) for c, time, raw in reader.messages()]


@pytest.fixture(scope="module")
def of_the_cameras(bags: tuple[Path, Path, Path]) -> tuple[Path, Path]:
    """Replayed bag and input bag with the answers and frames of the horizon alone.

    Their pages are drawn in half the time.
    """
    out, source = (
        write_bag(bag.parent / f"{bag.name}_of_the_cameras", [r for r in rows_of(bag) if wanted(r)])
        for bag, wanted in (
            (bags[0], lambda row: not row[0].startswith("/target")),
            (bags[1], lambda row: row[0].startswith("/camera")),
        )
    )
    return out, source


@pytest.fixture(scope="module")
def heard() -> Counter[int]:
    """How many rates each pipeline of the report heard."""
    return Counter()


@pytest.fixture(scope="module")
def page(bags: tuple[Path, Path, Path], heard: Counter[int]) -> Path:
    out, source, params = bags
    take = AidingSources.on_imu
    kept = []

    def counted(self: AidingSources, msg: Any) -> None:
        kept.append(self)
        heard[id(self)] += 1
        take(self, msg)

    path = out.parent / "report.html"
    arguments = (out, "--input", source, "--params", params, "--out", path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(AidingSources, "on_imu", counted)
        assert run(*arguments) == 0
    return path


class Reader(HTMLParser):
    """Text, headings, alternative texts and addresses of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.headings: list[str] = []
        self.words: list[str] = []
        self.alts: list[str] = []
        self.addresses: list[str] = []
        self._tag = ""
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._tag = tag
        found = {name: value or "" for name, value in attrs}
        if tag == "img":
            self.alts.append(found.get("alt", ""))
        names = ("src", "srcset", "href")
        self.addresses += [found[name] for name in names if name in found]

    def handle_data(self, data: str) -> None:
        text = " ".join(data.split())
        if text and self._tag != "style":
            self.words.append(text)
            if self._tag == "h2":
                self.headings.append(text)

    @property
    def text(self) -> str:
        return " ".join(self.words)

    def row(self, first: str) -> list[str]:
        """Cells after the first one of a table's row."""
        at = self.words.index(first)
        return self.words[at + 1 : at + 6]


def test_every_part_is_there(page: Path) -> None:
    read = Reader(page)
    assert read.headings == [
        "Availability",
        "Errors against the truth",
        "What the cameras saw",
        "Nadir, roll, pitch and altitude",
        "Camera against accelerometer",
        "Residuals",
        "Agreement of the cameras",
        "Why there was no answer",
        "Target",
        "Errors of the target against the truth",
        "Latency",
        "What the bags hold",
    ]
    assert all(alt.strip() for alt in read.alts)
    # Two nodes with one pipeline are drawn once.
    assert sum(alt.startswith("Residuals") for alt in read.alts) == 3
    assert sum(alt.startswith("Two clouds from the front") for alt in read.alts) == 1
    assert len(read.alts) > 20


def test_nothing_is_fetched_from_elsewhere(page: Path) -> None:
    assert all(a.startswith(("data:", "#")) for a in Reader(page).addresses)


def test_figures_are_those_of_the_flight(page: Path) -> None:
    read = Reader(page)
    answered = PAIRS - len(FLOODED)
    assert read.row("attitude")[:2] == [str(answered), str(PAIRS)]
    assert read.row("target/pose")[:2] == [str(CLOUDS), str(CLOUDS)]
    assert f"{len(FLOODED)} of {PAIRS} frame sets have no answer" in read.text
    assert read.text.count("s, no answer:") == len(FLOODED)
    assert read.text.count("s, answered") == 4
    assert "frame of camera_1: 0 candidates" in " ".join(read.alts)
    # Errors of a clear horizon, and of the accelerometer's, which is exact.
    assert float(read.row("roll (deg)")[0]) < 0.01
    assert float(read.row("altitude (km)")[0]) < 1.0
    # A size's shares are no normal law's, beside which they would stand.
    assert read.row("nadir (deg)")[4] == "-"
    assert read.row("pose: turn (deg)")[4] == "pose: shift (cm)"
    assert read.row("roll (deg)")[4].count(",") == 2
    mean, rms, *_ = (float(cell) for cell in read.row("pitch")[:2])
    assert abs(mean) < 0.01
    assert rms < 0.01
    assert read.row("paper B's bench: pitch")[1] == "0.752"
    # One cloud on the other after the motion that was found.
    before, after = (
        float(words.split()[0].rstrip(",."))
        for words in read.text.split("Likeness (1: the same) before the found motion ")[1].split(
            "after it ", 1
        )
    )
    assert after > 0.8 > before


def test_answers_alone_make_a_page_too(bags: tuple[Path, Path, Path], tmp_path: Path) -> None:
    path = tmp_path / "deep" / "alone.html"
    write_report([bags[0]], path, title="A flight <with> marks")
    read = Reader(path)
    assert "A flight <with> marks" in read.text
    assert "give the one that has them with --input" in read.text
    assert "Agreement of the cameras" not in read.headings
    assert "Errors against the truth" not in read.headings


def test_without_parameters_the_frames_are_shown_as_they_are(
    of_the_cameras: tuple[Path, Path], tmp_path: Path
) -> None:
    out, source = of_the_cameras
    path = tmp_path / "report.html"
    path.write_text("an older one")
    arguments = (out, "--input", source, "--out", path, "--force")
    assert run(*arguments) == 0
    read = Reader(path)
    assert "shown when --params FILE is given" in read.text
    assert read.alts.count("frame of camera_1") == len(FLOODED) + 4


def test_what_is_wrong_is_said(
    bags: tuple[Path, Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, source, _ = bags
    page = tmp_path / "report.html"
    told = refused(capsys, source, "--out", page)
    assert "Make them with horizon_replay" in told
    assert "/camera_1/image_raw (sensor_msgs/msg/Image) in flight" in told
    assert "there is no bag" in refused(capsys, tmp_path / "none", "--out", page)
    told = refused(capsys, out, "--imu", "imu/dta", "--out", page)
    assert "--imu: there is no /imu/dta (sensor_msgs/msg/Imu); there is" in told
    assert not page.exists()
    page.write_text("mine")
    assert "exists; choose another" in refused(capsys, out, "--out", page)
    told = refused(capsys, out, "--out", page.with_suffix(".pdf"), code=2)
    assert "report.pdf: the page is HTML; name it" in told
    assert page.read_text() == "mine"
    told = refused(capsys, out, "--params", tmp_path / "none.yaml", "--out", tmp_path / "other")
    assert "cannot be read" in told


def test_of_a_target_alone_nothing_is_said_of_frames(tmp_path: Path) -> None:
    flight = [("/target/points", stamp_of(i), cloud_of(scan(i), stamp_of(i))) for i in range(3)]
    source, out = write_bag(tmp_path / "in", flight), tmp_path / "out"
    assert replay([str(source), str(out)]) == 0
    for given, said in (((), "The clouds are not in the bag"), (("--input", source), "Two clouds")):
        page = tmp_path / f"{len(given)}.html"
        assert run(out, *given, "--out", page) == 0
        text = Reader(page).text
        assert said in text
        assert "frames are" not in text
        assert ("clouds are not" in text) == (not given)


def test_frames_that_the_other_bag_has_not_either_are_said(
    of_the_cameras: tuple[Path, Path], tmp_path: Path
) -> None:
    out, _ = of_the_cameras
    other = write_bag(tmp_path / "clouds", [("/target/points", START_NS, cloud_of(scan(0), 1))])
    page = tmp_path / "page.html"
    assert run(out, "--input", other, "--out", page) == 0
    assert f"The frames are neither in {out.name} nor in clouds: give the bag" in Reader(page).text


def test_bags_without_messages_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As of a node that published nothing: its topics are there."""
    empty = OutputBag(tmp_path / "empty", StoragePlugin.MCAP)
    empty.add_topic("/attitude", PoseWithCovarianceStamped)
    empty.finish()
    page = tmp_path / "page.html"
    told = refused(capsys, tmp_path / "empty", "--out", page)
    assert f"no answers in {tmp_path / 'empty'}: no messages at all\nMake them" in told
    other = write_bag(tmp_path / "imu", [("/imu", START_NS, imu_of(nadir_of(0, 0), START_NS))])
    told = refused(capsys, tmp_path / "empty", "--input", other, "--out", page)
    assert "PoseWithCovarianceStamped) in empty, without messages\n" in told
    assert "/imu (sensor_msgs/msg/Imu) in imu\n" in told


def test_an_older_page_stays_where_the_new_one_cannot_be_written(
    of_the_cameras: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "report.html"
    page.write_text("an older one")
    with no_larger_files(10_000):
        told = refused(capsys, of_the_cameras[0], "--out", page, "--force")
    assert f"cannot write {page}: File too large" in told
    assert page.read_text() == "an older one"
    assert list(tmp_path.iterdir()) == [page]


def test_a_namespace_that_the_answers_do_not_have_is_said(
    bags: tuple[Path, Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, source, _ = bags
    page = tmp_path / "report.html"
    given = (out, "--input", source, "--namespace", "foo", "--out", page)
    assert "no answers in " in (told := refused(capsys, *given))
    assert "none of /foo/local_vertical, /foo/attitude" in told
    assert told.splitlines()[-1] == "Those of other nodes are there: --namespace /"
    assert not page.exists()


def text_of_replay(tmp_path: Path, flown: Path, source: Path) -> str:
    """What the report on a bag's replay says, beside the frames of a source bag."""
    params, out, page = (tmp_path / name for name in ("params.yaml", "out", "report.html"))
    write_parameters(params)
    assert replay([str(flown), str(out), "--params", str(params)]) == 0
    assert run(out, "--input", source, "--out", page) == 0
    return Reader(page).text


def test_a_recording_by_another_clock_than_the_stamps_is_said(tmp_path: Path) -> None:
    """As where frames were drawn more slowly than they would have come."""
    flown = [(topic, 2 * t - START_NS + 5 * 10**9, msg) for topic, t, msg in recording(11)]
    bag = write_bag(tmp_path / "in", flown)
    assert "a clock that was 5.0 to 6.0 s ahead" in text_of_replay(tmp_path, bag, bag)
    usual = write_bag(tmp_path / "usual", recording(3))
    (tmp_path / "again").mkdir()
    assert "a clock that was" not in text_of_replay(tmp_path / "again", usual, usual)


def test_a_camera_of_another_namespace_is_not_ours(tmp_path: Path) -> None:
    ours = write_bag(tmp_path / "ours", recording(3))
    both = recording(3) + [(f"/other{topic}", time, msg) for topic, time, msg in recording(5)]
    source = write_bag(tmp_path / "both", both)
    assert "3 of 3" in text_of_replay(tmp_path, ours, source)


def test_what_another_craft_says_of_itself_is_not_ours(tmp_path: Path) -> None:
    """All write to one /diagnostics."""
    params = str(write_parameters(tmp_path / "params.yaml"))
    ours, mute = recording(3), [each for each in recording(3) if "info" not in each[0]]
    both: list[tuple[str, int, Any]] = []
    for name, flight in (("ours", ours), ("other", mute)):
        source = write_bag(tmp_path / name, [(f"/{name}{t}", time, m) for t, time, m in flight])
        out = tmp_path / f"{name}_out"
        assert replay([str(source), str(out), "--params", params, "--namespace", name]) == 0
        both += rows_of(out)
    together = write_bag(tmp_path / "together", both)
    for name, missing in (("ours", False), ("other", True)):
        page = tmp_path / f"{name}.html"
        assert main([str(together), "--namespace", name, "--out", str(page)]) == 0
        assert ("no camera_info yet" in Reader(page).text) == missing


def test_frames_that_are_compressed_are_shown(tmp_path: Path) -> None:
    source = write_bag(tmp_path / "flight", compressed_recording(recording(2)))
    text = text_of_replay(tmp_path, source, source)
    assert "The frames are not in the bag" not in text
    assert "/camera_1/image_raw/compressed" in text


def test_diagnostics_alone_say_why_there_was_no_answer(tmp_path: Path) -> None:
    flight = [(topic, time, msg) for topic, time, msg in recording(3) if "info" not in topic]
    source = write_bag(tmp_path / "flight", flight)
    assert "no camera_info yet" in text_of_replay(tmp_path, source, source)


def attitude_of(stamp: int, **fields: float) -> PoseWithCovarianceStamped:
    """Of a level craft; fields: of the quaternion, z of the position, each element's covariance."""
    msg = PoseWithCovarianceStamped()
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    msg.pose.pose.orientation.w = fields.get("w", 1.0)
    msg.pose.pose.position.z = fields.get("z", ALTITUDE_M)
    msg.pose.covariance = [fields.get("covariance", 0.0)] * 36
    return msg


def diagnosis_of(name: str, **values: str) -> DiagnosticArray:
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    status = DiagnosticStatus(name=name, level=b"\2", message="battery low", values=pairs)
    return DiagnosticArray(status=[status])


OTHER_STAMP = START_NS - PERIOD_NS
# Messages on our topics, and what is said of them.
ODD: dict[str, tuple[list[tuple[str, Any]], str]] = {
    "unknown type": (
        [("/target/pose", ("px4_msgs/msg/Attitude", b"\0\1\0\0\1"))],
        "px4_msgs/msg/Attitude",
    ),
    "another type": (
        [("/target/pose", QuaternionStamped())],
        "geometry_msgs/msg/QuaternionStamped",
    ),
    "no rotation, and not finite": (
        [
            ("/attitude", attitude_of(OTHER_STAMP, w=0.0)),
            ("/attitude", attitude_of(OTHER_STAMP, z=float("nan"))),
            ("/attitude", attitude_of(OTHER_STAMP, covariance=float("nan"))),
        ],
        "3 messages of /attitude were left out",
    ),
    "no direction": (
        [("/truth/local_vertical", true_vertical_message(np.zeros(3), START_NS, "base_link"))],
        "1 messages of /truth/local_vertical were left out",
    ),
    "empty image": (
        [("/camera_1/image_raw", ("sensor_msgs/msg/Image", b""))],
        "1 messages could not be read",
    ),
    "another node's numbers": (
        [
            ("/diagnostics", diagnosis_of("lidar", latency_ms="n/a")),
            ("/diagnostics", diagnosis_of("lidar", residual_px="none")),
        ],
        "",
    ),
    "ours, not a number": (
        [
            (
                "/diagnostics",
                diagnosis_of("attitude_node: horizon", residual_px="", latency_ms="-"),
            )
        ],
        "battery low",
    ),
}


@pytest.mark.parametrize("left_out", ["another type", "unknown type"])
def test_what_others_write_to_our_topics_does_not_end_the_report(
    bags: tuple[Path, Path, Path], tmp_path: Path, left_out: str
) -> None:
    rows = rows_of(bags[0])
    # A topic has one type.
    odd = [told for what, told in ODD.items() if what != left_out]
    written = [(topic, START_NS, msg) for messages, _ in odd for topic, msg in messages]
    kept = [row for row in rows if row[0] != "/target/pose"]
    source = write_bag(tmp_path / "odd", [*kept, *written])
    assert main([str(source), "--out", str(tmp_path / "page.html")]) == 0
    read = Reader(tmp_path / "page.html")
    for _, words in odd:
        assert words in read.text
    assert "lidar" not in read.text


def test_answers_that_are_all_left_out_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_bag(tmp_path / "odd", [("/attitude", START_NS, attitude_of(START_NS, w=0.0))])
    told = refused(capsys, source, "--out", tmp_path / "page.html")
    assert "1 messages of /attitude were left out: not finite, or their" in told


@pytest.mark.filterwarnings("error")
def test_a_covariance_of_zeros_has_no_nees(tmp_path: Path) -> None:
    nadir = nadir_of(0.0, 0.0)
    messages: list[tuple[str, int, Any]] = []
    for stamp in (START_NS, START_NS + PERIOD_NS):
        messages += [
            ("/attitude", stamp, attitude_of(stamp)),
            ("/truth/local_vertical", stamp, true_vertical_message(nadir, stamp, "base_link")),
            ("/truth/attitude", stamp, true_attitude_message(nadir, ALTITUDE_M, stamp, "up")),
        ]
    for index in (0, 1):
        stamp = stamp_of(index)
        pose = true_pose_message(truth_at(index), stamp, FRAME_ID)
        told = pose_message(truth_at(index), np.zeros((6, 6)), stamp, FRAME_ID)
        messages += [("/truth/target/pose", stamp, pose), ("/target/pose", stamp, told)]
    source = write_bag(tmp_path / "zeros", messages)
    page = tmp_path / "page.html"
    assert main([str(source), "--out", str(page)]) == 0
    read = Reader(page)
    assert "Errors against the truth" in read.headings
    assert "Errors of the target against the truth" in read.headings
    assert "NEES" not in read.text


def test_remapped_frames_are_the_cameras(tmp_path: Path) -> None:
    names = {"/camera_1/image_raw": "/left/image", "/camera_2/image_raw": "/right/image_raw"}
    flight = [(names.get(topic, topic), time, msg) for topic, time, msg in recording(3)]
    source = write_bag(tmp_path / "flight", flight)
    params = write_parameters(tmp_path / "params.yaml")
    remap = [word for rule in names.items() for word in ("--remap", ":=".join(rule))]
    page = tmp_path / "report.html"
    given = [source, tmp_path / "out", "--params", params, *remap]
    assert replay([str(a) for a in given]) == 0
    for with_params in ([], ["--params", params]):
        given = [tmp_path / "out", "--input", source, *with_params, *remap]
        assert run(*given, "--out", page, "--force") == 0
        read = Reader(page)
        assert "3 of 3" in read.text
        for camera in CAMERAS:
            assert any(camera in alt for alt in read.alts)


@pytest.mark.parametrize("told", [False, True], ids=["of another frame", "told to be the same"])
def test_an_accelerometer_in_another_frame_is_not_compared(
    of_the_cameras: tuple[Path, Path], tmp_path: Path, told: bool
) -> None:
    rows: list[tuple[str, int, Any]] = [*rows_of(of_the_cameras[0])]
    for index in range(PAIRS):
        stamp = START_NS + index * PERIOD_NS
        imu = imu_of(nadir_of(*attitude_at(index)), stamp)
        imu.header.frame_id = "imu_link"
        rows.append(("/imu", stamp, imu))
    source = write_bag(tmp_path / "bag", rows)
    page, params = tmp_path / "page.html", tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {base_frame: imu_link}}")
    arguments = (source, "--out", page, *(("--params", params) if told else ()))
    assert run(*arguments) == 0
    read = Reader(page)
    why_not = "in the frame 'imu_link', and the answers are in 'base_link': nothing is compared"
    assert (why_not in read.text) != told
    assert ("paper B's bench: pitch" in read.words) == told


def test_the_report_can_be_ended_while_it_reads_the_clouds(
    bags: tuple[Path, Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A signal only sets a flag, which is asked between two messages."""
    # Of the horizon there would be a dozen charts before.
    both = sorted(rows_of(bags[0]) + rows_of(bags[1]), key=lambda row: row[1])
    target = write_bag(tmp_path / "bag", [row for row in both if row[0].startswith("/target")])
    asked_to_stop = []
    decode = clouds.points_from_cloud

    def decoded(msg: Any) -> Any:
        asked_to_stop.append(True)
        return decode(msg)

    monkeypatch.setattr(clouds, "points_from_cloud", decoded)
    page = tmp_path / "page.html"
    with pytest.raises(KeyboardInterrupt):
        write_report([target], page, stopped=lambda: bool(asked_to_stop))
    assert not page.exists()


def test_of_an_imu_only_what_counts_is_kept(tmp_path: Path) -> None:
    """There may be millions of its messages, each with three covariances."""
    imu = imu_of(np.array([0.0, 0.0, -1.0]), START_NS)
    imu.angular_velocity.x = 0.25
    vertical = true_vertical_message(np.array([0.0, 0.0, -1.0]), START_NS, "base_link")
    source = write_bag(
        tmp_path / "bag", [("/imu", START_NS, imu), ("/local_vertical", START_NS, vertical)]
    )
    (sample,) = read_bags([source], TopicNames("/", [])).imu
    assert sample == ImuSample(START_NS, "base_link", (0.0, 0.0, GRAVITY), (0.25, 0.0, 0.0))


def test_as_many_frames_wait_for_the_other_cameras_as_the_parameters_say(tmp_path: Path) -> None:
    # All of one camera's first, as from bags that were put together.
    flight = sorted(recording(13), key=lambda each: each[0])
    source = write_bag(
        tmp_path / "flight", [(t, START_NS + i, m) for i, (t, _, m) in enumerate(flight)]
    )
    params = write_parameters(tmp_path / "params.yaml", queue_size=20)
    assert replay([str(source), str(tmp_path / "out"), "--params", str(params)]) == 0
    page = tmp_path / "report.html"
    arguments = (tmp_path / "out", "--input", source, "--params", params, "--out", page)
    assert run(*arguments) == 0
    assert "13 frame sets, evenly chosen" in Reader(page).text


def test_parameters_that_replay_takes_make_a_page(
    bags: tuple[Path, Path, Path], of_the_cameras: tuple[Path, Path], tmp_path: Path
) -> None:
    """Of one node alone; of the target, of which there are no frames."""
    out, source = of_the_cameras
    one = tmp_path / "one.yaml"
    one.write_text(bags[2].read_text().replace("/**:", "local_vertical_node:"))
    page = tmp_path / "report.html"
    given = ("--out", page, "--force")
    assert run(out, "--input", source, "--params", one, *given) == 0
    assert "Agreement of the cameras" in Reader(page).headings
    target = tmp_path / "target.yaml"
    target.write_text("/**:\n  ros__parameters:\n    max_gap: 1.0\n")
    clouds = write_bag(
        tmp_path / "clouds", [each for each in flight_messages() if "target" in each[0]]
    )
    assert replay([str(clouds), str(tmp_path / "answers"), "--params", str(target)]) == 0
    assert run(tmp_path / "answers", "--params", target, *given) == 0
    assert "Target" in Reader(page).headings


def test_rotations_from_tf_are_said(of_the_cameras: tuple[Path, Path], tmp_path: Path) -> None:
    out, source = of_the_cameras
    params, page = tmp_path / "params.yaml", tmp_path / "report.html"
    write_parameters(params, extrinsics_source="tf")
    arguments = (out, "--input", source, "--params", params, "--out", page)
    assert run(*arguments) == 0
    read = Reader(page)
    assert "extrinsics_source is tf, and a report has no TF" in read.text
    assert read.alts.count("frame of camera_1") == len(FLOODED) + 4


def test_a_camera_without_frames_is_said_and_the_others_are_shown(tmp_path: Path) -> None:
    flight = [each for each in recording(16) if "camera_2" not in each[0]]
    source = write_bag(tmp_path / "flight", flight)
    params = write_parameters(tmp_path / "params.yaml", camera_timeout=0.5)
    assert replay([str(source), str(tmp_path / "out"), "--params", str(params)]) == 0
    page = tmp_path / "report.html"
    arguments = (tmp_path / "out", "--input", source, "--params", params, "--out", page)
    assert run(*arguments) == 0
    read = Reader(page)
    assert "no frames of camera_2, which the parameters name" in read.text
    assert read.text.count("s, answered") == 4
    assert "10 frame sets, evenly chosen" in read.text


def test_frames_after_the_other_camera_fell_silent_are_shown(tmp_path: Path) -> None:
    dark = np.zeros((HEIGHT, WIDTH), np.uint8)
    stamps = [START_NS + second * 1_000_000_000 for second in range(12)]
    messages: list[tuple[str, int, Any]] = [("/attitude", stamps[0], attitude_of(stamps[0]))]
    for camera, seen in (("camera_1", stamps), ("camera_2", stamps[:2])):
        messages += [(f"/{camera}/image_raw", s, image_of(dark, s, camera)) for s in seen]
    source = write_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[1]))
    assert main([str(source), "--out", str(tmp_path / "page.html")]) == 0
    assert Reader(tmp_path / "page.html").text.count("s, no answer") > 2


@pytest.mark.usefixtures("page")
def test_the_second_look_hears_the_gyro(heard: Counter[int]) -> None:
    """Both cameras' common pipeline, and each camera's own."""
    assert sorted(heard.values()) == [PAIRS] * (1 + len(CAMERAS))


# ---------------------------------------------------------------------------- in a browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser that is on this machine; its own downloads are not needed."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    programs = ("chromium", "chromium-browser", "google-chrome")
    program = next(filter(None, map(shutil.which, programs)), None)
    if program is None:
        pytest.skip(f"none of {', '.join(programs)} is installed")
    options = [
        *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
        *("--disable-background-networking", "--disable-component-update"),
    ]
    with api.sync_playwright() as started:
        running = started.chromium.launch(executable_path=program, args=options, timeout=60_000)
        yield running
        running.close()


@pytest.mark.parametrize("width", [390, 1200])
def test_a_browser_shows_all_of_it(browser: Any, page: Path, width: int) -> None:
    tab = browser.new_page(viewport={"width": width, "height": 844})
    said: list[str] = []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("request", lambda request: said.append(request.url[:80]) if _fetches(request) else None)
    tab.goto(page.as_uri())
    missing = "[...document.images].filter(image => !(image.naturalWidth > 0)).length"
    assert tab.evaluate(missing) == 0
    assert tab.evaluate("document.images.length") > 20
    # Nothing sticks out to the side.
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    # Type in a chart is no smaller than it can be read at.
    narrow = (
        "[...document.images].every(image => image.getBoundingClientRect().width <= innerWidth)"
    )
    assert tab.evaluate(narrow)
    assert said == []
    tab.close()


def _fetches(request: Any) -> bool:
    return not request.url.startswith(("data:", "file:"))

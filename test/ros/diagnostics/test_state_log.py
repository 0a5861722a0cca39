"""Which states get a line in a node's log."""

from __future__ import annotations

import pytest
from craft import Craft
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.logging import LoggingSeverity, get_logger, set_logger_level
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from horizon_sensor_ros.ros.diagnostics.diagnostics import (
    ERROR,
    OK,
    STALE,
    WARN,
    Health,
    diagnostic_message,
)
from horizon_sensor_ros.ros.diagnostics.state_log import StateLog, why_unheard

pytestmark = pytest.mark.usefixtures("environment")


def status_of(level: bytes, state: str, reason: str, **values: str) -> DiagnosticStatus:
    health = Health(level, state, reason)
    return diagnostic_message("node: horizon", "/node", health, values, 0).status[0]


GOOD = status_of(OK, "ok", "fix from camera_1")
DARK = [status_of(WARN, "no_fix", f"no_limb: only {n} candidates") for n in range(3)]
MUTE = [status_of(STALE, "stale", f"no frames from camera_1 for {n}.5 s") for n in range(3)]
ODD = status_of(ERROR, "refused", "camera_1: unknown encoding 'nv12'")
SMALL = status_of(ERROR, "refused", "camera_1: image is 3 x 2, camera_info says 640 x 480")


def lines_of(
    reports: list[DiagnosticStatus],
    capfd: pytest.CaptureFixture[str],
    why: str = "",
) -> list[str]:
    logger = get_logger("state_log_test")
    set_logger_level(logger.name, LoggingSeverity.INFO)
    log = StateLog(logger)
    for report in reports:
        log.on_report(report, lambda: why)
    return [line.split(": ", 1)[1] for line in capfd.readouterr().err.splitlines()]


def test_each_state_once_and_only_when_it_lasts(capfd: pytest.CaptureFixture[str]) -> None:
    assert lines_of([GOOD, GOOD, GOOD], capfd) == ["now ok: fix from camera_1"]
    assert lines_of([GOOD, DARK[0]] * 5, capfd) == []
    assert lines_of([GOOD, GOOD, DARK[0], GOOD, GOOD], capfd) == ["now ok: fix from camera_1"]
    assert lines_of([GOOD, GOOD, ODD, ODD, GOOD, GOOD], capfd) == [
        "now ok: fix from camera_1",
        "now refused: camera_1: unknown encoding 'nv12'",
        "now ok: fix from camera_1",
    ]


def test_another_figure_is_no_news_and_another_reason_is(capfd: pytest.CaptureFixture[str]) -> None:
    assert lines_of(DARK, capfd) == ["now no_fix: no_limb: only 1 candidates"]
    assert lines_of(MUTE, capfd) == ["now stale: no frames from camera_1 for 1.5 s"]
    assert len(lines_of([ODD, ODD, SMALL, SMALL], capfd)) == 2


def test_topics_that_nobody_publishes_are_said_where_something_is_wanting(
    capfd: pytest.CaptureFixture[str],
) -> None:
    (line,) = lines_of(MUTE, capfd, "nobody publishes /a/image_raw, /a/camera_info")
    assert line.endswith("; nobody publishes /a/image_raw, /a/camera_info")
    (line,) = lines_of([ODD, ODD], capfd, "nobody publishes /b/image_raw")
    assert "nobody" not in line


def test_a_publisher_that_appears_is_news(capfd: pytest.CaptureFixture[str]) -> None:
    log = StateLog(get_logger("state_log_test"))
    for missing in ("nobody publishes /a, /b", "nobody publishes /b", ""):
        for _ in range(2):
            log.on_report(MUTE[0], lambda missing=missing: missing)
    lines = capfd.readouterr().err.splitlines()
    assert [line.partition("nobody publishes ")[2] for line in lines] == ["/a, /b", "/b", ""]


def test_who_publishes_is_looked_up_and_compressed_images_are_told(craft: Craft) -> None:
    name = "/left/image_raw/compressed"
    publisher = craft.node.create_publisher(CompressedImage, name, 1)
    topics = {
        "camera_1/image_raw": Image,
        "left/image_raw": Image,
        "left/camera_info": CameraInfo,
    }
    wanted = ["/camera_1/image_raw", name]
    craft.wait(lambda: all(map(craft.node.count_publishers, wanted)), "the publishers")
    unheard = why_unheard(craft.node, topics)
    assert unheard == "nobody publishes /left/image_raw (only compressed), /left/camera_info"
    craft.node.destroy_publisher(publisher)
    craft.wait(lambda: not craft.node.count_publishers(name), "the end of a publisher")
    unheard = why_unheard(craft.node, topics)
    assert unheard == "nobody publishes /left/image_raw, /left/camera_info"


def test_a_topic_of_another_type_is_told(craft: Craft) -> None:
    """Such a publisher is there, but nothing of it arrives."""
    topics = {"left/image_raw": Image, "left/camera_info": CameraInfo}
    publishers = [
        craft.node.create_publisher(CompressedImage, "/left/image_raw", 1),
        craft.node.create_publisher(CameraInfo, "/left/camera_info", 1),
    ]
    craft.wait(lambda: all(map(craft.node.count_publishers, topics)), "the publishers")
    told = "/left/image_raw is sensor_msgs/msg/CompressedImage, not sensor_msgs/msg/Image"
    assert why_unheard(craft.node, topics) == told
    for publisher in publishers:
        craft.node.destroy_publisher(publisher)


def test_a_topic_that_helps_and_is_refused_is_said(capfd: pytest.CaptureFixture[str]) -> None:
    used = status_of(OK, "ok", "fix from camera_1", imu="used")
    turned = status_of(OK, "ok", "fix from camera_1", imu="refused: header frame is 'imu_link'")
    assert lines_of([used, used, turned, turned, turned], capfd) == [
        "now ok: fix from camera_1",
        "now ok: fix from camera_1; imu refused: header frame is 'imu_link'",
    ]
    # It grows older with each report, which is no news.
    old = [status_of(OK, "ok", "a fix", coarse_pose=f"too old: 7{n}.2 s") for n in range(4)]
    assert lines_of(old, capfd) == ["now ok: a fix; coarse_pose too old: 71.2 s"]

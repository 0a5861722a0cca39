"""Frames that are of no use, sent to the nodes' processes: a reason and no estimate, and the next
good frame works.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from craft import ESTIMATES, Craft
from horizon_messages import (
    CAMERAS,
    HEIGHT,
    PERIOD_NS,
    START_NS,
    WIDTH,
    image_of,
    write_parameters,
)
from node_processes import Program

NODES = ("local_vertical_node", "attitude_node")

# Each bad thing, what it is done to, and the words of the reason.
BAD_IMAGES: dict[str, tuple[dict[str, Any], str]] = {
    "zero size": ({"width": 0, "height": 0}, "image of 0 x 0"),
    "truncated": ({"height": HEIGHT + 9}, "image data has"),
    "wrong step": ({"step": 5}, "step is 5 bytes"),
    "unknown encoding": ({"encoding": "yuv9000"}, "unknown encoding 'yuv9000'"),
    "float image": ({"encoding": "32FC1"}, "unknown encoding '32FC1'"),
}
BAD_INFOS: dict[str, tuple[dict[str, Any], str]] = {
    "uncalibrated": ({"k": [0.0] * 9}, "uncalibrated"),
    "not finite": ({"k": [float("nan")] * 9}, "not finite"),
    "other size": ({"width": WIDTH + 2}, f"image is {WIDTH} x {HEIGHT}"),
    "unknown model": ({"distortion_model": "magic"}, "magic"),
}
FLAT_FRAMES = {"constant": 80, "all black": 0, "all white": 255}

pytestmark = pytest.mark.usefixtures("environment", "nodes")


@pytest.fixture
def nodes(start: Callable[..., Program], craft: Craft, tmp_path: Path) -> None:
    """Both horizon nodes, each its own process, that have complained that they know no camera yet
    and are heard.
    """
    # A busy machine may keep a process waiting for a second.
    path = write_parameters(tmp_path / "params.yaml", stale_after=3.0, diagnostics_period=0.2)
    for name in NODES:
        # Frames are sent faster than their stamps say: the nodes are to wait for the other camera.
        start(name, "--params-file", str(path), "-p", "camera_timeout:=0.0")
    for node in NODES:
        words = "no camera_info yet for camera_1"
        craft.insist(lambda: craft.send_frame("camera_1", -1), node, words)
    craft.match(NODES)


def expect_refusal(craft: Craft, index: int, state: str, words: str) -> None:
    for node in NODES:
        craft.wait_for_state(state, words, node)
    for topic in ESTIMATES:
        assert index not in craft.stamps(topic)


def send_flat(craft: Craft, camera: str, index: int, level: int) -> None:
    flat = np.full((HEIGHT, WIDTH), level, np.uint8)
    craft.send(f"/{camera}/image_raw", image_of(flat, START_NS + index * PERIOD_NS, camera))


def test_images_that_cannot_be_read(craft: Craft) -> None:
    for index, (fields, words) in zip(range(1, 99, 2), BAD_IMAGES.values(), strict=False):
        craft.expect_pair(index)
        craft.heard.clear()
        craft.send_frame("camera_1", index + 1)
        craft.send_frame("camera_2", index + 1, **fields)
        expect_refusal(craft, index + 1, "refused", f"camera_2: {words}")
    craft.expect_pair(99)


def test_calibrations_that_are_none(craft: Craft) -> None:
    for index, (fields, words) in zip(range(1, 99, 2), BAD_INFOS.values(), strict=False):
        craft.expect_pair(index)
        craft.heard.clear()
        craft.send_info("camera_1", **fields)
        for camera in CAMERAS:
            craft.send_frame(camera, index + 1)
        # Nothing orders an image behind the camera_info sent before it, but time.
        for node in NODES:
            craft.insist(partial(craft.send_frame, "camera_1", index + 1), node, words)
    craft.expect_pair(99)


def test_frames_that_show_nothing(craft: Craft) -> None:
    for index, level in zip(range(1, 99, 2), FLAT_FRAMES.values(), strict=False):
        craft.expect_pair(index)
        craft.heard.clear()
        for camera in CAMERAS:
            send_flat(craft, camera, index + 1, level)
        expect_refusal(craft, index + 1, "no_fix", "")
    craft.expect_pair(99)


def test_a_stamp_that_repeats(craft: Craft) -> None:
    craft.expect_pair(1)
    for camera in CAMERAS:
        craft.send_frame(camera, 1)
    for node in NODES:
        craft.wait_for_state("refused", "camera_2: stamp repeats", node)
    assert all(craft.stamps(topic).count(1) == 1 for topic in ESTIMATES)
    craft.expect_pair(2)


def test_one_camera_that_is_silent(craft: Craft) -> None:
    craft.expect_pair(1)
    craft.heard.clear()
    index = 1
    for node in NODES:
        index = craft.insist_by_one("camera_1", index, node, "no frames from camera_2 for")
        craft.wait_for_state("silent", "no frames from camera_2 for", node)
    assert not any(craft.stamps(topic) for topic in ESTIMATES)
    craft.expect_pair(index + 1)


def test_time_that_runs_backwards(craft: Craft) -> None:
    for index in (20, 0, 1):
        craft.expect_pair(index)


def test_one_camera_that_is_blind(craft: Craft) -> None:
    """The other one's fix, and it is said."""
    craft.expect_pair(1)
    craft.heard.clear()
    craft.send_frame("camera_1", 2)
    send_flat(craft, "camera_2", 2, 80)
    for node in NODES:
        craft.wait_for_state("degraded", "camera_2 left out", node)
    craft.wait(lambda: all(craft.stamps(topic) == [2] for topic in ESTIMATES), "one fix each")
    craft.expect_pair(3)

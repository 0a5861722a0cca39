"""Messages gone wrong in every field, through the decoders and the pipelines.

Nothing raises, nothing wrong is published, nothing grows. The slow run takes 100,000 messages.
"""

from __future__ import annotations

import ctypes
import gc
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rclpy
from horizon_messages import (
    ALTITUDE_M,
    CAMERAS,
    FOCAL_PX,
    HEIGHT,
    PARAMETERS,
    PERIOD_NS,
    START_NS,
    WIDTH,
    camera_info_of,
    coarse_pose_of,
    horizon_gray,
    image_of,
    imu_of,
    nadir_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from message_fuzz import corrupt
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from target_messages import CLOUD_PERIOD_NS, MESHES, cloud_of, timed_cloud, truth_at

from horizon_sensor_ros.core.limb.edge.model import KEPT_BYTES, EdgeTable
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.messages.aiding import coarse_pose_from_message, rate_from_imu
from horizon_sensor_ros.ros.messages.camera_info import camera_from_info
from horizon_sensor_ros.ros.messages.images import gray_from_image
from horizon_sensor_ros.ros.messages.point_cloud import points_from_cloud
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.messages.stamps import stamp_ns
from horizon_sensor_ros.ros.nodes.horizon_node import LocalVerticalNode
from horizon_sensor_ros.ros.parameters.file import read_parameter_file
from horizon_sensor_ros.ros.parameters.horizon import horizon_parameters
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.ros.parameters.ignored import unknown_parameters
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.parameters.reference import parameter_file
from horizon_sensor_ros.ros.parameters.target import target_parameters
from horizon_sensor_ros.ros.parameters.target_settings import target_settings
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, Step
from horizon_sensor_ros.ros.pipelines.target_pipeline import TargetPipeline, TargetStep
from horizon_sensor_ros.sim.tof_camera import ToFCamera

# Half the size of the other tests' frames.
SHRINK = 2
NADIR = nadir_of(2.0, -3.0)
POSITION = truth_at(0)[:3, 3]
BAD_IN_A_ROUND = 6
NUMBERS = (1_000, pytest.param(100_000, marks=pytest.mark.slow))


@cache
def gray(camera: str) -> np.ndarray:
    size = (WIDTH // SHRINK, HEIGHT // SHRINK)
    return cv2.resize(horizon_gray(camera, NADIR), size, interpolation=cv2.INTER_AREA)


def good_info(camera: str, stamp: int) -> Any:
    width, height, focal = WIDTH // SHRINK, HEIGHT // SHRINK, FOCAL_PX / SHRINK
    k = [focal, 0.0, (width - 1) / 2, 0.0, focal, (height - 1) / 2, 0.0, 0.0, 1.0]
    return camera_info_of(stamp, camera, width=width, height=height, k=k)


def good_image(camera: str, stamp: int) -> Any:
    """As of a live camera, of which no image is ever that of before."""
    live = gray(camera).copy()
    live.flat[stamp // (PERIOD_NS // 100) % live.size] ^= 1
    return image_of(live, stamp, camera)


def heap_bytes() -> int:
    """What is in use, but for the limb's tables: those are kept up to a bound, and looks of broken
    cameras come late. What the allocator holds for its next use is given back first.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    (line,) = [
        line for line in Path("/proc/self/status").read_text().splitlines() if "RssAnon" in line
    ]
    return 1024 * int(line.split()[1]) - sum(table.nbytes for table in kept_tables())


def kept_tables() -> list[EdgeTable]:
    return [kept for kept in gc.get_objects() if isinstance(kept, EdgeTable)]


class HorizonFuzz:
    """A pipeline, rounds of bad messages for it, and a look at every estimate."""

    def __init__(self, seed: int) -> None:
        values = {**PARAMETERS, "planet": "wgs84"}
        self.pipeline = HorizonPipeline(horizon_settings(values).pipeline)
        self.rng = np.random.default_rng(seed)
        self.messages = 0
        self.fixes = 0
        self.wrong: list[str] = []
        self.now = START_NS

    def round(self) -> None:
        """Bad messages on every topic, among them a good pair."""
        position = -1.0 * (6371e3 + ALTITUDE_M) * NADIR
        for camera in CAMERAS:
            for kind in self.rng.permutation([0, 1, 2, 3] * BAD_IN_A_ROUND)[: 2 * BAD_IN_A_ROUND]:
                self.now += PERIOD_NS // 100
                if kind == 0:
                    self.info(camera, bad=True)
                    self.image(camera, bad=False)
                elif kind == 1:
                    self.info(camera, bad=False)
                    self.image(camera, bad=True)
                elif kind == 2:
                    pose = coarse_pose_of(self.now, position, np.eye(3))
                    corrupt(pose, self.rng)
                    self.pipeline.aiding.on_coarse_pose(pose)
                    self.messages += 1
                else:
                    imu = imu_of(self.now, (0.0, 0.0, 0.0))
                    corrupt(imu, self.rng)
                    self.pipeline.aiding.on_imu(imu)
                    self.messages += 1
        for _ in range(2):
            self.now += PERIOD_NS
            for camera in CAMERAS:
                self.info(camera, bad=False)
                self.image(camera, bad=False)

    def info(self, camera: str, *, bad: bool) -> None:
        msg = good_info(camera, self.now)
        self.what = f"info {corrupt(msg, self.rng)} {msg}" if bad else ""
        self.pipeline.on_camera_info(camera, msg)
        self.messages += 1

    def image(self, camera: str, *, bad: bool) -> None:
        msg = good_image(camera, self.now)
        if bad:
            self.what = f"image {corrupt(msg, self.rng)} {msg.encoding} {msg.width} {msg.height}"
        self.judge(self.pipeline.on_image(camera, msg))
        self.messages += 1

    def judge(self, step: Step) -> None:
        if step.refusal is not None and step.refusal.cause == "internal_error":
            self.wrong.append(f"{step.refusal.reason} {self.what}")
        for result in step.results:
            fix = result.fix
            if fix.status is not Status.OK:
                continue
            self.fixes += 1
            cosine = np.clip(fix.fit.nadir_base @ NADIR, -1.0, 1.0)
            if not np.degrees(np.arccos(cosine)) < 1.0:
                cameras = [frame.view.camera for frame in result.frames]
                self.wrong.append(f"{fix.fit.nadir_base} {fix.cameras_used} {cameras}")


class TargetFuzz:
    """The same with clouds of a target that does not move."""

    def __init__(self, seed: int) -> None:
        self.pipeline = TargetPipeline(target_settings({}).pipeline)
        self.rng = np.random.default_rng(seed)
        self.messages = 0
        self.wrong: list[str] = []
        self.now = START_NS

    def round(self) -> None:
        """Bad clouds, and three good ones."""
        for bad in [True] * BAD_IN_A_ROUND + [False] * 3:
            self.now += CLOUD_PERIOD_NS // 10
            msg = self.cloud(points(self.messages % 8))
            changed = corrupt(msg, self.rng) if bad else []
            self.judge(self.pipeline.on_cloud(msg), changed)
            self.messages += 1

    def cloud(self, seen: np.ndarray) -> Any:
        return cloud_of(seen, self.now)

    def judge(self, step: TargetStep, changed: list[str]) -> None:
        if step.refusal is not None and step.refusal.cause == "internal_error":
            self.wrong.append(f"{step.refusal.reason} {changed}")
        if step.fix is not None and step.fix.new_frame and {"fields.offset", "data"} & {*changed}:
            # Floats read from elsewhere in a point are another target, and bytes that are wrong
            # move the centroid, where the frame's origin is: one in 200 such clouds by metres. A
            # first cloud has no other to contradict it.
            return
        for topic, msg in step.outputs:
            if topic == "target/twist":
                continue
            p, q = msg.pose.pose.position, msg.pose.pose.orientation
            turn = 2 * np.degrees(np.arccos(min(abs(q.w), 1.0)))
            expected = POSITION if topic == "target/pose" else np.zeros(3)
            off = float(np.linalg.norm(np.array([p.x, p.y, p.z]) - expected))
            # The frame's origin is the centroid of the first cloud, which may be any part of it.
            if not (off < (0.7 if topic == "target/pose" else 0.1) and turn < 5.0):
                self.wrong.append(f"{topic} off by {off} m, {turn} deg {changed}")


class SweptTargetFuzz(TargetFuzz):
    """The same with a lidar's clouds, whose points tell when they were measured."""

    def cloud(self, seen: np.ndarray) -> Any:
        period = CLOUD_PERIOD_NS // 10
        times_ns = np.linspace(0, period, seen.size // 3).reshape(seen.shape[:2])
        return timed_cloud(seen, self.now, "t", times_ns, "<u4")


@cache
def points(seed: int) -> np.ndarray:
    camera = ToFCamera(width=32, height=32, pixel_pitch_m=255e-6)
    return camera.scan(MESHES["n5"], truth_at(0), np.random.default_rng(seed)).points


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("kind", [HorizonFuzz, TargetFuzz, SweptTargetFuzz])
def test_bad_messages_leave_nothing_behind_and_good_ones_work_again(
    kind: type[HorizonFuzz | TargetFuzz], number: int
) -> None:
    fuzz = kind(seed=0)
    fuzz.pipeline.warm_up()
    while fuzz.messages < number // 4:
        fuzz.round()
    before = heap_bytes()
    while fuzz.messages < number:
        fixes = fuzz.pipeline.counts["fixes"]
        fuzz.round()
        # Whatever went before, good input gives estimates again.
        assert fuzz.pipeline.counts["fixes"] > fixes
    assert not fuzz.wrong
    assert heap_bytes() - before < 20_000_000
    assert sum(table.nbytes for table in kept_tables()) <= KEPT_BYTES


@settings(max_examples=300)
@given(st.integers(0, 2**32), st.integers(0, 4), st.integers(1, 30))
def test_the_decoders_refuse_and_never_raise(seed: int, kind: int, times: int) -> None:
    """Bad in many fields at once; hypothesis looks for the fewest that break something."""
    rng = np.random.default_rng(seed)
    msg, decode = (
        (good_image("camera_1", START_NS), gray_from_image),
        (good_info("camera_1", START_NS), camera_from_info),
        (cloud_of(points(0), START_NS), points_from_cloud),
        (coarse_pose_of(START_NS, NADIR * -7e6, np.eye(3)), decoded_pose),
        (imu_of(START_NS, (0.0, 0.0, 0.0)), decoded_rate),
    )[kind]
    for _ in range(times):
        corrupt(msg, rng)
    stamp = stamp_ns(msg)
    assert isinstance(stamp, int | Refusal)
    decoded = decode(msg)
    if isinstance(decoded, Refusal):
        assert decoded.cause
        assert 0 < len(decoded.reason) < 500
        assert decoded.reason.isprintable()


def decoded_pose(msg: Any) -> Any:
    return coarse_pose_from_message(msg, Planet.wgs84())


def decoded_rate(msg: Any) -> Any:
    return rate_from_imu(msg, "base_link")


# ---------------------------------------------------------------------------- parameter files


def wrong_text(text: str, rng: np.random.Generator) -> str:
    """A parameter file with some lines or characters wrong."""
    lines = text.splitlines()
    for _ in range(rng.integers(1, 4)):
        row = int(rng.integers(len(lines)))
        line = lines[row]
        key = line.split(":")[0]
        where = int(rng.integers(len(line) + 1))
        lines[row] = (
            f"{key}: {_YAML_VALUES[rng.integers(len(_YAML_VALUES))]}",
            "",
            line[:where] + _YAML_SIGNS[rng.integers(len(_YAML_SIGNS))] + line[where:],
            line[:where],
            " " * int(rng.integers(9)) + line,
            lines[rng.integers(len(lines))],
        )[rng.integers(6)]
    return "\n".join(lines)


_YAML_SIGNS = (*":-[]{}&*!|>%@`\"'#,?\t", "\u0000", "\u202e", "<<", "!!python/object:os.system ")
_YAML_VALUES = (
    *("", "null", "~", ".nan", ".inf", "-.inf", "1e400", "0x10", "010", "1_000", "-1", "9" * 400),
    *("yes", "true", "[]", "[[]]", "[1, a]", "{}", "{a: 1}", "2020-01-01", "'1.0'", "!!str 5"),
    *("!!binary aGk=", "!!python/name:os.system", "[1.0, 2.0, 3.0, 4.0]", "[camera_1]", "a: b: c"),
    *("[camera_1, camera_1]", "['/../x']", "[0, 0, 0, 0]", "[.nan, 0, 0, 1]", "&a [*a]"),
)
_NODES = ("local_vertical_node", "target_pose_node")
_GOOD_FILE = parameter_file() + "".join(
    f"    {name}: {value}\n" for name, value in PARAMETERS.items()
)


def expect_one_line(error: ParameterError) -> None:
    assert len(str(error).splitlines()) == 1


def settings_or_reason(path: Path, node: str) -> None:
    try:
        values = read_parameter_file(path, node)
        (target_settings if node == "target_pose_node" else horizon_settings)(values)
        for own in (horizon_parameters(values), target_parameters()):
            unknown_parameters(values, own)
    except ParameterError as error:
        expect_one_line(error)


@pytest.mark.parametrize("number", [200, pytest.param(5_000, marks=pytest.mark.slow)])
def test_bad_parameter_files(number: int, tmp_path: Path) -> None:
    """As `horizon_replay` reads them."""
    path = tmp_path / "params.yaml"
    rng = np.random.default_rng(1)
    short = "\n".join(line for line in _GOOD_FILE.splitlines() if line.strip()[:1] not in ("", "#"))
    for _ in range(number):
        path.write_text(wrong_text(short, rng))
        for node in _NODES:
            settings_or_reason(path, node)


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("number", [15, pytest.param(300, marks=pytest.mark.slow)])
def test_bad_parameter_files_for_a_node(number: int, tmp_path: Path) -> None:
    """As rclpy reads them: what its parser takes gives a node or one line."""
    path = tmp_path / "params.yaml"
    rng = np.random.default_rng(2)
    short = "\n".join(line for line in _GOOD_FILE.splitlines() if line.strip()[:1] not in ("", "#"))
    made = 0
    for _ in range(number):
        path.write_text(wrong_text(short, rng))
        context = Context()
        try:
            rclpy.init(context=context, args=["--ros-args", "--params-file", str(path)])
        except (rclpy_implementation.RCLError, UnicodeDecodeError, ValueError):
            # rcl's own parser has refused the file.
            continue
        try:
            LocalVerticalNode(context=context).destroy_node()
            made += 1
        except ParameterError as error:
            expect_one_line(error)
        finally:
            rclpy.shutdown(context=context)
    assert made

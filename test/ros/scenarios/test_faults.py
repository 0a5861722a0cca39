"""What a flight does to the nodes, as processes over real DDS, and what they promise.

Within 2 s of good input there are estimates again; memory stays bounded; bad data give no estimate.
The 2 s are of the input's own stamps, so that a busy machine does not fail a test. `make
test-faults` runs each ten times.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from craft import ESTIMATES, Chaser, Craft
from horizon_messages import (
    CAMERAS,
    FOCAL_PX,
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
from node_processes import Listener, Program
from sensor_msgs.msg import Image
from target_messages import CLOUD_PERIOD_NS, cloud_of, scan, stamp_of

from horizon_sensor_ros.ros.pipelines.target_pipeline import TARGET_TOPICS

RECOVERY_NS = 2_000_000_000
# An hour: far from any slop, and longer than anything that is kept.
JUMP_NS = 3_600_000_000_000
# Frames and clouds in the queues, and what the allocator keeps of them for each of the middleware's
# threads: 45 MB have been seen on a loaded machine. The frames of a flood are some 140 MB.
MEMORY_BOUND_BYTES = 64_000_000
HORIZON_NODES = ("local_vertical_node", "attitude_node")
TARGET_NODE = "target_pose_node"
POSE = next(iter(TARGET_TOPICS))
# So many different pictures and clouds there are; they come round again and again.
VIEWS = 8

pytestmark = pytest.mark.usefixtures("environment")


@pytest.fixture
def params(tmp_path: Path) -> list[str]:
    # The craft of these pictures leaps from view to view. A set across a leap would be turned to
    # one moment by a rate that no craft has, so that only frames of one moment are paired.
    path = write_parameters(
        tmp_path / "params.yaml", stale_after=0.5, diagnostics_period=0.2, max_gap=100.0, slop=0.001
    )
    return ["--params-file", str(path)]


@cache
def picture(camera: str, view: int) -> np.ndarray:
    return horizon_gray(camera, nadir_of(*attitude_at(view)))


def view_at(stamp: int) -> int:
    return stamp // PERIOD_NS % VIEWS


Pair = Callable[[str, int], tuple[Image, Any]]


def good(camera: str, stamp: int) -> tuple[Image, Any]:
    """Image and camera_info of a moment."""
    return (
        image_of(picture(camera, view_at(stamp)), stamp, camera),
        camera_info_of(stamp, camera),
    )


def smaller(camera: str, stamp: int) -> tuple[Image, Any]:
    """The same from a camera with half the resolution."""
    gray = cv2.resize(
        picture(camera, view_at(stamp)), (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA
    )
    f, x, y = FOCAL_PX / 2, (WIDTH / 2 - 1) / 2, (HEIGHT / 2 - 1) / 2
    k = [f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0]
    info = camera_info_of(stamp, camera, width=WIDTH // 2, height=HEIGHT // 2, k=k)
    return image_of(gray, stamp, camera), info


def longer(camera: str, stamp: int) -> tuple[Image, Any]:
    """The same through a lens of 1.25 times the focal length."""
    x, y = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    zoom = np.array([[1.25, 0.0, -0.25 * x], [0.0, 1.25, -0.25 * y]])
    gray = cv2.warpAffine(picture(camera, view_at(stamp)), zoom, (WIDTH, HEIGHT))
    k = [1.25 * FOCAL_PX, 0.0, x, 0.0, 1.25 * FOCAL_PX, y, 0.0, 0.0, 1.0]
    return image_of(gray, stamp, camera), camera_info_of(stamp, camera, k=k)


def ns_of(msg: Any) -> int:
    return msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec


class Flight:
    """A craft, and which of the pairs that its cameras have sent are good ones."""

    def __init__(self, craft: Craft) -> None:
        self.craft = craft
        self.good: set[int] = set()

    def send(
        self,
        stamp: int,
        pair: Pair = good,
        cameras: tuple[str, ...] = CAMERAS,
        infos: bool = True,
    ) -> None:
        for camera in cameras:
            image, info = pair(camera, stamp)
            if infos:
                self.craft.send(f"/{camera}/camera_info", info)
            self.craft.send(f"/{camera}/image_raw", image)

    def send_good(self, stamp: int, pair: Pair = good) -> None:
        self.good.add(stamp)
        self.send(stamp, pair)

    def stamps(self, topic: str) -> list[int]:
        return [ns_of(msg) for msg in self.craft.estimates(topic)]

    def expect_recovery(self, start: int, pair: Pair = good) -> int:
        """Send good pairs, ten a second, for 2 s at most; return the next stamp.

        Of each topic there must be an estimate of one of them.
        """
        sent = range(start, start + RECOVERY_NS + 1, PERIOD_NS)

        def recovered() -> bool:
            return all(set(self.stamps(topic)) & set(sent) for topic in ESTIMATES)

        now = start
        for now in sent:
            self.send_good(now, pair)
            self.craft.spin(PERIOD_NS * 1e-9)
            if recovered():
                break
        said = [(status.name, status.message) for status in self.craft.statuses()[-4:]]
        self.craft.wait(recovered, f"estimates after {start}; the nodes say {said}")
        self.expect_truth()
        return now + PERIOD_NS

    def expect_first_fix(self, start: int, *nodes: str) -> None:
        """The same of nodes that were started again.

        Fast DDS connects the inputs and outputs of a new process one after the other, in up to some
        3 s. Input is good once it arrives; of the fix the node's diagnostics tell, for that is
        already connected.
        """
        self.craft.reach(nodes)
        sent = range(start, start + RECOVERY_NS + 1, PERIOD_NS)
        now = start
        for now in sent:
            self.send_good(now)
            self.craft.spin(PERIOD_NS * 1e-9)
            if all(has_fixes(self.craft, node) for node in nodes):
                break
        self.craft.wait(lambda: all(has_fixes(self.craft, n) for n in nodes), "the first fixes")

        def estimates() -> bool:
            nonlocal now
            now += PERIOD_NS
            self.send_good(now)
            self.craft.spin(PERIOD_NS * 1e-9)
            return all(any(s >= start for s in self.stamps(topic)) for topic in ESTIMATES)

        self.craft.wait(estimates, "estimates")
        self.expect_truth()

    def expect_truth(self) -> None:
        """Each estimate heard so far is of a good pair, and is what its pictures show."""
        for topic in ESTIMATES:
            assert set(self.stamps(topic)) <= self.good
        for msg in self.craft.estimates("local_vertical"):
            nadir = nadir_of(*attitude_at(view_at(ns_of(msg))))
            found = np.array([msg.vector.x, msg.vector.y, msg.vector.z])
            assert np.degrees(np.arccos(np.clip(found @ nadir, -1, 1))) < 0.15
        for msg in self.craft.estimates("attitude"):
            assert abs(msg.pose.pose.position.z - 500e3) < 20e3


@pytest.fixture
def flight(craft: Craft) -> Flight:
    return Flight(craft)


def start_again(
    start: Callable[..., Program], listener: Listener, name: str, params: list[str], *nodes: str
) -> None:
    """Start an executable and wait for its nodes' first words."""
    began = time.time_ns()
    start(name, *params)

    def heard(node: str) -> bool:
        # What was under way from the process that died has an older stamp.
        return any(
            topic == "/diagnostics" and msg.status[0].name.startswith(node) and ns_of(msg) > began
            for topic, msg in listener.heard
        )

    for node in nodes:
        listener.wait(lambda node=node: heard(node), f"diagnostics of {node}")
    listener.heard.clear()


def has_fixes(listener: Listener, node: str) -> bool:
    return any(
        value.key == "fixes" and int(value.value) > 0
        for status in listener.statuses(node)
        for value in status.values
    )


def heap_bytes(program: Program) -> int:
    """Memory of the process without what it shares: shared memory belongs to the transport."""
    text = Path(f"/proc/{program.process.pid}/status").read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("RssAnon")]
    return 1024 * int(line.split()[1])


# ---------------------------------------------------------------------------- processes that die


@pytest.mark.parametrize("victim", HORIZON_NODES)
def test_a_killed_node_comes_back_and_the_other_does_not_notice(
    start: Callable[..., Program], flight: Flight, params: list[str], victim: str
) -> None:
    craft = flight.craft
    programs = {name: start(name, *params) for name in HORIZON_NODES}
    craft.match(HORIZON_NODES)
    now = flight.expect_recovery(START_NS)
    survivor = next(topic for topic in ESTIMATES if not victim.startswith(topic))
    assert programs[victim].end(signal.SIGKILL)[0] == -signal.SIGKILL
    for _ in range(5):
        now += PERIOD_NS
        flight.send_good(now)
        craft.wait(lambda now=now: now in flight.stamps(survivor), f"{survivor} at {now}")
    start_again(start, craft, victim, params, victim)
    flight.expect_first_fix(now + PERIOD_NS, victim)


def test_all_nodes_in_one_process_come_back(
    start: Callable[..., Program], flight: Flight, params: list[str]
) -> None:
    craft = flight.craft
    program = start("horizon_sensor", *params)
    craft.match(HORIZON_NODES, 1)
    now = flight.expect_recovery(START_NS)
    assert program.end(signal.SIGKILL)[0] == -signal.SIGKILL
    for _ in range(5):
        now += PERIOD_NS
        flight.send(now)
    start_again(start, craft, "horizon_sensor", params, *HORIZON_NODES)
    flight.expect_first_fix(now + PERIOD_NS, *HORIZON_NODES)


def test_a_killed_target_node_comes_back(
    start: Callable[..., Program], chaser: Chaser, params: list[str]
) -> None:
    program = start(TARGET_NODE, *params)
    chaser.match()
    chaser.expect(cloud_of(scan(0), stamp_of(0)), 0, POSE)
    assert program.end(signal.SIGKILL)[0] == -signal.SIGKILL
    start_again(start, chaser, TARGET_NODE, params, TARGET_NODE)
    chaser.reach()
    for index in range(1, RECOVERY_NS // CLOUD_PERIOD_NS + 1):
        chaser.clouds.publish(cloud_of(scan(index % VIEWS), stamp_of(index)))
        chaser.spin(CLOUD_PERIOD_NS * 1e-9)
        if has_fixes(chaser, TARGET_NODE):
            break
    chaser.wait(lambda: has_fixes(chaser, TARGET_NODE), "the first fix")
    # The output may be connected later than the diagnostics.
    deadline = time.monotonic() + 20.0
    while not chaser.estimates(POSE):
        assert time.monotonic() < deadline
        index += 1
        chaser.clouds.publish(cloud_of(scan(index % VIEWS), stamp_of(index)))
        chaser.spin(CLOUD_PERIOD_NS * 1e-9)


# ---------------------------------------------------------------------------- cameras


@pytest.fixture
def sensor(start: Callable[..., Program], flight: Flight, params: list[str]) -> Program:
    """All nodes in one process, connected and with estimates of the pairs before START_NS."""
    program = start("horizon_sensor", *params)
    flight.craft.match(HORIZON_NODES, 1)
    flight.expect_recovery(START_NS - 10 * RECOVERY_NS)
    flight.craft.heard.clear()
    return program


@pytest.mark.usefixtures("sensor")
def test_cameras_that_stop_and_come_back(flight: Flight) -> None:
    words = "no frames from camera_2 for"
    now = START_NS
    for rest in (CAMERAS[:1], ()):
        flight.craft.heard.clear()

        def send_the_rest(rest: tuple[str, ...] = rest) -> None:
            nonlocal now
            flight.send(now, cameras=rest)
            now += PERIOD_NS

        for node in HORIZON_NODES:
            flight.craft.insist(send_the_rest, node, words)
        flight.expect_truth()
        now = flight.expect_recovery(now)


@pytest.mark.usefixtures("sensor")
def test_a_camera_that_changes_its_resolution(flight: Flight) -> None:
    words = f"image is {WIDTH // 2} x {HEIGHT // 2}"
    for node in HORIZON_NODES:
        flight.craft.insist(lambda: flight.send(START_NS, smaller, infos=False), node, words)
    flight.expect_truth()
    now = flight.expect_recovery(START_NS + RECOVERY_NS, smaller)
    # And back.
    flight.expect_recovery(now + RECOVERY_NS)


@pytest.mark.usefixtures("sensor")
def test_a_camera_that_changes_its_calibration(flight: Flight) -> None:
    now = START_NS
    for pair in (longer, good):
        flight.craft.heard.clear()
        # Without a pause the first frame may still be taken with the last calibration: nothing
        # orders an image behind the camera_info that was sent before it.
        for camera in CAMERAS:
            image, _ = pair(camera, now)

            def lose(camera: str = camera, image: Image = image) -> None:
                flight.craft.send_info(camera, k=[0.0] * 9)
                flight.craft.send(f"/{camera}/image_raw", image)

            for node in HORIZON_NODES:
                flight.craft.insist(lose, node, f"{camera}: camera_info is uncalibrated")
        flight.expect_truth()
        now = flight.expect_recovery(now + RECOVERY_NS, pair) + RECOVERY_NS


# ---------------------------------------------------------------------------- time


@pytest.mark.usefixtures("sensor")
def test_stamps_that_jump(flight: Flight) -> None:
    now = START_NS
    for jump in (JUMP_NS, -2 * JUMP_NS):
        now = flight.expect_recovery(now) + jump
    flight.expect_recovery(now)


@pytest.mark.usefixtures("sensor")
def test_one_camera_whose_stamps_jump(flight: Flight) -> None:
    now = START_NS
    for jump in (JUMP_NS, -2 * JUMP_NS):
        flight.craft.heard.clear()
        now = send_until_unpaired(flight, now, jump)
        flight.expect_truth()
        # The other one follows.
        now = flight.expect_recovery(now + jump)


def send_until_unpaired(flight: Flight, start: int, offset: int) -> int:
    """Send frames, the second camera's stamps so far off, until the nodes complain; next stamp."""
    words = "stamps are farther apart than slop, or one camera's arrive"
    now = start

    def send_apart() -> None:
        nonlocal now
        flight.send(now, cameras=("camera_1",))
        flight.send(now + offset, cameras=("camera_2",))
        now += PERIOD_NS

    for node in HORIZON_NODES:
        flight.craft.insist(send_apart, node, words)
    return now


def test_pairs_that_never_match(flight: Flight, sensor: Program) -> None:
    now = send_until_unpaired(flight, START_NS, PERIOD_NS // 2)
    before = heap_bytes(sensor)
    for _ in range(300):
        flight.send(now, cameras=("camera_1",))
        flight.send(now + PERIOD_NS // 2, cameras=("camera_2",))
        now += PERIOD_NS
        flight.craft.spin(0.003)
    flight.expect_truth()
    assert heap_bytes(sensor) - before < MEMORY_BOUND_BYTES
    flight.expect_recovery(now + PERIOD_NS)


# ---------------------------------------------------------------------------- load


def test_a_flood_at_ten_times_the_rate(flight: Flight, chaser: Chaser, sensor: Program) -> None:
    """Camera pairs of 30 Hz at 300, clouds of 5 Hz at 50, for three seconds of theirs."""
    chaser.match()
    clouds = [cloud_of(scan(view), 0) for view in range(VIEWS)]
    # What every picture and cloud needs once is no growth.
    for number in range(3 * VIEWS):
        stamp = START_NS - (4 * VIEWS - number) * PERIOD_NS
        flight.send_good(stamp)
        if number % 6 == 0:
            chaser.clouds.publish(cloud_of(scan(number // 6), stamp))
        flight.craft.spin(PERIOD_NS * 1e-9)
    before = heap_bytes(sensor)
    period = 1_000_000_000 // 300
    due = time.monotonic()
    for number in range(900):
        stamp = START_NS + number * period
        flight.send_good(stamp)
        if number % 6 == 0:
            cloud = clouds[number // 6 % VIEWS]
            cloud.header.stamp.sec, cloud.header.stamp.nanosec = divmod(stamp, 10**9)
            chaser.clouds.publish(cloud)
        due += period * 1e-9
        flight.craft.spin(due - time.monotonic())
    flight.craft.wait(lambda: all(map(flight.craft.estimates, ESTIMATES)), "estimates of the flood")
    chaser.wait(lambda: chaser.estimates(POSE), "a pose of the flood")
    flight.expect_truth()
    assert heap_bytes(sensor) - before < MEMORY_BOUND_BYTES
    # All that was in the queues has been worked off once nodes say that nothing comes any more.
    flight.craft.heard.clear()
    chaser.heard.clear()
    for node in HORIZON_NODES:
        flight.craft.wait_for_state("stale", "no frames from", node)
    chaser.wait_for_state("stale", "no clouds for", TARGET_NODE)
    flight.craft.heard.clear()
    now = flight.expect_recovery(START_NS + 10 * RECOVERY_NS)
    chaser.heard.clear()
    sent = range(now, now + RECOVERY_NS + 1, CLOUD_PERIOD_NS)
    for number, stamp in enumerate(sent):
        # Of the very same cloud again there would be no pose, should the first one's get lost.
        chaser.clouds.publish(cloud_of(scan(number % VIEWS), stamp))
        chaser.spin(CLOUD_PERIOD_NS * 1e-9)
        if any(ns_of(msg) in sent for msg in chaser.estimates(POSE)):
            break
    chaser.wait(lambda: any(ns_of(msg) in sent for msg in chaser.estimates(POSE)), "a pose")
    assert heap_bytes(sensor) - before < MEMORY_BOUND_BYTES


# ---------------------------------------------------------------------------- bags and disks


def replay(*arguments: object, file_bytes: int | None = None) -> tuple[int, str]:
    """Exit code and errors of `horizon_replay`, which may write files of at most so many bytes."""

    def limit() -> None:
        if file_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))

    done = subprocess.run(
        [sys.executable, "-m", "horizon_sensor_ros.tools.bags.replay", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        preexec_fn=limit,
        # Bytecode that is cut off at the limit would be read by whoever comes next.
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )
    return done.returncode, done.stderr


@pytest.fixture(params=["mcap", "sqlite3"])
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write_bag(tmp_path / "in", recording(4), request.param)


def expect_complaint(code: int, errors: str, words: str) -> None:
    last = errors.splitlines()[-1]
    assert code == 1, errors
    assert last.startswith("horizon_replay: ")
    assert words in last
    assert "Traceback" not in errors


def test_a_disk_that_is_full(bag: Path, params: list[str], tmp_path: Path) -> None:
    """A file may not grow past 3 kB; a file system without room is in test_replay.py."""
    arguments = (bag, tmp_path / "out", "--params", params[1])
    code, errors = replay(*arguments, file_bytes=3_000)
    expect_complaint(code, errors, "cannot write")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "params.yaml"]
    assert replay(*arguments)[0] == 0


def test_a_bag_cut_short(bag: Path, params: list[str], tmp_path: Path) -> None:
    (file,) = [path for path in bag.iterdir() if path.suffix in (".mcap", ".db3")]
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) * 2 // 3])
    arguments = (bag, tmp_path / "out", "--params", params[1])
    code, errors = replay(*arguments)
    expect_complaint(code, errors, str(bag))
    assert not (tmp_path / "out").exists()
    file.write_bytes(whole)
    assert replay(*arguments)[0] == 0

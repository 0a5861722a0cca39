"""horizon_demo: a simulated flight past the real nodes, over DDS, held against its truth."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path
from types import FrameType

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.attitude import quaternion_from_rotation
from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.sim.flight import Flight
from horizon_sensor_ros.tools.demo_errors import Truth, error_table, flight_errors
from horizon_sensor_ros.tools.demo_link import NANOSECONDS, Answers, DemoLink, LinkTimeoutError
from horizon_sensor_ros.tools.demo_processes import (
    NodeFailedError,
    NodeProcess,
    require_alive,
    running_nodes,
)
from horizon_sensor_ros.tools.demo_rendering import Moment, rendered
from horizon_sensor_ros.tools.demo_report import Sample, write_report
from horizon_sensor_ros.tools.package_share import share_directory
from horizon_sensor_ros.tools.private_domain import isolated_environment, private_domain

NODES = ("local_vertical_node", "attitude_node")
LEVEL_Z = "down"
_SAMPLES = 6
_QUIET_S = 3.0


class NoAnswerError(RuntimeError):
    """The nodes ran but published nothing."""


def main(argv: Sequence[str] | None = None) -> int:
    """Command line entry point; returns the exit code."""
    options = _parser().parse_args(argv)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _exit)
    try:
        _demo(options)
    except (NodeFailedError, LinkTimeoutError, NoAnswerError) as failure:
        print(f"horizon_demo: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("horizon_demo: interrupted", file=sys.stderr)
        return 130
    return 0


def _exit(number: int, _frame: FrameType | None) -> None:
    # As an exception, so that the nodes and the workers are ended on the way out.
    raise SystemExit(128 + number)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_demo",
        description="Fly a simulated orbit past the real nodes, each in its own process, and "
        "compare what they publish with the truth.",
    )
    parser.add_argument("--seconds", type=_positive, default=30.0, help="length of the flight")
    parser.add_argument("--rate", type=_positive, default=5.0, help="image pairs a second")
    parser.add_argument("--seed", type=int, default=0, help="of clouds and noise")
    parser.add_argument(
        "--output", type=Path, default=Path("demo_output"), help="directory of report and logs"
    )
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < np.inf:
        raise argparse.ArgumentTypeError(f"must be positive, got {text}")
    return value


def _demo(options: argparse.Namespace) -> None:
    options.output.mkdir(parents=True, exist_ok=True)
    flight = Flight(seed=options.seed)
    times_s = np.arange(0.0, options.seconds, 1.0 / options.rate).tolist()
    summary = (
        f"{options.seconds:g} s of an orbit at {flight.altitude_m / 1e3:.0f} km: {len(times_s)} "
        f"image pairs of {flight.camera.width} x {flight.camera.height} pixels "
        f"past {' and '.join(NODES)}."
    )
    print(summary)
    with private_domain() as domain:
        environment = isolated_environment(domain)
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(
            share_directory() / "config" / "fastdds.xml"
        )
        environment["ROS_LOG_DIR"] = str(options.output.resolve() / "ros_log")
        # For this process too: its own rclpy reads them when it starts.
        os.environ.update(environment)
        arguments = _node_arguments(flight.views)
        with (
            rendered(flight, times_s) as moments,
            running_nodes(NODES, arguments, environment, options.output) as nodes,
            DemoLink(domain, flight.views) as link,
        ):
            link.wait_for_nodes(NODES, lambda: require_alive(nodes))
            truths, sent_ns = _fly(link, moments, options.rate, nodes)
            answers = link.answers
            if not (answers.attitudes and answers.verticals):
                raise NoAnswerError(_why_nothing(answers, nodes))
    _report(options.output / "report.html", summary, truths, sent_ns, answers)


def _node_arguments(views: Sequence[CameraView]) -> list[str]:
    arguments = ["--ros-args", "-p", f"level_z:={LEVEL_Z}"]
    names = ", ".join(view.name for view in views)
    arguments += ["-p", f"cameras:=[{names}]"]
    for view in views:
        rotation = quaternion_from_rotation(view.rot_base_from_cam).tolist()
        arguments += ["-p", f"{view.name}.rotation:={rotation}"]
    return arguments


def _fly(
    link: DemoLink, moments: Sequence[Future[Moment]], rate_hz: float, nodes: Sequence[NodeProcess]
) -> tuple[list[Truth], dict[int, int]]:
    """Publish the flight at its rate, or slower if the drawing is; return truth and sending times.

    Stamps keep the flight's own time even then.
    """
    truths: list[Truth] = []
    sent_ns: dict[int, int] = {}
    pictured = set(np.linspace(0, len(moments) - 1, _SAMPLES).round().astype(int).tolist())
    start = time.time_ns()
    due = time.monotonic()
    for i, future in enumerate(tqdm(moments, unit="pair", desc="flight")):
        while not future.done():
            link.spin(0.02)
        link.spin(due - time.monotonic())
        due = max(due, time.monotonic()) + 1.0 / rate_hz
        require_alive(nodes)
        moment = future.result()
        stamp = start + round(moment.time_s * NANOSECONDS)
        if i in pictured:
            link.wanted_pictures.add(stamp)
        sent_ns[stamp] = time.time_ns()
        link.publish(stamp, moment.images)
        truths.append(Truth(stamp, moment.time_s, moment.nadir_base, moment.altitude_m))
    deadline = time.monotonic() + _QUIET_S
    while time.monotonic() < deadline and truths[-1].stamp not in link.answers.pictures:
        link.spin(0.1)
    return truths, sent_ns


def _why_nothing(answers: Answers, nodes: Sequence[NodeProcess]) -> str:
    lines = ["the nodes ran, but these topics stayed silent:"]
    heard = {"local_vertical": answers.verticals, "attitude": answers.attitudes}
    lines += [f"  {topic}" for topic, messages in heard.items() if not messages]
    lines += [
        f"{name} said: {values.get('state', '?')}, {values.get('reason', '')}"
        for name, values in answers.diagnostics.items()
    ]
    lines += [f"{node.name} printed:\n{node.last_words()}" for node in nodes]
    return "\n".join(lines)


def _report(
    path: Path, summary: str, truths: list[Truth], sent_ns: dict[int, int], answers: Answers
) -> None:
    errors = flight_errors(truths, answers.verticals, answers.attitudes, LEVEL_Z)
    latency_s = np.array(
        [(heard - sent_ns[stamp]) * 1e-9 for stamp, heard in answers.heard_ns.items()]
    )
    table = error_table(errors, latency_s)
    samples = [
        Sample(truth.time_s, answers.pictures[truth.stamp])
        for truth in truths
        if truth.stamp in answers.pictures
    ]
    write_report(path, summary, table, errors, samples)
    print(f"\n{table}\n\nreport with pictures: {path.resolve()}")

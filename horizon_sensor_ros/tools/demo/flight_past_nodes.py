"""A simulated flight, with a target in sight, past the real nodes over DDS; held against its truth,
recorded as a bag, and shown by that bag's report.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from horizon_sensor_ros.core.seconds import nearest_s_from_ns, ns_from_s, s_from_ns
from horizon_sensor_ros.ros.pipelines.target_pipeline import CLOUD_TOPIC
from horizon_sensor_ros.ros.process.node_names import HORIZON_NODES, NODES
from horizon_sensor_ros.sim.flight import Flight
from horizon_sensor_ros.sim.tumbling import TumblingTarget
from horizon_sensor_ros.tools.bags.output_bag import check_own
from horizon_sensor_ros.tools.demo.failures import NoAnswerError
from horizon_sensor_ros.tools.demo.link import (
    ATTITUDE_TOPIC,
    OUTPUT_TOPICS,
    VERTICAL_TOPIC,
    Answers,
    DemoLink,
    input_topics,
)
from horizon_sensor_ros.tools.demo.processes import (
    NodeProcess,
    require_alive,
    running_nodes,
)
from horizon_sensor_ros.tools.demo.recording import DemoBag, write_parameters
from horizon_sensor_ros.tools.demo.rendering import Moment, rendered
from horizon_sensor_ros.tools.demo.screen import FlightScreen
from horizon_sensor_ros.tools.package_share import share_directory
from horizon_sensor_ros.tools.private_domain import isolated_environment, private_domain
from horizon_sensor_ros.tools.report.report import write_report
from horizon_sensor_ros.tools.truth.horizon_errors import (
    FlightErrors,
    Truth,
    error_table,
    flight_errors,
)
from horizon_sensor_ros.tools.truth.target_errors import (
    POSE_TOPIC,
    TargetErrors,
    target_errors,
    target_table,
)

LEVEL_Z = "down"
_QUIET_S = 3.0
_BAG = "demo"
_FEWEST_TO_TELL_RATE = 5  # moments
_ALMOST = 0.9


@dataclass(eq=False)
class _Flown:
    """What was published: truths and times, by the stamp (ns)."""

    truths: list[Truth] = field(default_factory=list)
    bodies: dict[int, np.ndarray] = field(default_factory=dict)
    sent_ns: dict[int, int] = field(default_factory=dict)

    def add(self, stamp: int, moment: Moment) -> None:
        self.truths.append(Truth(stamp, moment.time_s, moment.nadir_base, moment.altitude_m))
        self.bodies[stamp] = moment.pose_tof_from_body
        self.sent_ns[stamp] = time.time_ns()

    @property
    def took_s(self) -> float:
        """Time from the first moment's publishing to the last one's."""
        times = self.sent_ns.values()
        return nearest_s_from_ns(next(reversed(times)) - next(iter(times)))

    def errors(self, answers: Answers) -> tuple[FlightErrors, TargetErrors]:
        """Errors so far of horizon and target."""
        messages = answers.messages
        flight = flight_errors(
            self.truths, messages[VERTICAL_TOPIC], messages[ATTITUDE_TOPIC], LEVEL_Z
        )
        times_s = [truth.time_s for truth in self.truths]
        return flight, target_errors(times_s, self.bodies, messages)

    def latency_s(self, answers: Answers, topic: str) -> np.ndarray:
        """(N,) from the publishing of the inputs to the arrival of a topic's messages."""
        heard = answers.heard_ns[topic].items()
        return np.array([s_from_ns(at - self.sent_ns[stamp]) for stamp, at in heard])


def fly_past_nodes(options: argparse.Namespace) -> None:
    """Fly as the command line says. Raises CommandError and OSError where the flight cannot be
    kept, NodeFailedError, LinkTimeoutError and NoAnswerError of the nodes.
    """
    output = options.output
    output.mkdir(parents=True, exist_ok=True)
    # Before anything is drawn or overwritten.
    check_own(output / _BAG)
    flight, target = Flight(seed=options.seed), TumblingTarget(seed=options.seed)
    times_s = np.arange(0.0, options.seconds, 1.0 / options.rate).tolist()
    summary = (
        f"{options.seconds:g} s of an orbit at {flight.altitude_m / 1e3:.0f} km: {len(times_s)} "
        f"image pairs of {flight.camera.width} x {flight.camera.height} pixels and clouds of "
        f"{target.camera.width} x {target.camera.height} past {', '.join(NODES)}."
    )
    print(summary)
    params = output / "params.yaml"
    write_parameters(params, flight.views, LEVEL_Z)
    listeners = {
        topic: 1 if topic == CLOUD_TOPIC else len(HORIZON_NODES)
        for topic in input_topics([view.name for view in flight.views])
    }
    with private_domain() as domain:
        environment = isolated_environment(domain)
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(
            share_directory() / "config" / "fastdds.xml"
        )
        environment["ROS_LOG_DIR"] = str(output.resolve() / "ros_log")
        # For this process too: its own rclpy reads them when it starts.
        os.environ.update(environment)
        with (
            FlightScreen(len(times_s)) as screen,
            rendered(flight, target, times_s) as moments,
            running_nodes(NODES, _node_arguments(params), environment, output) as nodes,
            DemoBag(output / _BAG, flight.views, LEVEL_Z) as bag,
            DemoLink(domain, flight.views, listeners, bag.record) as link,
        ):
            link.wait_for_nodes(NODES, lambda: require_alive(nodes))
            flown = _fly(link, moments, options.rate, nodes, bag, screen)
            answers = link.answers
            if not all(answers.messages[topic] for topic in OUTPUT_TOPICS):
                raise NoAnswerError(_why_nothing(answers, nodes))
            screen.say("writing the bag")
    title = f"Simulated flight of {options.seconds:g} s"
    slower = slower_than(options.rate, len(flown.sent_ns), flown.took_s)
    _report(output, params, title, flown, answers, slower)


def _node_arguments(params: Path) -> list[str]:
    return ["--ros-args", "--params-file", str(params)]


def _fly(
    link: DemoLink,
    moments: Sequence[Future[Moment]],
    rate_hz: float,
    nodes: Sequence[NodeProcess],
    bag: DemoBag,
    screen: FlightScreen,
) -> _Flown:
    """Publish the flight at its rate, or slower if the drawing is; return what was sent.

    Stamps keep the flight's own time even then.
    """
    flown = _Flown()
    figures: dict[str, str] = {}
    screen.say("in flight")
    start = time.time_ns()
    due = time.monotonic()
    for i, future in enumerate(moments):
        while not future.done():
            link.spin(0.02)
        link.spin(due - time.monotonic())
        due = max(due, time.monotonic()) + 1.0 / rate_hz
        require_alive(nodes)
        moment = future.result()
        stamp = start + ns_from_s(moment.time_s)
        flown.add(stamp, moment)
        link.publish(stamp, moment.images, moment.points)
        bag.record_truth(stamp, moment.nadir_base, moment.altitude_m, moment.pose_tof_from_body)
        if i % max(1, round(rate_hz)) == 0:
            figures = _figures(*flown.errors(link.answers))
        screen.say(slower_than(rate_hz, len(flown.sent_ns), flown.took_s) or "in flight")
        screen.advance(figures)
    deadline = time.monotonic() + _QUIET_S
    last = flown.truths[-1].stamp
    while time.monotonic() < deadline and not all(
        last in link.answers.messages[topic] for topic in (ATTITUDE_TOPIC, POSE_TOPIC)
    ):
        link.spin(0.1)
    return flown


def slower_than(rate_hz: float, moments: int, took_s: float) -> str:
    """Say that so many moments, sent in this time from the first to the last, came more slowly than
    they were to; empty where they did not, or where they are too few to tell.
    """
    real_hz = (moments - 1) / max(took_s, 1e-9)
    if moments < _FEWEST_TO_TELL_RATE or real_hz > _ALMOST * rate_hz:
        return ""
    return f"in flight at {real_hz:.1f} a second, not at --rate {rate_hz:g}: drawing takes longer"


def _figures(flight: FlightErrors, target: TargetErrors) -> dict[str, str]:
    """Median errors so far."""
    figures = {
        "nadir": f"{_median(np.degrees(flight.nadir_rad), 3)} deg",
        "altitude": f"{_median(np.abs(flight.altitude_m) / 1e3, 2)} km",
    }
    for name, motion in (("target's pose", target.pose), ("target's delta", target.delta)):
        turn, shift = np.degrees(motion.rotation), 100 * motion.shift
        figures[name] = f"{_median(turn, 3)} deg, {_median(shift, 3)} cm"
    return figures


def _median(values: np.ndarray, digits: int) -> str:
    known = values[np.isfinite(values)]
    return f"{np.median(known):.{digits}f}" if known.size else "-"


def _why_nothing(answers: Answers, nodes: Sequence[NodeProcess]) -> str:
    lines = ["the nodes ran, but these topics stayed silent:"]
    lines += [f"  {topic}" for topic, messages in answers.messages.items() if not messages]
    lines += [
        f"{name} said: {values.get('state', '?')}, {values.get('reason', '')}"
        for name, values in answers.diagnostics.items()
    ]
    lines += [f"{node.name} printed:\n{node.last_words()}" for node in nodes]
    return "\n".join(lines)


def _report(
    output: Path, params: Path, title: str, flown: _Flown, answers: Answers, slower: str
) -> None:
    """Print the errors, and that the flight was slower if so, and write the page about the bag."""
    flight, target = flown.errors(answers)
    if slower:
        print(f"\n{slower} (stamps keep the flight's time)")
    table = error_table(flight, flown.latency_s(answers, ATTITUDE_TOPIC))
    of_target = target_table(target, flown.latency_s(answers, POSE_TOPIC))
    print(f"\n{table}\n\n{of_target}\n")
    bag, page = output / _BAG, output / "report.html"
    print("writing the report from the bag")
    write_report([bag], page, params=params, title=title)
    print(f"report with pictures: {page.resolve()}")
    print(f"bag: {bag.resolve()}, replays with --params {params}")

"""The report's first and last parts: what there was, when there was an answer, how late it came."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.tools.colours import BLUE, COLOURS, GREEN
from horizon_sensor_ros.tools.report.bags import ANSWER_TOPICS
from horizon_sensor_ros.tools.report.blocks import (
    Block,
    Section,
    Table,
    Text,
    chart,
    from_zero,
    legend,
)
from horizon_sensor_ros.tools.report.recorded import Diagnosis, Recorded

# A longer pause than so many periods is a gap.
_GAP_PERIODS = 2.5
_MOST_LATENCY_S = 10.0
_STATES = ("ok", "warning", "error", "silent")


def availability(recorded: Recorded) -> Section:
    """Return when there were inputs and when answers."""
    rows = _present(recorded)
    blocks: list[Block] = []
    counts = []
    for topic in ANSWER_TOPICS:
        answers = len(recorded.answers.get(topic, {}))
        inputs = len(recorded.clouds if topic.startswith("target/") else recorded.camera_sets())
        if answers or inputs:
            share = f"{100 * answers / inputs:.1f} %" if inputs else "-"
            counts.append(
                (topic, str(answers), str(inputs) if inputs else "not in the bags", share)
            )
    if counts:
        blocks.append(Table(("answer", "number", "frame sets or clouds", "share"), tuple(counts)))
    if rows:
        blocks.append(
            chart(
                "Bars over time for each input and each answer; gaps in a bar are pauses.",
                "Green: what came in. Blue: what was answered. A gap is a pause of more than "
                "two and a half periods.",
                lambda axes: _draw_bars(axes[0], rows),
                panel_height=0.32 * len(rows) + 0.6,
            )
        )
    states = [_states(name, found) for name, found in sorted(recorded.diagnostics.items())]
    if states:
        columns = ("node", "messages", *_STATES, "last state")
        blocks.append(Table(columns, tuple(states), "States on /diagnostics, messages of each"))
    return Section("availability", "Availability", tuple(blocks))


def _present(recorded: Recorded) -> list[tuple[str, str, np.ndarray]]:
    """Name, colour and times (s) of each input and answer."""
    rows = [
        (camera, GREEN, recorded.seconds(sorted(stamps)))
        for camera, stamps in sorted(recorded.frames.items())
    ]
    if recorded.clouds:
        rows.append(("clouds", GREEN, recorded.seconds(sorted(recorded.clouds))))
    for topic in ANSWER_TOPICS:
        stamps = sorted(recorded.answers.get(topic, {}))
        if stamps:
            rows.append((topic, BLUE, recorded.seconds(stamps)))
    return rows


def _draw_bars(axes: Axes, rows: Sequence[tuple[str, str, np.ndarray]]) -> None:
    period = min((float(np.median(np.diff(t))) for _, _, t in rows if len(t) > 1), default=1.0)
    for row, (_, colour, times) in enumerate(rows):
        cuts = np.flatnonzero(np.diff(times) > _GAP_PERIODS * _period(times, period)) + 1
        spans = [(part[0], part[-1] - part[0] + period) for part in np.split(times, cuts)]
        axes.broken_barh(spans, (row - 0.35, 0.7), color=colour)
    axes.set_yticks(range(len(rows)), [name for name, _, _ in rows])
    axes.invert_yaxis()
    axes.set_xlabel("time (s)")
    axes.grid(axis="y", visible=False)


def _period(times: np.ndarray, otherwise: float) -> float:
    """Time between two messages that follow each other at once."""
    return float(np.percentile(np.diff(times), 20)) if len(times) > 2 else otherwise


def _states(name: str, found: Sequence[Diagnosis]) -> tuple[str, ...]:
    levels = np.bincount([min(each.level, 3) for each in found], minlength=4)
    last = found[-1]
    words = last.values.get("state", _STATES[min(last.level, 3)])
    shares = (str(n) for n in levels)
    return (name, str(len(found)), *shares, f"{words}: {last.message}" if last.message else words)


def latency(recorded: Recorded) -> Section | None:
    """Return how long answers took; None where nothing tells."""
    blocks: list[Block] = []
    said = []
    for name, found in sorted(recorded.diagnostics.items()):
        live = [each for each in found if np.isfinite(each.number("latency_ms"))]
        if live:
            median = np.median([each.number("latency_ms") for each in live])
            most = max(each.number("latency_max_ms") for each in live)
            said.append((name, f"{median:.1f}", f"{most:.1f}"))
    if said:
        columns = ("node", "median (ms)", "largest (ms)")
        blocks.append(
            Table(
                columns,
                tuple(said),
                "From stamp to answer, as the nodes measured it: the delay of the inputs is in it",
            )
        )
    measured = {}
    for topic, received in recorded.received_ns.items():
        stamps = np.array(sorted(received))
        # Without the input's record its stamp has to do.
        of_target = topic.startswith("target/")
        known = recorded.clouds_received_ns if of_target else recorded.frames_received_ns
        late_ns = [received[int(s)] - known.get(int(s), int(s)) for s in stamps]
        late_s = s_from_ns(np.array(late_ns))
        if len(late_s) and 0.0 <= np.median(late_s) < _MOST_LATENCY_S:
            measured[topic] = (recorded.seconds([int(s) for s in stamps]), late_s * 1e3)
    if measured:
        blocks += [
            Text(
                "From the record of an answer's frame or cloud to that of the answer; from its "
                "stamp where the inputs are not in the bags. In a replayed bag that is when the "
                "set of frames was complete, not how long the computer took."
            ),
            chart(
                "Milliseconds from input to answer over time.",
                "One point an answer.",
                lambda axes: _draw_latency(axes[0], measured),
                panel_height=2.0,
            ),
        ]
    return Section("latency", "Latency", tuple(blocks)) if blocks else None


def _draw_latency(axes: Axes, measured: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    markers = "ox+^v"
    for (topic, (times, late_ms)), colour, marker in zip(
        measured.items(), COLOURS, markers, strict=False
    ):
        axes.plot(times, late_ms, marker, color=colour, markersize=3, label=topic)
    axes.set(xlabel="time (s)", ylabel="latency (ms)")
    from_zero(axes)
    legend(axes)


def contents(recorded: Recorded) -> Section:
    """Return what the bags hold."""
    rows = tuple((t.topic, t.msgtype, str(t.count), t.bag) for t in recorded.topics)
    blocks: list[Block] = [Table(("topic", "type", "messages", "bag"), rows)]
    blocks += [Text(line) for line in recorded.left_out]
    return Section("topics", "What the bags hold", tuple(blocks))

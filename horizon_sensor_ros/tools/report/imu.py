"""Paper B's bench experiment on one's own recording: pitch from the camera against pitch from an
accelerometer at rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.mathematics.attitude import roll_pitch_from_nadir
from horizon_sensor_ros.ros.parameters.horizon import BASE_FRAME
from horizon_sensor_ros.tools.colours import BLUE, GREEN, VERMILION
from horizon_sensor_ros.tools.reference_topics import Series
from horizon_sensor_ros.tools.report.attitude import Attitudes, attitudes
from horizon_sensor_ros.tools.report.blocks import (
    Block,
    Section,
    Table,
    Text,
    chart,
    legend,
    with_gaps,
)
from horizon_sensor_ros.tools.report.recorded import Recorded

# At rest: what is felt differs from its median by less than this share, and nothing turns faster.
_REST_SHARE = 0.02
_REST_RATE_RAD_S = np.radians(1.0)
# In orbit an accelerometer feels nothing; a bench stands on the ground.
_LEAST_GRAVITY, _MOST_GRAVITY = 9.0, 10.6
_MAX_GAP_NS = 200_000_000
_PAPER_RMS_DEG = 0.752


def imu_section(recorded: Recorded, base_frame: str | None) -> Section | None:
    """Return the comparison; None without answers or an accelerometer that was at rest.

    base_frame : that of the answers; None: as `local_vertical` has it, or the nodes' default.
    """
    found = attitudes(recorded)
    if found is None or not recorded.imu:
        return None
    at_rest, share = _down_at_rest(recorded)
    if share == 0.0:
        return None
    base_frame = base_frame or _base_frame(recorded)
    others = sorted({sample.frame_id for sample in recorded.imu} - {base_frame})
    if others:
        why = (
            f"There is an IMU, at rest on the ground, but in the frame {others[0]!r}, and the "
            f"answers are in {base_frame!r}: nothing is compared. Where both have the same axes, "
            "give --params FILE with the IMU's as base_frame."
        )
        return _section(Text(why))
    compared = [
        (k, nadir)
        for k, stamp in enumerate(found.stamps)
        if (nadir := at_rest.at(stamp)) is not None
    ]
    if len(compared) < 2:
        why = (
            f"There is an IMU, at rest on the ground for {100 * share:.0f} % of its messages, but "
            "with no answer at the same time: nothing to compare."
        )
        return _section(Text(why))
    index = np.array([k for k, _ in compared])
    felt = np.array([roll_pitch_from_nadir(n, found.level_z) for _, n in compared])
    seen = np.column_stack((found.roll_rad, found.pitch_rad))[index]
    apart = np.degrees((seen - felt + np.pi) % (2 * np.pi) - np.pi)
    rows = [
        ("pitch", *_figures(apart[:, 1])),
        ("roll", *_figures(apart[:, 0])),
        ("paper B's bench: pitch", "-", f"{_PAPER_RMS_DEG:.3f}", "-", "-"),
    ]
    return _section(
        Table(
            ("difference (deg)", "mean", "RMS", "RMS about the mean", "largest"),
            tuple(rows),
            f"Camera less accelerometer, {len(index)} answers while the IMU was at rest "
            f"({100 * share:.0f} % of its messages)",
        ),
        Text(
            "A constant mean is how camera and IMU are mounted to each other (and the printed "
            "horizon's place); the RMS about it is what the sensor does."
        ),
        chart(
            "Pitch from the camera and from the accelerometer over time, and their difference.",
            "Paper B's figures 5 and 6, from this recording.",
            lambda axes: _draw(axes, found, index, np.degrees(felt[:, 1]), apart[:, 1]),
            panels=2,
        ),
    )


def _section(*blocks: Block) -> Section:
    return Section("bench", "Camera against accelerometer", blocks)


def _base_frame(recorded: Recorded) -> str:
    for message in recorded.answers.get("local_vertical", {}).values():
        return str(message.header.frame_id)
    return str(BASE_FRAME.default)


def _down_at_rest(recorded: Recorded) -> tuple[Series, float]:
    """Nadir as the accelerometer feels it while at rest, and how much of the time that is."""
    felt = np.array([sample.acceleration for sample in recorded.imu])
    rate = np.array([sample.rate for sample in recorded.imu])
    size = np.linalg.norm(felt, axis=1)
    middle = float(np.nanmedian(size))
    series = Series(_MAX_GAP_NS)
    if not _LEAST_GRAVITY < middle < _MOST_GRAVITY:
        return series, 0.0
    resting = (np.abs(size / middle - 1.0) < _REST_SHARE) & (
        np.nan_to_num(np.linalg.norm(rate, axis=1)) < _REST_RATE_RAD_S
    )
    for sample, up in zip(
        (row for row, rest in zip(recorded.imu, resting, strict=True) if rest),
        felt[resting] / size[resting, None],
        strict=True,
    ):
        series.add(sample.stamp, -up)
    return series, float(np.mean(resting))


def _figures(apart_deg: np.ndarray) -> tuple[str, ...]:
    figures = (
        apart_deg.mean(),
        np.sqrt(np.mean(apart_deg**2)),
        apart_deg.std(),
        np.abs(apart_deg).max(),
    )
    # Adding zero makes of -0.000 a 0.000.
    return tuple(f"{round(float(value), 3) + 0.0:.3f}" for value in figures)


def _draw(
    axes: Sequence[Axes],
    found: Attitudes,
    index: np.ndarray,
    felt_deg: np.ndarray,
    apart_deg: np.ndarray,
) -> None:
    times, seen, felt, apart = with_gaps(
        found.time_s[index], np.degrees(found.pitch_rad[index]), felt_deg, apart_deg
    )
    axes[0].plot(times, seen, color=BLUE, label="camera")
    axes[0].plot(times, felt, color=VERMILION, linestyle="--", label="accelerometer")
    axes[0].set_ylabel("pitch (deg)")
    legend(axes[0])
    axes[1].axhline(0.0, color="0.6", linewidth=0.8)
    axes[1].plot(times, apart, color=GREEN, marker=".", markersize=3)
    axes[1].set(ylabel="difference (deg)", xlabel="time (s)")

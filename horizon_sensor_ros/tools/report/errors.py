"""The report's part on truth: errors, the sigmas promised with them, and their consistency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.mathematics.attitude import nadir_sign
from horizon_sensor_ros.ros.messages.geometry import pose_of, xyz_of
from horizon_sensor_ros.ros.pipelines.target_pipeline import TARGET_TOPICS
from horizon_sensor_ros.tools.colours import BLUE, VERMILION
from horizon_sensor_ros.tools.report.attitude import attitudes, quantities
from horizon_sensor_ros.tools.report.blocks import (
    Block,
    Section,
    Table,
    Text,
    chart,
    error_band,
    figures,
)
from horizon_sensor_ros.tools.report.recorded import Recorded
from horizon_sensor_ros.tools.truth.horizon_errors import FlightErrors, Truth, flight_errors
from horizon_sensor_ros.tools.truth.nees import within_95
from horizon_sensor_ros.tools.truth.target_errors import MotionErrors, target_errors
from horizon_sensor_ros.tools.truth.topics import (
    TRUE_ATTITUDE,
    TRUE_LOCAL_VERTICAL,
    TRUE_TARGET_POSE,
)

# Shares of a normal law within 1, 2, 3 sigma.
_NORMAL = (0.6827, 0.9545, 0.9973)
_SPREAD_COLUMNS = ("error", "RMS", "95 %", "largest", "median sigma", "in 1, 2, 3 sigma")


def horizon_errors_section(recorded: Recorded) -> Section | None:
    """Return errors of the horizon's answers; None without truth or answers."""
    errors = _horizon_errors(recorded)
    if errors is None:
        return None
    degrees = np.degrees
    rows = [
        _spread("nadir of local_vertical (deg)", degrees(errors.vertical_rad), None),
        _spread(
            *("nadir (deg)", degrees(errors.nadir_rad), degrees(errors.nadir_sigma_rad)),
            is_size=True,
        ),
        *(_spread(f"{q.name} ({q.unit})", q.values, q.sigma) for q in quantities(errors)),
    ]
    normal = ", ".join(f"{100 * share:.1f}" for share in _NORMAL)
    blocks: list[Block] = [
        Table(
            _SPREAD_COLUMNS,
            tuple(rows),
            f"Against the truth in the bag. In 1, 2, 3 sigma: share of the errors in %; {normal} "
            "of a normal law",
        ),
        *_consistency(errors.nees, 3, "altitude, roll and pitch"),
        chart(
            "Errors of roll, pitch and altitude against truth over time, with three sigma.",
            "Line: error against the truth. Band: three sigma of the covariance in the message.",
            lambda axes: _draw_horizon(axes, errors),
            panels=3,
        ),
    ]
    return Section("errors", "Errors against the truth", tuple(blocks))


def _horizon_errors(recorded: Recorded) -> FlightErrors | None:
    verticals = recorded.truths.get(TRUE_LOCAL_VERTICAL, {})
    poses = recorded.truths.get(TRUE_ATTITUDE, {})
    found = attitudes(recorded)
    stamps = sorted(set(verticals) & set(poses))
    if found is None or not stamps:
        return None
    sign = -nadir_sign(found.level_z)
    truths = []
    for stamp, time_s in zip(stamps, recorded.seconds(stamps), strict=True):
        v = verticals[stamp].vector
        down = xyz_of(v)
        altitude = sign * poses[stamp].pose.position.z
        truths.append(Truth(stamp, float(time_s), down / np.linalg.norm(down), altitude))
    errors = flight_errors(
        truths,
        recorded.answers.get("local_vertical", {}),
        recorded.answers["attitude"],
        found.level_z,
    )
    return errors if np.isfinite(errors.nadir_rad).any() else None


def target_errors_section(recorded: Recorded) -> Section | None:
    """Return errors of the target's answers; None without truth or answers."""
    poses = recorded.truths.get(TRUE_TARGET_POSE, {})
    answers = {topic: recorded.answers.get(topic, {}) for topic in TARGET_TOPICS}
    stamps = sorted(poses)
    if not stamps or not any(answers.values()):
        return None
    errors = target_errors(
        recorded.seconds(stamps).tolist(), {s: pose_of(poses[s].pose) for s in stamps}, answers
    )
    rows = []
    for topic, motion, per in (
        ("pose", errors.pose, ""),
        ("pose_delta", errors.delta, ""),
        ("twist", errors.twist, "/s"),
    ):
        turn, turn_sigma = np.degrees(motion.rotation), np.degrees(motion.rotation_sigma)
        rows.append(_spread(f"{topic}: turn (deg{per})", turn, turn_sigma, is_size=True))
        shift, shift_sigma = 100 * motion.shift, 100 * motion.shift_sigma
        rows.append(_spread(f"{topic}: shift (cm{per})", shift, shift_sigma, is_size=True))
    # All are sizes, without shares.
    blocks: list[Block] = [Table(_SPREAD_COLUMNS[:-1], tuple(row[:-1] for row in rows))]
    # The pose that sets the frame is right by definition.
    later = errors.pose.nees[np.isfinite(errors.delta.nees)]
    blocks += _consistency(later, 6, "turn and shift of target/pose")
    blocks += _consistency(errors.delta.nees, 6, "turn and shift of target/pose_delta")
    blocks += [
        chart(
            "Errors of the target's pose: angle and distance against truth over time.",
            f"target/pose, since the target frame was set ({errors.frames} times). Line: size of "
            "the error. Band: three sigma.",
            lambda axes: _draw_target(axes, errors.time_s, errors.pose),
            panels=2,
        ),
        chart(
            "Errors of the target's steps: angle and distance against truth over time.",
            "target/pose_delta: the step since the pose before.",
            lambda axes: _draw_target(axes, errors.time_s, errors.delta),
            panels=2,
        ),
    ]
    return Section("target-errors", "Errors of the target against the truth", tuple(blocks))


def _spread(
    name: str, errors: np.ndarray, sigma: np.ndarray | None, *, is_size: bool = False
) -> tuple[str, ...]:
    """Cells of `_SPREAD_COLUMNS`.

    is_size : of a vector, which is no normal law's: its shares would not be those either, and are
    left out.
    """
    seen = np.isfinite(errors)
    sizes = np.abs(errors[seen])
    if not sizes.size:
        return (name, *("-",) * (len(_SPREAD_COLUMNS) - 1))
    cells = (
        name,
        *figures(np.sqrt(np.mean(sizes**2)), np.percentile(sizes, 95), sizes.max()),
    )
    if sigma is None:
        return (*cells, "-", "-")
    shares = ", ".join(f"{100 * np.mean(sizes < n * sigma[seen]):.0f}" for n in (1, 2, 3))
    return (*cells, *figures(np.median(sigma[seen])), "-" if is_size else shares)


def _consistency(nees: np.ndarray, freedom: int, what: str) -> list[Block]:
    """Mean of the normalised squared error, beside what is right."""
    seen = nees[np.isfinite(nees)]
    if not seen.size:
        return []
    return [
        Text(
            f"NEES of {what}, mean over {seen.size} answers: {seen.mean():.2f} ({freedom} is "
            "right over many recordings; more: the sigmas are too small, less: too large). "
            f"{within_95(seen, freedom):.0%} of the errors lie within the 95 % ellipsoid. "
            "Errors of one recording hang together, since what is seen stays much the same: its "
            "mean says little more than a few independent answers would."
        )
    ]


def _draw_horizon(axes: Sequence[Axes], errors: FlightErrors) -> None:
    for panel, one in zip(axes, quantities(errors), strict=True):
        error_band(panel, errors.time_s, one.values, one.sigma, one.colour)
        panel.set_ylabel(f"error of {one.name} ({one.unit})")
    axes[-1].set_xlabel("time (s)")


def _draw_target(axes: Sequence[Axes], time_s: np.ndarray, motion: MotionErrors) -> None:
    panels = (
        ("turn (deg)", np.degrees(motion.rotation), np.degrees(motion.rotation_sigma), BLUE),
        ("shift (cm)", 100 * motion.shift, 100 * motion.shift_sigma, VERMILION),
    )
    for panel, (name, values, sigma, colour) in zip(axes, panels, strict=True):
        error_band(panel, time_s, values, sigma, colour)
        panel.set_ylim(bottom=0.0)
        panel.set_ylabel(f"error of {name}")
    axes[-1].set_xlabel("time (s)")

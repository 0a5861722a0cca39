"""What the target's tracker says about itself on /diagnostics."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.seconds import nearest_s_from_ns
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.target_fix import TargetFix
from horizon_sensor_ros.ros.diagnostics.diagnostics import (
    ERROR,
    OK,
    STALE,
    WARN,
    Health,
    Monitor,
    rejected_values,
)
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.pipelines.target_pipeline import TargetPipeline, TargetStep


class TargetMonitor(Monitor[TargetPipeline]):
    """Follows the target's pipeline."""

    def __init__(self, name: str, stale_after_ns: int, *, live: bool, node: str = "") -> None:
        super().__init__(name, stale_after_ns, live=live, node=node)
        self._last_ns: int | None = None
        self._refusal: Refusal | None = None
        self._fix: TargetFix | None = None

    def on_step(self, step: TargetStep, now: int) -> None:
        """Take note of a cloud and what became of it."""
        self._last_ns = now
        self._refusal = step.refusal
        if step.fix is not None:
            self._fix = step.fix

    def health(self, now: int) -> Health:
        """State at a time."""
        if self._last_ns is None:
            return Health(STALE, "waiting", "no clouds yet")
        # A clock that was set back must not make a sensor look alive for hours.
        self._last_ns = min(self._last_ns, now)
        age = now - self._last_ns
        if age > self.stale_after_ns:
            return Health(STALE, "stale", f"no clouds for {nearest_s_from_ns(age):.1f} s")
        if self._refusal is not None:
            return Health(ERROR, "refused", self._refusal.reason)
        fix = self._fix
        assert fix is not None
        if fix.status is not Status.OK:
            return Health(WARN, "no_fix", f"{fix.status}: {fix.reason}")
        if fix.new_frame:
            return Health(WARN, "new_target_frame", f"new target frame: {fix.reason}")
        return Health(OK, "ok", "tracking")

    def _key(self, health: Health) -> tuple[bytes, str, str]:
        if self._refusal is not None:
            return health.level, health.state, self._refusal.cause
        if self._fix is None:
            return health.level, health.state, ""
        # One new frame after the other, each for a reason of its own, are news.
        return (
            health.level,
            health.state,
            self._fix.reason if self._fix.new_frame else str(self._fix.status),
        )

    def _values(self, now: int, pipeline: TargetPipeline) -> dict[str, str]:
        values = {}
        if self._fix is not None:
            values.update(_fix_values(self._fix))
        for name in ("clouds", "fixes", "target_frames", "time_jumps"):
            values[name] = str(pipeline.counts[name])
        if pipeline.times_told:
            values["point_times"] = pipeline.times_told
        values.update(rejected_values(pipeline.rejected))
        return values


def _fix_values(fix: TargetFix) -> dict[str, str]:
    values = {
        "status": str(fix.status),
        "cloud_points": str(fix.num_points),
        "keyframes": str(fix.num_keyframes),
    }
    found = fix.registration
    if found is None:
        return values
    values["points"] = str(found.num_points)
    for name, value in (("score", found.score), ("overlap", found.overlap)):
        if np.isfinite(value):
            values[name] = f"{value:.4f}"
    if np.isfinite(found.rms_residual_m):
        values["residual_mm"] = f"{found.rms_residual_m * 1e3:.3f}"
    values["degenerate_directions"] = str(len(found.weak))
    values["degeneracy"] = "; ".join(map(_direction, found.weak)) or "none"
    return values


def _direction(weak: np.ndarray) -> str:
    """Return a direction that the views do not show, for a person."""
    turn, shift = weak[:3], weak[3:]
    about = np.linalg.norm(turn) > np.linalg.norm(shift)
    part = turn if about else shift
    x, y, z = part / np.linalg.norm(part)
    return f"{'turn about' if about else 'shift along'} ({x:.2f}, {y:.2f}, {z:.2f})"

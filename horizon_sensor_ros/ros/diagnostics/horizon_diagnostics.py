"""What the horizon sensor says about itself on /diagnostics."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.seconds import nearest_s_from_ns
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.diagnostics import (
    ERROR,
    OK,
    STALE,
    WARN,
    Health,
    Monitor,
    rejected_values,
)
from horizon_sensor_ros.ros.diagnostics.own_counts import OwnCounts
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.pipelines.aiding_sources import COARSE_POSE_TOPIC, IMU_TOPIC
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, Step

_SILENT = "no usable frames for longer than camera_timeout"
# From here it cannot be told which.
_UNPAIRED = (
    "the cameras' frames do not pair: their stamps are farther apart than slop, or one camera's "
    "arrive more than queue_size frames later than another's"
)
# Of so many usable frames, where more than this come into no set, estimates are lost.
_FRAMES, _MOST_ALONE = 40, 20


@dataclass
class _CameraHealth:
    last_ns: int | None = None
    refusal: Refusal | None = None


class HorizonMonitor(Monitor[HorizonPipeline]):
    """Follows the horizon's pipeline.

    undrawn : debug images that could not be drawn.
    own_counts : which of the pipeline's counts are reported; all, unless told otherwise.
    """

    def __init__(
        self,
        name: str,
        cameras: Sequence[str],
        stale_after_ns: int,
        *,
        live: bool,
        node: str = "",
    ) -> None:
        super().__init__(name, stale_after_ns, live=live, node=node)
        self._cameras = {camera: _CameraHealth() for camera in cameras}
        self.undrawn = 0
        self.own_counts = OwnCounts()
        self._last_set_ns: int | None = None
        self._apart_ns: int | None = None
        # Of the last usable frames, how many came into a set with each.
        self._paired: deque[int] = deque(maxlen=_FRAMES)
        self._fix: HorizonFix | None = None
        self._views: tuple[CameraView, ...] = ()

    def on_step(self, step: Step, now: int, busy_ns: int = 0) -> None:
        """Take note of an image and what became of it.

        busy_ns : that its processing took, until now. Nobody listened meanwhile, so that it does
        not count as the other cameras' silence.
        """
        for other in self._cameras.values():
            if other.last_ns is not None:
                other.last_ns += busy_ns
        camera = self._cameras[step.camera]
        camera.last_ns = now
        camera.refusal = step.refusal
        if step.refusal is None:
            self._paired.append(sum(len(result.frames) for result in step.results))
        if step.apart_ns is not None:
            known = step.apart_ns if self._apart_ns is None else self._apart_ns
            self._apart_ns = min(known, step.apart_ns)
        if any(len(result.frames) < len(self._cameras) for result in step.results):
            # What waited for a camera that is silent was lost to that, and that is told.
            self._paired.clear()
        for result in step.results:
            self._last_set_ns, self._apart_ns = now, None
            self._fix = result.fix
            self._views = tuple(frame.view for frame in result.frames)
        everybody = all(other.last_ns is not None for other in self._cameras.values())
        if self._last_set_ns is None and everybody:
            # From here on a set is due.
            self._last_set_ns = now

    def health(self, now: int) -> Health:
        """State at a time."""
        silent, missing, refused = [], [], []
        for name, camera in self._cameras.items():
            if camera.last_ns is None:
                missing.append(name)
                continue
            # A clock that was set back must not make a camera look alive for hours.
            camera.last_ns = min(camera.last_ns, now)
            age = now - camera.last_ns
            if age > self.stale_after_ns:
                silent.append(f"no frames from {name} for {nearest_s_from_ns(age):.1f} s")
            elif camera.refusal is not None:
                refused.append(f"{name}: {camera.refusal.reason}")
        absent = [f"no frames from {name} yet" for name in missing]
        reason = "; ".join(refused + silent + absent)
        if len(missing) == len(self._cameras):
            return Health(STALE, "waiting", reason)
        if len(silent) + len(missing) == len(self._cameras):
            return Health(STALE, "stale", reason)
        if self._flown_without(now):
            without = self._fix_health()
            known = f"{without.reason}; {reason}" if reason else without.reason
            return Health(without.level, without.state, known)
        if refused:
            return Health(ERROR, "refused", reason)
        if silent:
            return Health(ERROR, "silent", reason)
        if missing:
            return Health(WARN, "waiting", reason)
        if self._last_set_ns is not None:
            self._last_set_ns = min(self._last_set_ns, now)
            if now - self._last_set_ns > self.stale_after_ns:
                return Health(ERROR, "unpaired", _UNPAIRED + self._nearest())
        return self._fix_health()

    def _nearest(self) -> str:
        """How near to each other the cameras' stamps came since the last set."""
        if self._apart_ns is None:
            return ""
        return f"; the nearest stamps are {self._apart_ns / 1e6:.1f} ms apart"

    def _fix_health(self) -> Health:
        fix = self._fix
        if fix is None:
            return Health(WARN, "waiting", f"no complete set of frames yet{self._nearest()}")
        if fix.status is not Status.OK:
            return Health(WARN, "no_fix", f"{fix.status}: {fix.reason}")
        degrading = [*self._lost(), *shortcomings(fix, self._views, tuple(self._cameras))]
        if degrading:
            return Health(WARN, "degraded", "; ".join(degrading))
        return Health(OK, "ok", f"fix from {', '.join(fix.cameras_used)}")

    def _lost(self) -> list[str]:
        """That most frames come into no set, where it is so: estimates are good, but few."""
        alone = len(self._paired) - sum(self._paired)
        if len(self._paired) < _FRAMES or alone <= _MOST_ALONE:
            return []
        return [
            f"{alone} of the last {_FRAMES} frames came into no set: there are no more sets than "
            "the slowest camera has frames, and none where stamps are farther apart than slop"
        ]

    def _limbs(self) -> dict[str, LimbPoints]:
        """Limbs of the last set, by camera."""
        if self._fix is None:
            return {}
        return {view.name: limb for view, limb in zip(self._views, self._fix.limbs, strict=True)}

    def _unseen(self) -> list[str]:
        """Cameras without which the last set was made."""
        limbs = self._limbs()
        return [name for name in self._cameras if limbs and name not in limbs]

    def _flown_without(self, now: int) -> bool:
        """Whether sets are being made without some of the cameras."""
        last = self._last_set_ns
        fresh = last is not None and now - min(last, now) <= self.stale_after_ns
        return fresh and bool(self._unseen())

    def _key(self, health: Health) -> tuple[bytes, str, str]:
        status = str(self._fix.status) if self._fix is not None else ""
        causes = [c.refusal.cause if c.refusal else "" for c in self._cameras.values()]
        used = self._fix.cameras_used if self._fix is not None else ()
        return health.level, health.state, ",".join([status, *causes, *used])

    def _values(self, now: int, pipeline: HorizonPipeline) -> dict[str, str]:
        values = {}
        if self._fix is not None:
            fit = self._fix.fit
            values["status"] = str(self._fix.status)
            values["points"] = str(fit.num_inliers)
            if np.isfinite(fit.rms_residual_px):
                values["residual_px"] = f"{fit.rms_residual_px:.4f}"
            values["cameras_used"] = ", ".join(self._fix.cameras_used)
            if self._fix.airglow is not None:
                values["airglow"] = "alone" if self._fix.airglow_alone else "used"
        own = self.own_counts.now(pipeline)
        for name in ("frames", "sets", "fixes", "time_jumps"):
            values[name] = str(own.counts[name])
        values.update(rejected_values(own.rejected))
        for name in self._cameras:
            values.update(self._camera_values(name, now))
        if self.undrawn:
            values["undrawn"] = str(self.undrawn)
        values.update(pipeline.aiding.words)
        shortfall = "" if self._fix is None else _shortfall(self._fix)
        if shortfall and values.get(COARSE_POSE_TOPIC) == "used":
            values[COARSE_POSE_TOPIC] = f"not used for the planet's figure: {shortfall}"
        if self._fix is not None and self._fix.gyro_refused:
            values[IMU_TOPIC] = "not used: no horizon bears it out"
        ignored = sorted(own.ignored.items())
        values.update({f"ignored_{cause}": str(count) for cause, count in ignored})
        return values

    def _camera_values(self, name: str, now: int) -> dict[str, str]:
        """What one camera contributed to the last set, and why nothing if so."""
        camera = self._cameras[name]
        state, reason = "waiting", "no complete set of frames yet"
        points, residual_px = 0, np.nan
        limb = self._limbs().get(name)
        if self._fix is not None and limb is None:
            state, reason = "left_out", _SILENT
        elif self._fix is not None and limb is not None:
            points = len(limb.px)
            if name in self._fix.cameras_used:
                state, reason = "used", ""
                (view,) = (view for view in self._views if view.name == name)
                residual_px = self._fix.residual_px(view, limb)
            else:
                state, reason = "left_out", self._fix.why_left_out(limb)
        if camera.last_ns is None:
            state, reason = "waiting", "no frames yet"
        elif (age := now - camera.last_ns) > self.stale_after_ns:
            state, reason = "silent", f"no frames for {nearest_s_from_ns(age):.1f} s"
        elif camera.refusal is not None:
            state, reason = "refused", camera.refusal.reason
        values = {
            f"{name}.state": state,
            f"{name}.reason": reason,
            f"{name}.points": str(points),
        }
        if np.isfinite(residual_px):
            values[f"{name}.residual_px"] = f"{residual_px:.4f}"
        return values


def shortcomings(fix: HorizonFix, views: Sequence[CameraView], cameras: Sequence[str]) -> list[str]:
    """What makes a fix less than it could be, for a person: empty where nothing does.

    views : of the set's frames, in order. cameras : names of all that there are.
    """
    limbs = {view.name: limb for view, limb in zip(views, fix.limbs, strict=True)}
    found = [
        f"{name} left out: {fix.why_left_out(limb)}"
        for name, limb in limbs.items()
        if name not in fix.cameras_used
    ]
    found += [f"{name} left out: {_SILENT}" for name in cameras if limbs and name not in limbs]
    found += [why for why in (_shortfall(fix), fix.reason) if why]
    return found


def _shortfall(fix: HorizonFix) -> str:
    """Why a fix is of a sphere, where it was to be of an ellipsoid."""
    return "" if fix.fit.disc is None else fix.fit.disc.figure.shortfall

"""What became of a replay's frames or clouds, in figures and reasons for a person."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.horizon_diagnostics import shortcomings
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, HorizonResult, Step
from horizon_sensor_ros.ros.pipelines.target_pipeline import TargetPipeline, TargetStep
from horizon_sensor_ros.tools.reasons import ReasonCounts

MOST_REASONS = 3  # of one cause


class ReplayTally:
    """Follows a pipeline's steps: why there was no estimate, and how many were less than whole."""

    def __init__(self, pipeline: HorizonPipeline | TargetPipeline) -> None:
        self._pipeline = pipeline
        self._of_one_camera = 0
        self._degraded = 0
        self._degrading = ReasonCounts()
        self._reasons: defaultdict[str, ReasonCounts] = defaultdict(ReasonCounts)

    def on_step(self, step: Step | TargetStep) -> None:
        """Take note of what became of an image or a cloud."""
        if step.refusal is not None:
            self._reasons[step.refusal.cause].add(step.refusal.reason)
        if isinstance(step, Step):
            for result in step.results:
                self._take(result)
        elif step.fix is not None and step.fix.status is not Status.OK:
            self._reasons[str(step.fix.status)].add(step.fix.reason)

    def _take(self, result: HorizonResult) -> None:
        assert isinstance(self._pipeline, HorizonPipeline)
        fix, cameras = result.fix, self._pipeline.settings.cameras
        if fix.status is not Status.OK:
            self._reasons[str(fix.status)].add(fix.reason)
            return
        self._of_one_camera += len(cameras) > 1 and len(fix.cameras_used) == 1
        views = [frame.view for frame in result.frames]
        why = shortcomings(fix, views, cameras)
        if why:
            self._degraded += 1
            self._degrading.add("; ".join(why))

    def figures(self) -> str:
        """Return how many there were and how many estimates, in a line."""
        counts = self._pipeline.counts
        of_target = isinstance(self._pipeline, TargetPipeline)
        names = ("clouds", "fixes") if of_target else ("frames", "sets", "fixes")
        figures = ", ".join(f"{counts[name]} {name}" for name in names)
        parts = [
            f"{count} {what}"
            for count, what in (
                (self._degraded, "degraded"),
                (self._of_one_camera, "from one camera"),
            )
            if count
        ]
        return f"{figures} ({', '.join(parts)})" if parts else figures

    def reasons(self) -> Iterator[str]:
        """What was rejected or degraded, by cause, each followed by the commonest reasons."""
        for cause, count in sorted(self._pipeline.rejected.items()):
            yield f"rejected, {cause}: {count}"
            # What waited for another camera's frame in vain has no reason of its own.
            if cause in self._reasons:
                yield from (f"  {line}" for line in self._reasons[cause].lines(MOST_REASONS))
        if self._degraded:
            yield f"degraded: {self._degraded}"
            yield from (f"  {line}" for line in self._degrading.lines(MOST_REASONS))

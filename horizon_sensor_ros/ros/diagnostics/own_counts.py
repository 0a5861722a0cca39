"""What of a pipeline's counts is a node's own: nodes of a process share pipelines, and go from one
to another.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline


class Counts(NamedTuple):
    """As of `HorizonPipeline` and `AidingSources`."""

    counts: Counter[str]
    rejected: Counter[str]
    ignored: Counter[str]

    @classmethod
    def of(cls, pipeline: HorizonPipeline) -> Counts:
        """All that a pipeline has counted, whoever it was for."""
        return cls(pipeline.counts.copy(), pipeline.rejected.copy(), pipeline.aiding.ignored.copy())


class OwnCounts:
    """Adds up what pipelines count between `begin` and `end`.

    Of a pipeline that was never begun all is the node's own.
    """

    def __init__(self) -> None:
        # What is added to the pipeline's counts; less than none where others had it before.
        self._more = Counts(Counter(), Counter(), Counter())

    def begin(self, pipeline: HorizonPipeline) -> None:
        """Take what a pipeline counts from now on for the node's own."""
        for own, there in zip(self._more, Counts.of(pipeline), strict=True):
            own.subtract(there)

    def end(self, pipeline: HorizonPipeline) -> None:
        """Keep what the pipeline has counted, and take no more from it."""
        for own, there in zip(self._more, Counts.of(pipeline), strict=True):
            own.update(there)

    def now(self, pipeline: HorizonPipeline) -> Counts:
        """The node's own counts, with those of the pipeline that was begun last."""
        found = Counts.of(pipeline)
        for all_there, own in zip(found, self._more, strict=True):
            all_there.update(own)
        return Counts(*(+each for each in found))

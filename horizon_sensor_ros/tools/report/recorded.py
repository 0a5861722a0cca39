"""What a report is made from: the answers, diagnostics, inputs and truth that bags hold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.ros.pipelines.horizon_outputs import HORIZON_OUTPUTS

# On /diagnostics, where every node of a craft writes, these end the names of the nodes' statuses.
_HORIZON_STATUS = ": horizon"
STATUSES = (_HORIZON_STATUS, ": target")


@dataclass(frozen=True)
class TopicFacts:
    """A topic and where it is."""

    bag: str
    topic: str
    msgtype: str
    count: int


@dataclass(frozen=True)
class Diagnosis:
    """A status on /diagnostics at a time (ns): level 0 ok to 3 stale, its message and values.

    hardware_id : of these nodes, the full name of the one whose it is.
    """

    time_ns: int
    hardware_id: str
    level: int
    message: str
    values: dict[str, str]

    def number(self, key: str) -> float:
        """Return a value as a number; NaN where it is none."""
        try:
            return float(self.values.get(key, "nan"))
        except ValueError:
            return float("nan")


@dataclass(frozen=True, slots=True)
class ImuSample:
    """What counts of a `sensor_msgs/Imu`, of which there are many: stamp (ns), acceleration felt
    (m/s^2) and rate (rad/s) in the axes of frame_id.
    """

    stamp: int
    frame_id: str
    acceleration: tuple[float, float, float]
    rate: tuple[float, float, float]


@dataclass
class Recorded:
    """Messages by stamp (ns); times of recording are in the bag's own clock.

    answers : by topic without namespace, as truths, and received_ns, when they were recorded;
    frames_received_ns, clouds_received_ns : when a stamp's last image or cloud was. frames : stamps
    of the images by camera; clouds : of the clouds. diagnostics : by name of the status. imu : in
    order. unusable : how many answers and truths were left out, by topic, see `is_usable`.
    """

    bags: tuple[Path, ...]
    topics: list[TopicFacts] = field(default_factory=list)
    answers: dict[str, dict[int, Any]] = field(default_factory=dict)
    received_ns: dict[str, dict[int, int]] = field(default_factory=dict)
    frames_received_ns: dict[int, int] = field(default_factory=dict)
    clouds_received_ns: dict[int, int] = field(default_factory=dict)
    truths: dict[str, dict[int, Any]] = field(default_factory=dict)
    frames: dict[str, list[int]] = field(default_factory=dict)
    clouds: list[int] = field(default_factory=list)
    imu: list[ImuSample] = field(default_factory=list)
    diagnostics: dict[str, list[Diagnosis]] = field(default_factory=dict)
    unreadable: int = 0
    unusable: Counter[str] = field(default_factory=Counter)

    @property
    def start_ns(self) -> int:
        """The earliest stamp; times in the report count from it."""
        stamps = [stamp for each in self.answers.values() for stamp in each]
        stamps += [stamp for each in self.frames.values() for stamp in each] + self.clouds
        stamps += [sample.stamp for sample in self.imu]
        return min(stamps, default=0)

    def seconds(self, stamps_ns: Sequence[int]) -> np.ndarray:
        """Stamps as seconds since the start."""
        start = self.start_ns
        return s_from_ns(np.array([stamp - start for stamp in stamps_ns], dtype=float))

    @property
    def of_horizon(self) -> bool:
        """Whether the nodes of the horizon have taken part, and not the target's alone."""
        answered = any(self.answers.get(output.topic) for output in HORIZON_OUTPUTS.values())
        return answered or any(name.endswith(_HORIZON_STATUS) for name in self.diagnostics)

    @property
    def left_out(self) -> list[str]:
        """What of the bags could not be used, in sentences."""
        lines = [
            f"{count} messages of {topic} were left out: not finite, or their direction or "
            "rotation is none."
            for topic, count in sorted(self.unusable.items())
        ]
        if self.unreadable:
            lines.append(f"{self.unreadable} messages could not be read and were left out.")
        return lines

    def camera_sets(self) -> list[int]:
        """Stamps of the camera with the most frames: when there could have been an answer."""
        longest: list[int] = []
        for stamps in self.frames.values():
            longest = max(longest, stamps, key=len)
        return sorted(longest)

"""Parameters of the registration and of the tracker.

Apart from what they steer, so that reading parameters does not load it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.crop import Crop

LEAST_POINTS = 4  # that may span a body


@dataclass(frozen=True)
class RegistrationConfig:
    """Parameters of the registration; ValueError where one makes no sense.

    focal_px : the sensor's focal length in pixels; None: from the cloud.  range_noise_m : None:
        from the cloud.  range_bias_sigma_m : one sigma of what all ranges of all clouds are too
        long or too short by, for the covariance.
    min_points : fewest points of a cloud.  min_score, min_overlap : least view consistency (see
        Consistency); the score may be lower by what odd returns in the clouds take from it.
    max_rotation_sigma_rad, max_shift_sigma_m : a motion known worse than this in any direction is
        refused.
    search_rad : largest turn that the search starts cover.
    """

    focal_px: float | None = None
    range_noise_m: float | None = None
    range_bias_sigma_m: float = 0.0
    min_points: int = 100
    min_score: float = 0.85
    min_overlap: float = 0.3
    max_rotation_sigma_rad: float = np.radians(0.37)
    max_shift_sigma_m: float = 0.0076
    search_rad: float = np.radians(33.0)

    def __post_init__(self) -> None:
        for name in ("focal_px", "range_noise_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive or None, got {value}")
        if not 0 <= self.range_bias_sigma_m < np.inf:
            raise ValueError(
                f"range_bias_sigma_m must be 0 or positive, got {self.range_bias_sigma_m}"
            )
        if not self.min_points >= LEAST_POINTS:
            raise ValueError(f"min_points must be at least {LEAST_POINTS}, got {self.min_points}")
        for name in ("max_rotation_sigma_rad", "max_shift_sigma_m", "search_rad"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("min_score", "min_overlap"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be in [0, 1], got {getattr(self, name)}")


@dataclass(frozen=True)
class TrackerConfig:
    """Parameters of the tracker; ValueError where one makes no sense.

    max_gap_s : without an accepted cloud for longer, a new target frame starts.
    max_refused : so many refused clouds in a row are a lost track, and the last of them starts a
        new target frame. A first cloud that nothing has agreed with yet is given up sooner: as
        soon as three others in a row agree with each other.
    keyframe_turn_rad : the target may turn so far from a keyframe before the cloud before becomes
        a new one.
    keyframe_overlap : and so much of the points must still overlap.
    crop : the box in which points are of the target.
    """

    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    max_gap_s: float = 2.0
    max_refused: int = 10
    keyframe_turn_rad: float = np.radians(20.0)
    keyframe_overlap: float = 0.6
    crop: Crop = field(default_factory=Crop)

    def __post_init__(self) -> None:
        for name in ("max_gap_s", "max_refused", "keyframe_turn_rad"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 <= self.keyframe_overlap <= 1:
            raise ValueError(f"keyframe_overlap must be in [0, 1], got {self.keyframe_overlap}")

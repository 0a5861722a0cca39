"""What self-calibration is asked for, and what it finds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.self_calibration.measurement import FrameSet
from horizon_sensor_ros.core.self_calibration.unknowns import Unknowns
from horizon_sensor_ros.core.status import Status

# Of a direction that is not observed, one sigma in its natural unit: what it may hold.
_MAY_HOLD = 1.0
# An unknown is not observed at all where no more than this share of it is.
_NEARLY = 0.02


@dataclass(frozen=True)
class CalibrationConfig:
    """What is asked for. Raises ValueError for what makes no sense.

    drift : a misalignment that grows linearly in time. focal : an error of each focal length.
    max_sigma : a direction less certain than this share of a natural unit (1 deg of misalignment,
    1 deg of drift over half the recording, 1 % of focal length, 10 km of limb height) is not
    observed and stays as it is.
    correlation_s : time over which errors of the limb itself (air, clouds) stay alike.
    """

    drift: bool = False
    focal: bool = False
    max_sigma: float = 0.1
    correlation_s: float = 20.0

    def __post_init__(self) -> None:
        if not 0.0 < self.max_sigma < np.inf:
            raise ValueError(f"max_sigma must be positive, got {self.max_sigma}")
        if not 0.0 <= self.correlation_s < np.inf:
            raise ValueError(f"correlation_s must not be negative, got {self.correlation_s}")


@dataclass(frozen=True, eq=False)
class Calibration:
    """What self-calibration found.

    values : (P,) as in `unknowns`; misalignments are rotation vectors in the base frame, rad:
    ``R = exp(misalignment) R_nominal``, in the middle of the recording; drifts, rad over half of
    it; focal lengths' relative errors; limb height to be added, m. Zero in directions not observed.
    cov : (P, P) of the observed part. observed_share : (P,) how much of each unknown that is.
    not_observed : sentences. rot_base_from_cam : corrected, by camera.
    sets, used : the frame sets that could tell something, and (T,) which of them had a say.
    nadir_base : (T, 3) of those sets, fitted. scatter : of the sets' residuals, over what their
    limbs claim. half_time_s : half the recording's length. max_sigma : as configured.
    When status is not OK there is no result, and `reason` says why; wrong_lenses : of which cameras
    the sets contradict the focal length (`lens_check`).
    """

    status: Status
    reason: str
    unknowns: Unknowns
    values: np.ndarray
    cov: np.ndarray
    observed_share: np.ndarray
    not_observed: tuple[str, ...]
    rot_base_from_cam: Mapping[str, np.ndarray]
    sets: tuple[FrameSet, ...]
    used: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=bool))
    nadir_base: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    scatter: float = np.nan
    half_time_s: float = 0.0
    max_sigma: float = np.nan
    wrong_lenses: tuple[str, ...] = ()

    @classmethod
    def none(
        cls,
        status: Status,
        reason: str,
        unknowns: Unknowns,
        nominal: Mapping[str, np.ndarray],
        sets: tuple[FrameSet, ...],
    ) -> Calibration:
        """No result, and why. nominal : the rotations, which stay as they are."""
        size = len(unknowns)
        return cls(
            status=status,
            reason=reason,
            unknowns=unknowns,
            values=np.full(size, np.nan),
            cov=np.full((size, size), np.nan),
            observed_share=np.zeros(size),
            not_observed=(),
            rot_base_from_cam=nominal,
            sets=sets,
        )

    @property
    def ok(self) -> bool:
        """True when there is a result."""
        return self.status is Status.OK

    @property
    def sigmas(self) -> np.ndarray:
        """(P,) one sigma of each unknown: of one that is observed with what its little rest may
        hold, of one that partly is of that part; NaN where nothing of it is observed.
        """
        variance = np.maximum(np.diag(self.cov), 0.0)
        whole = [self.observed(i) == "yes" for i in range(len(self.unknowns))]
        out = np.sqrt(variance + np.where(whole, self._hidden_sigmas**2, 0.0))
        return np.where(self.observed_share > _NEARLY, out, np.nan)

    def observed(self, index: int) -> str:
        """Return "yes", "partly" or "no" for one unknown: yes where what is not observed of it may
        hold no more than `CalibrationConfig.max_sigma`.
        """
        if self.observed_share[index] < _NEARLY:
            return "no"
        most = self.max_sigma * self.unknowns.scales[index]
        return "yes" if self._hidden_sigmas[index] < most else "partly"

    @property
    def _hidden_sigmas(self) -> np.ndarray:
        """(P,) what directions that are not observed may hold of each unknown."""
        rest = np.maximum(1.0 - self.observed_share, 0.0)
        return _MAY_HOLD * self.unknowns.scales * np.sqrt(rest)

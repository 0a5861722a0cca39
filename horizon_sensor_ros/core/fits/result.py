"""What comes out of a horizon fit."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.fits.disc import Disc
from horizon_sensor_ros.core.status import Status


@dataclass(frozen=True, eq=False)
class HorizonFit:
    """Nadir, disc radius and altitude from limb points of one or more cameras.

    method : of `fit_horizon`.
    nadir_base : (3,) unit vector along the vertical, towards the planet, base frame.
    rho_rad : angular radius of the planet's disc, of an ellipsoid's that of the sphere which stands
    for it. altitude_m : above the planet's surface.
    cov_nadir_altitude : (4, 4) covariance of (nadir_base, altitude_m); the nadir block has rank 2
    (rad^2).
    rms_residual_px : of the inliers, across the limb. num_points : of the limb, usable or not;
    num_inliers : how many of them lie on the cone. cameras : names of the cameras used.
    history : per-iteration states of the iterative methods, rows (nadir_base, rho_rad); empty for
    closed forms. disc : of a whole chain's fit, the disc as it was fitted: an ellipsoid's limb is
    no cone about nadir. When status is not OK every estimate is NaN and `reason` says why.
    """

    status: Status
    reason: str
    method: str
    nadir_base: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    rho_rad: float = np.nan
    altitude_m: float = np.nan
    cov_nadir_altitude: np.ndarray = field(default_factory=lambda: np.full((4, 4), np.nan))
    rms_residual_px: float = np.nan
    num_points: int = 0
    num_inliers: int = 0
    cameras: tuple[str, ...] = ()
    history: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    disc: Disc | None = None

    @property
    def ok(self) -> bool:
        """True when the estimates are valid."""
        return self.status is Status.OK

    @classmethod
    def none(cls, status: Status, reason: str, method: str, num_points: int = 0) -> HorizonFit:
        """No estimate, and why."""
        return cls(status, reason, method, num_points=num_points)

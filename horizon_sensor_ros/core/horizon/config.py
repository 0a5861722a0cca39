"""What the horizon sensor is told once, and where it draws its lines."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.fits import METHODS
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import VERTICALS

LIMB_SOURCES = ("subpixel", "canny")


@dataclass(frozen=True)
class HorizonConfig:
    """What the sensor is told once. Raises ValueError for what makes no sense.

    method : one of `METHODS`. limb : `subpixel`, or `canny` (whole pixels, as the four papers).
    planet : the body; an ellipsoid is fitted where a coarse pose is known, else its mean sphere,
    and what that leaves out is in the covariance. vertical : the one that is published, one of
    `VERTICALS`.
    altitude_min_m, altitude_max_m : a disc outside these is no horizon of ours.
    max_nadir_sigma_rad : an estimate less certain than this is withheld.
    max_residual_px : a limb that scatters more than this about the fit, per 640 pixels of image
    width, is withheld.
    min_limb_share : of the limb that should show in a frame (where the planet is lit), the least
    share that must be found. max_bright_sky, min_clear_sky : of the limb and of the sky beyond it,
    see `SkyEvidence`.
    min_contrast : planet over space beside the limb, in sigmas of the reduced image's noise.
    max_space_level : gray level of empty space, over the largest gray level.
    mounting_sigma_rad, lens_sigma_px, limb_height_sigma_m, limb_unevenness_m : errors of each
    camera's rotation, about every axis, of its calibration in the corners of its frames, of the
    planet's limb height, and of what that differs by along the limb, for the covariance.
    rate_sigma_rad_s : of the craft's angular rate, about every axis, where neither a gyro nor the
    fixes before tell it: for the covariance of frames that are not of one moment, and, without a
    gyro, of a coarse pose's heading by its age.
    tracking : look for the limb where the last fix predicts it, and search the whole frames only
    where that does not do.
    """

    method: str = "ml"
    limb: str = "subpixel"
    planet: Planet = field(default_factory=Planet)
    vertical: str = "geocentric"
    altitude_min_m: float = 10e3
    altitude_max_m: float = 100e6
    max_nadir_sigma_rad: float = float(np.radians(0.5))
    max_residual_px: float = 1.2
    min_limb_share: float = 0.5
    max_bright_sky: float = 0.25
    min_clear_sky: float = 0.72
    min_contrast: float = 12.0
    max_space_level: float = 0.15
    mounting_sigma_rad: float = 0.0
    lens_sigma_px: float = 0.0
    limb_height_sigma_m: float = 0.0
    limb_unevenness_m: float = 0.0
    rate_sigma_rad_s: float = 0.05
    tracking: bool = True

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")
        if self.limb not in LIMB_SOURCES:
            raise ValueError(f"limb must be one of {', '.join(LIMB_SOURCES)}, got {self.limb!r}")
        if self.vertical not in VERTICALS:
            known = ", ".join(VERTICALS)
            raise ValueError(f"vertical must be one of {known}, got {self.vertical!r}")
        if not 0.0 < self.altitude_min_m < self.altitude_max_m < np.inf:
            raise ValueError(
                "altitude_min_m must be positive and below altitude_max_m, got "
                f"{self.altitude_min_m} and {self.altitude_max_m}"
            )
        if not self.altitude_max_m > self.planet.limb_height_m:
            raise ValueError(
                f"altitude_max_m must be above the limb's height of {self.planet.limb_height_m}, "
                f"got {self.altitude_max_m}"
            )
        for name in ("max_nadir_sigma_rad", "max_residual_px", "min_contrast"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in (
            "mounting_sigma_rad",
            "lens_sigma_px",
            "limb_height_sigma_m",
            "limb_unevenness_m",
            "rate_sigma_rad_s",
        ):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be zero or positive, got {getattr(self, name)}")
        for name in ("min_limb_share", "max_bright_sky", "min_clear_sky", "max_space_level"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must lie within 0 and 1, got {getattr(self, name)}")

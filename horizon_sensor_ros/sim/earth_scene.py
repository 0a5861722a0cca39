"""What a simulated frame shows (`EarthScene`) and how the camera records it (`Imaging`).

Brightness is in DN of an 8-bit sensor at gain 1 (255 saturates). Directions are unit vectors of the
Earth-fixed world frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.planet import Planet

Vector3 = tuple[float, float, float]

TEXTURES = ("uniform", "clouds", "smooth")
_PIXEL_PX = 0.29  # one sigma of a pixel's own blur
AIR_LIGHTS = ("even", "sine")


def unit_vector(vector: Sequence[float] | np.ndarray) -> Vector3:
    """Return the direction of a vector (3,) as a tuple, fit for a frozen dataclass; ValueError for
    what has none.
    """
    v = np.asarray(vector, float)
    length = float(np.linalg.norm(v))
    if v.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise ValueError(f"vector must be three finite numbers, not all zero, got {vector}")
    return float(v[0] / length), float(v[1] / length), float(v[2] / length)


@dataclass(frozen=True)
class EarthScene:
    """The world: the planet, its surface and air, its light, and what else is in the sky."""

    planet: Planet = field(default_factory=Planet)

    texture: str = "uniform"  # one of TEXTURES
    texture_seed: int = 0
    uniform_dn: float = 195.0  # brightness of a "uniform" planet, mean brightness of a "smooth" one
    ground_dn: float = 50.0
    cloud_dn: float = 250.0
    cloud_cover: float = 0.5  # 0..1, share of the surface that is clouded
    cloud_contrast: float = 1.0  # of clouds and ground about uniform_dn; 0: a uniform planet
    smooth_contrast: float = 0.3  # of a "smooth" planet, one sigma over uniform_dn

    # One sigma of what the height of the visible limb (cloud tops) differs by from place to place,
    # in waves of some 200 to 6000 km.
    limb_uneven_m: float = 0.0

    sun_direction: Vector3 | None = None  # None: the whole planet is evenly lit
    even_light: bool = False  # the Sun is in the sky, but the planet is lit evenly all the same
    night_light: float = 0.0  # brightness of the night side over the day side's (moonlight)
    city_dn: float = 0.0  # brightest city lights, on the night side

    air_dn: float = 0.0  # glow of the lit air just above the limb
    air_scale_height_m: float = 9000.0
    air_inside: float = 1.0  # glow just inside the limb over that just outside; thin air: 0.5
    # How brightly the Sun lights it: evenly by day and less through twilight, or as the sine of the
    # Sun's height, as it does ground.
    air_light: str = "even"
    air_rayleigh: float = 0.0  # share of it that goes with Rayleigh's phase function of the Sun
    # Optical depth of the air along a ray that grazes the limb: 4 in red light, 7 in green, 15 in
    # blue. It hides what lies behind it, and air_dn is then how bright it gets. 0: none.
    air_depth: float = 0.0
    airglow_dn: float = 0.0  # emitting layer above the night side, brightest seen edge-on
    airglow_height_m: float = 95e3
    airglow_thickness_m: float = 6e3
    airglow_uneven_m: float = 0.0  # its height's waves, thousands of kilometres long, one sigma

    star_count: int = 0  # over the whole sky
    star_seed: int = 0
    moon_direction: Vector3 | None = None
    moon_radius_rad: float = 0.0045
    moon_dn: float = 200.0
    sun_dn: float = 0.0  # of the Sun's disc where it is in the frame; 0: not drawn

    def __post_init__(self) -> None:
        if self.texture not in TEXTURES:
            raise ValueError(f"texture must be one of {TEXTURES}, got {self.texture!r}")
        if self.air_light not in AIR_LIGHTS:
            raise ValueError(f"air_light must be one of {AIR_LIGHTS}, got {self.air_light!r}")
        if not 0.0 < self.cloud_cover < 1.0:
            raise ValueError(f"cloud_cover must be between 0 and 1, got {self.cloud_cover}")
        if self.air_scale_height_m <= 0.0:
            raise ValueError(f"air_scale_height_m must be positive, got {self.air_scale_height_m}")
        if not self.air_depth >= 0.0:
            raise ValueError(f"air_depth must not be negative, got {self.air_depth}")


@dataclass(frozen=True)
class Occluder:
    """A part of the craft that hides what is behind it: a polygon fixed in the image."""

    corners_px: tuple[tuple[float, float], ...]  # at least three, x right, y down
    brightness_dn: float = 120.0

    def __post_init__(self) -> None:
        if len(self.corners_px) < 3:
            raise ValueError(f"corners_px must hold three corners or more, got {self.corners_px}")


@dataclass(frozen=True)
class Imaging:
    """The camera beyond its geometry: optics, exposure, noise, defects, coding."""

    psf_sigma_px: float = 0.7
    corner_psf_px: float = 0.0  # the same in the corners, where a lens blurs more; 0: as much
    gain: float = 1.0  # exposure: scales everything but background and noise
    background_dn: float = 4.0
    noise_dn: float = 2.0  # read noise, sigma
    shot_noise_dn: float = 0.0  # variance added per DN of signal, DN
    bits: int = 8  # 8: uint8, up to 16: uint16
    vignetting: float = 0.0  # loss of light in the corners, 0..1
    flare_dn: float = 0.0  # ghosts of the Sun mirrored about the image centre
    stray_dn: float = 0.0  # stray light, evenly brighter from one end of the frame to the other ...
    stray_angle_rad: float = 0.0  # ... and towards where, from x right to y down
    banding: float = 0.0  # rolling brightness: relative amplitude, over rows
    banding_period_px: float = 80.0
    hot_pixels: int = 0
    jpeg_quality: int | None = None  # 1..100; None: not compressed; 8 bits only
    occluders: tuple[Occluder, ...] = ()

    def __post_init__(self) -> None:
        if not 8 <= self.bits <= 16:
            raise ValueError(f"bits must be 8 to 16, got {self.bits}")
        if self.jpeg_quality is not None and self.bits != 8:
            raise ValueError(f"jpeg_quality needs 8 bits, got bits = {self.bits}")
        for name in ("psf_sigma_px", "corner_psf_px", "noise_dn", "shot_noise_dn", "gain"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    @property
    def corner_blur_px(self) -> float:
        """What an edge's blur is larger by in the corners, one sigma, the pixels' own included: as
        `CameraView.corner_blur_px`.
        """
        corner = self.corner_psf_px or self.psf_sigma_px
        return math.hypot(corner, _PIXEL_PX) - math.hypot(self.psf_sigma_px, _PIXEL_PX)

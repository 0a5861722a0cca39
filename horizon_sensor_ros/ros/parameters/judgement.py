"""Parameters of when a fix, or a frame, is refused."""

from __future__ import annotations

from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.ros.parameters.parameter import Parameter

JUDGEMENT_PARAMETERS = (
    Parameter(
        "altitude_min",
        "double",
        HorizonConfig.altitude_min_m,
        "A fit with a lower altitude is refused.",
        unit="m",
        minimum=1.0,
        maximum=1e12,
        live=True,
    ),
    Parameter(
        "altitude_max",
        "double",
        HorizonConfig.altitude_max_m,
        "A fit with a higher altitude is refused.",
        unit="m",
        minimum=1.0,
        maximum=1e12,
        live=True,
    ),
    Parameter(
        "max_nadir_sigma",
        "double",
        HorizonConfig.max_nadir_sigma_rad,
        "An estimate less certain than this is withheld.",
        unit="rad",
        minimum=1e-06,
        maximum=3.2,
        live=True,
    ),
    Parameter(
        "max_residual",
        "double",
        HorizonConfig.max_residual_px,
        "A limb that scatters more than this about the fit, per 640 pixels of image "
        "width, is refused.",
        unit="px",
        minimum=0.001,
        maximum=1000.0,
        live=True,
    ),
    Parameter(
        "min_limb_share",
        "double",
        HorizonConfig.min_limb_share,
        "Least share of the lit limb in a frame that must be found.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "max_bright_sky",
        "double",
        HorizonConfig.max_bright_sky,
        "Largest share of the limb beside which the sky may be bright.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "min_clear_sky",
        "double",
        HorizonConfig.min_clear_sky,
        "Least share of the sky that must be at the level of space.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "min_contrast",
        "double",
        HorizonConfig.min_contrast,
        "Least step from planet to space beside the limb, in sigmas of the image's noise.",
        minimum=0.001,
        maximum=10000.0,
        live=True,
    ),
    Parameter(
        "max_space_level",
        "double",
        HorizonConfig.max_space_level,
        "Highest gray level of empty space, over the largest gray level: 255, or for 16-bit images "
        "that of the fewest bits, 8 or more, that hold the frame's brightest pixel (a 12-bit "
        "camera's is 4095 as soon as a pixel reaches 2048).",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
)
